"""Decisions: a page for each, and an index that has all of them."""

import re

from tests.support.paths import ROOT

FOLDER = ROOT / "docs/explanation/decisions"
PAGES = {path.name: path.read_text("utf-8") for path in FOLDER.glob("*.md")}
INDEX = PAGES.pop("index.md")
LINK = re.compile(r"\]\(([^)#:]+\.md)\)")


def test_every_decision_is_in_the_index_once_with_its_title_and_date():
    listed = re.findall(r"^- \[(.+?)\]\((.+?\.md)\), (\d{4}-\d\d-\d\d)$", INDEX, re.MULTILINE)
    assert sorted(name for _, name, _ in listed) == sorted(PAGES)
    for title, name, date in listed:
        assert PAGES[name].startswith(f"# {title}\n\n{date}")
        assert name.startswith(date)


def test_what_supersedes_a_decision_is_there():
    linked = {name for page in PAGES.values() for name in LINK.findall(page)}
    assert {name for name in linked if not (FOLDER / name).exists()} == set()
    assert any("Superseded by" in page for page in PAGES.values())
