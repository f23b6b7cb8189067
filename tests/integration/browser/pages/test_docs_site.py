"""`make docs-site`: the documentation as pages that open from a disk and can be searched, without a
request to another computer. A broken link fails it.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.support.browsers.visitor import note_problems
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import run

pytestmark = pytest.mark.browser
LOADED = re.compile(r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=\"((?:https?:)?//[^\"]+)\"")


def build(root: Path, target: Path) -> subprocess.CompletedProcess[str]:
    """Build the site of a project as the Makefile does."""
    (line,) = re.findall(r"\$\(BIN\)/python (-m sphinx .*)", (ROOT / "Makefile").read_text("utf-8"))
    return run(sys.executable, *line.replace("var/docs-site", str(target)).split(), cwd=root)


@pytest.fixture(scope="module")
def docs_site(tmp_path_factory):
    target = tmp_path_factory.mktemp("docs-site")
    done = build(ROOT, target)
    assert done.returncode == 0, done.stdout + done.stderr
    return target


def test_search_finds_a_page_on_a_disk_without_any_request(docs_site, browser):
    page = browser.new_page()
    requests, problems = [], []
    page.on("request", lambda request: requests.append(request.url))
    note_problems(page, problems)
    page.goto((docs_site / "index.html").as_uri())
    expect(page.get_by_role("heading", name="Documentation")).to_be_visible()
    search = page.locator("input[name=q]")
    search.fill("deadman")
    search.press("Enter")
    result = page.locator("#search-results").get_by_role("link", name="Glossary")
    expect(result).to_be_visible(timeout=patient(10) * 1000)
    result.click()
    expect(page.locator("h1")).to_contain_text("Glossary")
    page.close()
    assert problems == []
    assert {url.partition(":")[0] for url in requests} <= {"file", "data"}


def test_no_page_loads_anything_from_another_computer(docs_site):
    pages = list(docs_site.rglob("*.html"))
    assert len(pages) > 50
    assert {found for path in pages for found in LOADED.findall(path.read_text("utf-8"))} == set()


def test_pictures_and_every_document_are_on_the_site(docs_site):
    names = {path.relative_to(ROOT).with_suffix("") for path in (ROOT / "docs").rglob("*.md")}
    assert all((docs_site / name).with_suffix(".html").exists() for name in names)
    images = {path.name for path in (docs_site / "_images").iterdir()}
    assert {path.name for path in (ROOT / "docs/img").glob("*.webp")} <= images


@pytest.mark.parametrize("link", ["no-such-page.md", "help/faq.md#no-such-heading"])
def test_broken_link_fails(tmp_path, link):
    (tmp_path / "docs/help").mkdir(parents=True)
    shutil.copy(ROOT / "docs/conf.py", tmp_path / "docs")
    (tmp_path / "docs/help/faq.md").write_text("# FAQ\n")
    (tmp_path / "docs/index.md").write_text(f"# Documentation\n\n[broken]({link})\n")
    done = build(tmp_path, tmp_path / "site")
    assert done.returncode != 0
    assert link.partition("#")[2] or link in done.stderr
    assert "myst.xref_missing" in done.stderr
