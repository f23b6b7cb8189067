"""The pictures of README and documentation are those that were recorded, are used, and are small;
what they show is still in the product. `make pictures` takes them again.
"""

import hashlib
import re
from functools import cache

import pytest
from PIL import Image

from tests.support.browsers.shown import FOLDER, MOVED, Control, differences, records, words
from tests.support.media.sources import PACKAGES
from tests.support.paths import ROOT

PICTURES = {path.name: path for path in FOLDER.glob("*.webp")}
LARGEST, LARGEST_FILM = 160_000, 2_000_000  # bytes
LEAVE = Control(name="leave", label="Leave", box=[1100, 10, 90, 40], colours="white on black")


@cache
def product() -> str:
    """Return all texts of the pages, also those in data, in one string."""
    places = (*PACKAGES, "templates", "static/js", "locale")
    ends = {".py", ".html", ".js", ".toml", ".json", ".po"}
    files = (path for place in places for path in (ROOT / place).rglob("*") if path.suffix in ends)
    return " ".join(" ".join(path.read_text("utf-8").split()) for path in files)


def test_each_picture_is_the_one_whose_page_was_recorded():
    digests = {name: one["sha256"] for name, one in records()["pictures"].items()}
    found = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in PICTURES.items()}
    assert digests == found, "run `make pictures`"


def test_each_picture_is_shown_in_a_document_and_is_small():
    documents = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    text = " ".join(path.read_text("utf-8") for path in documents)
    for name, path in PICTURES.items():
        assert f"img/{name}" in text
        with Image.open(path) as image:
            moves = getattr(image, "n_frames", 1) > 1
        assert path.stat().st_size <= (LARGEST_FILM if moves else LARGEST)


@pytest.mark.parametrize("page", records()["pages"])
def test_every_word_on_a_picture_is_still_on_a_page_of_the_product(page):
    labels = {one["label"] for one in records()["pages"][page]} - {""}
    assert len(labels) > 5
    gone = {label for label in labels if not is_said(label)}
    assert gone == set(), "run `make pictures`"


def is_said(label: str) -> bool:
    """Tell whether the product has each line of a label, and each part around its numbers."""
    return all(part in product() for part in re.split(r"\s*[#|]\s*", label))


def test_word_that_no_page_has_is_found():
    assert is_said("Leave")
    assert not is_said("Let them hear me")


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"label": "Go"}, "gone: leave “Leave”"),
        ({"box": [1100, 10 + MOVED + 1, 90, 40]}, "moved: leave"),
        ({"colours": "white on red"}, "leave: white on black → white on red"),
    ],
)
def test_page_that_looks_otherwise_differs_from_its_record(changed, line):
    assert differences([LEAVE], [LEAVE]) == []
    assert line in differences([LEAVE], [Control(**{**LEAVE, **changed})])[0]


def test_number_and_small_shift_are_no_difference():
    assert words("Battery: 90 %") == words("Battery: 7.5 %") == "Battery: # %"
    assert words("Camera: off\n  Camera\n") == "Camera: off | Camera"
    assert differences([LEAVE], [Control(**{**LEAVE, "box": [1100 + MOVED, 10, 90, 40]})]) == []
