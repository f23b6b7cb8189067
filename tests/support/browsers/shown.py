"""What a reader sees of a page: its controls and titles, where they are, and in which colours.

A picture of a page is outdated when the page shows something else than its record in
docs/img/pictures.json. Numbers, the video and the map change all the time and are not compared.
"""

import json
import re
from typing import Any, TypedDict

from tests.support.paths import ROOT

FOLDER = ROOT / "docs" / "img"
RECORDS = FOLDER / "pictures.json"
MOVED = 24  # px; less comes from fonts of another version
# name, label, box and colours of all that a page shows in its window
PROBE = """() => {
  const selector = "h1, h2, h3, button, a[href], input, select, summary, [role=button], .pill";
  const boxOf = (one) => {
    const { left, top, width, height } = one.getBoundingClientRect();
    return [left, top, width, height].map(Math.round);
  };
  const isShown = (one) => {
    const [left, top, width, height] = boxOf(one);
    return one.checkVisibility({ opacityProperty: true, visibilityProperty: true })
      && width > 2 && height > 2
      && left >= 0 && top >= 0 && left + width <= innerWidth && top + height <= innerHeight;
  };
  return [...document.querySelectorAll(selector)].filter(isShown).map((one) => {
    const { color, backgroundColor } = getComputedStyle(one);
    const label = one.getAttribute("aria-label") ?? one.innerText ?? "";
    return { name: one.id || one.dataset.action || one.localName, label, box: boxOf(one),
      colours: `${color} on ${backgroundColor}` };
  });
}"""


class Control(TypedDict):
    name: str
    label: str
    box: list[int]
    colours: str


def controls(probed: list[dict[str, Any]]) -> list[Control]:
    """Return what PROBE found, without numbers and in a fixed order."""
    found = [Control(**{**one, "label": words(one["label"])}) for one in probed]
    return sorted(found, key=lambda one: (one["box"][1], one["box"][0], one["name"]))


def words(label: str) -> str:
    """Return a label with `#` for numbers and ` | ` between its lines."""
    lines = [" ".join(line.split()) for line in label.splitlines()]
    return re.sub(r"[\d.,:–-]*\d[\d.,:]*", "#", " | ".join(line for line in lines if line))


def differences(recorded: list[Control], found: list[Control]) -> list[str]:
    """Return one line for each thing that is new, gone, elsewhere or in other colours."""
    key = lambda one: (one["name"], one["label"])
    before, now = ({key(one): one for one in many} for many in (recorded, found))
    lines = [f"gone: {name} “{label}”" for name, label in before.keys() - now.keys()]
    lines += [f"new: {name} “{label}”" for name, label in now.keys() - before.keys()]
    for name in before.keys() & now.keys():
        pairs = zip(before[name]["box"], now[name]["box"], strict=True)
        if any(abs(a - b) > MOVED for a, b in pairs):
            lines.append(f"moved: {name[0]} {before[name]['box']} → {now[name]['box']}")
        if before[name]["colours"] != now[name]["colours"]:
            lines.append(f"{name[0]}: {before[name]['colours']} → {now[name]['colours']}")
    return sorted(lines)


def records() -> dict[str, Any]:
    """Return `pictures`, the digest and page of each, and `pages`, what each of these shows."""
    return dict(json.loads(RECORDS.read_text("utf-8")))
