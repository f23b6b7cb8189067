"""Decisions: a page for each area, and short entries."""

import re

from tests.support.paths import ROOT

FOLDER = ROOT / "docs/explanation/decisions"
PAGES = {path.name: path.read_text("utf-8") for path in FOLDER.glob("*.md")}
INDEX = PAGES.pop("index.md")
MOST_PAGES = 15
MOST_LINES = 20
ENTRY = re.compile(r"^## (.+)\n\n((?:(?!## ).*\n)+)", re.MULTILINE)


def test_the_index_lists_each_page_with_its_title_and_number_of_entries():
    listed = re.findall(r"^- \[(.+?)\]\((.+?\.md)\) \((\d+)\)$", INDEX, re.MULTILINE)
    assert sorted(name for _, name, _ in listed) == sorted(PAGES)
    assert len(PAGES) <= MOST_PAGES
    for title, name, number in listed:
        assert PAGES[name].startswith(f"# {title}\n\n## ")
        assert len(ENTRY.findall(PAGES[name])) == int(number), name


def test_entries_are_short():
    entries = [entry for page in PAGES.values() for entry in ENTRY.findall(page)]
    long = [title for title, text in entries if text.count("\n") > MOST_LINES]
    assert long == []
