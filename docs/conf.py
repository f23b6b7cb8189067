"""Sphinx's configuration of `make docs-site`: the Markdown of docs/ and of the project's root as
pages that open from a disk, with search, and without a request to another computer.

The documents themselves are plain Markdown: the contents of the site are added here.
"""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
CONTENTS = {
    "Tutorials": ["tutorials/*"],
    "How-to guides": ["howto/*"],
    "Help": ["help/*"],
    "Reference": ["reference/*"],
    "Explanation": ["explanation/*", "explanation/decisions/index"],
    "Development": ["development/*", "examples/acme_robot/README"],
    "Project": ["/README", "/CONTRIBUTING", "/SECURITY", "/CHANGELOG"],
}

project = "Telepresence"
extensions = ["myst_parser"]
myst_heading_anchors = 6
myst_enable_extensions = ["html_image"]
root_doc = "docs/index"
include_patterns = ["docs/**", "*.md"]
exclude_patterns = [path.name for path in ROOT.iterdir() if path.is_dir() and path.name != "docs"]
suppress_warnings = ["myst.header"]  # a changelog repeats its headings at the levels it needs
html_theme = "furo"
html_title = "Telepresence"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_show_search_summary = False  # it is fetched, which a browser refuses for files on a disk


def add_contents(_app: "Sphinx", name: str, source: list[str]) -> None:
    """Append the tables of contents to the pages that have one."""
    if name == "docs/index":
        source[0] += "".join(toctree(*section) for section in CONTENTS.items())
    elif name == "docs/explanation/decisions/index":
        source[0] += toctree("", ["*"])


def toctree(caption: str, pages: list[str]) -> str:
    """Return a hidden table of contents."""
    named = f":caption: {caption}\n" if caption else ""
    lines = "\n".join(pages)
    return f"\n\n```{{toctree}}\n:hidden:\n:glob:\n{named}\n{lines}\n```\n"


def write_index_page(app: "Sphinx", error: Exception | None) -> None:
    """Let index.html in the site's folder lead to the first page."""
    if error is None:
        first = f'<meta http-equiv="refresh" content="0; url={root_doc}.html">'
        (Path(app.outdir) / "index.html").write_text(f"<!DOCTYPE html>{first}\n", "utf-8")


def setup(app: "Sphinx") -> None:
    """Connect the functions above with Sphinx."""
    app.connect("source-read", add_contents)
    app.connect("build-finished", write_index_page)
