"""A rendered page as a screen reader and a strict policy see it."""

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import pairwise

VOID = {
    *("area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source"),
    *("track", "wbr"),
}
CONTROLS = {"input", "select", "textarea"}


@dataclass
class Element:
    tag: str
    attributes: dict[str, str]
    text: str = ""


@dataclass
class Page(HTMLParser):
    """Every element of a page, in order, with the text inside it."""

    elements: list[Element] = field(default_factory=list)
    open: list[Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag, attrs):
        element = Element(tag, {name: value or "" for name, value in attrs})
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1].tag == tag, f"</{tag}> closes <{self.open[-1].tag}>"
        self.open.pop()

    def handle_data(self, data):
        for element in self.open:
            element.text += data

    def all(self, tag: str) -> list[Element]:
        return [element for element in self.elements if element.tag == tag]

    @property
    def text(self) -> str:
        return " ".join(self.all("body")[0].text.split())


def read(response) -> Page:
    page = Page()
    page.feed(response.content.decode())
    page.close()
    return page


def faults(page: Page) -> list[str]:
    """Return what is wrong with a page for screen readers, and for a policy without inline code."""
    found = [f"<{element.tag}> stays open" for element in page.open]
    ids = [e.attributes["id"] for e in page.elements if "id" in e.attributes]
    found += [f"id {i} is there twice" for i in set(ids) if ids.count(i) > 1]
    if not page.all("html")[0].attributes.get("lang"):
        found.append("no language")
    if len(page.all("h1")) != 1:
        found.append(f"{len(page.all('h1'))} h1")
    if len(page.all("main")) != 1:
        found.append("no main landmark")
    levels = [int(e.tag[1]) for e in page.elements if re.fullmatch("h[1-6]", e.tag)]
    found += [f"h{b} follows h{a}" for a, b in pairwise(levels) if b > a + 1]
    labelled = {e.attributes.get("for") for e in page.all("label")}
    for e in page.elements:
        a = e.attributes
        found += [f"<{e.tag} {name}>" for name in a if name == "style" or name.startswith("on")]
        if e.tag == "img" and "alt" not in a:
            found.append(f"img {a.get('src')} without alt")
        if (
            e.tag in CONTROLS
            and a.get("type") != "hidden"
            and not (a.get("type") == "submit" and a.get("value"))
            and a.get("id") not in labelled
            and "aria-label" not in a
        ):
            found.append(f"{a.get('name')} without label")
        if e.tag in {"a", "button"} and not (e.text.strip() or a.get("aria-label")):
            found.append(f"{e.tag} without a name")
        if e.tag == "script" and "src" not in a and a.get("type") != "application/json":
            found.append("inline script")
        if e.tag == "style":
            found.append("inline style sheet")
        for name in ("aria-describedby", "aria-labelledby", "aria-controls"):
            found += [
                f"{name} points at {i}, which is not there"
                for i in a.get(name, "").split()
                if i not in ids
            ]
    return found
