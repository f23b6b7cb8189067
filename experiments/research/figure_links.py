"""A figure as a part of a page: its parts are links, and it needs no style that the page's policy
forbids.

matplotlib writes `style` attributes, which a Content-Security-Policy without `unsafe-inline`
ignores; presentation attributes can say the same. Ids get the figure's name as a prefix, because a
page has several figures.
"""

import re
from collections.abc import Callable
from xml.etree import ElementTree as ET

SVG, XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
HREF = f"{{{XLINK}}}href"
LINK = f"{{{SVG}}}a"
_URL = re.compile(r"url\(#")
# matplotlib's style element says these of every element; an attribute of the root is inherited.
_INHERITED = {"stroke-linejoin": "round", "stroke-linecap": "butt"}


def linked(
    svg: bytes, name: str, title: str, address: Callable[[str], str], called: Callable[[int], str]
) -> str:
    """Return an SVG for a page. It must come from experiments.analysis.figures.drawing: no other
    file is safe. `name` is the prefix of every id; `address` gives the address behind a part by its
    id, or nothing; screen readers read `title`, and of the nth link, from 1, what `called` returns.
    """
    ET.register_namespace("", SVG)
    ET.register_namespace("xlink", XLINK)
    root = ET.fromstring(svg)  # noqa: S314 -- our own
    for parent in list(root.iter()):
        for place, child in reversed(list(enumerate(parent))):
            if child.tag in {f"{{{SVG}}}metadata", f"{{{SVG}}}style"}:
                parent.remove(child)
            elif found := address(child.get("id", "")):
                parent[place] = ET.Element(LINK, {"href": found})
                parent[place].append(child)
    for number, link in enumerate(root.iter(LINK), 1):
        link.set("aria-label", called(number))
    for part in root.iter():
        _plain(part, name)
    # with the role "img", screen readers would ignore its links
    root.attrib |= _INHERITED | {"role": "figure", "aria-label": title}
    width = float(root.get("width", "504pt").removesuffix("pt"))
    root.attrib.pop("height", None)
    root.set("width", f"{width * 4 / 3:.0f}")
    return ET.tostring(root, encoding="unicode")


def _plain(part: ET.Element, name: str) -> None:
    for declaration in part.attrib.pop("style", "").split(";"):
        key, _, value = declaration.partition(":")
        if value.strip():
            part.set(key.strip(), value.strip())
    for key, value in list(part.attrib.items()):
        if key == "id":
            part.set(key, f"{name}-{value}")
        elif key == HREF and value.startswith("#"):
            part.set(key, f"#{name}-{value[1:]}")
        elif "url(#" in value:
            part.set(key, _URL.sub(f"url(#{name}-", value))
