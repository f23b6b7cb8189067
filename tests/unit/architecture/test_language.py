"""Pages, messages and documents are in plain English: constructions that read like a translation
are found, with what to say instead.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.support.media.sources import PACKAGES, python_files, text_of
from tests.support.paths import ROOT
from tests.unit.site.test_templates import po_entries

START = r"(?:^|(?<=[.!?:;] )|(?<=\n))"
INSTEAD = {
    START
    + r"Who (?![^.?!\n]*\?)(?=[a-z]+ [a-z]+ )": "say who it is: you, the driver, participants",
    r"\b[Ww]hoever\b": "say who it is: you, the driver, participants",
    r"\b[Ii]t stands\b": "it is, it has stopped, it is written",
    r"\bstands (?:in|on|there|where|until|for all|at the)\b": "is",
    START + r"Nothing (?:is|stands|comes|goes)\b": "no … is",
    r"\bby (?:your|their) wish\b": "at your request",
    r"\b(?:is|are|was|were) looked at\b": "checked, reviewed, tested",
    r"\ball the same\b": "still, anyway",
    r"\b[Mm]eanwhile\b": "while …",
    r"\bat hand\b": "available",
    r"\bgoes by the name\b": "is called",
    r"\bfrom then on\b": "after that",
    r"(?<!\ba )\b[Ss]ign(?:ed|s|ing)?[ -](?:in|out)\b": "log in, log out",
    r"\banew\b": "again, restart",
    r"\bmeasuring noise\b": "measurement noise",
    r"\bway driven\b": "distance driven, path driven",
    r"\b(?:sends?|drives?|goes?|way) (?:it |the robot )?home\b": "to its charging station",
    r"\bsince the state before\b": "since the previous state",
    r"\b[Ll]ets? go of\b": "releases",
    START + r"You (?:already )?have [^.!?\n]*\?": "Do you have …?",
    r"(?:\b[Ii]t|\b[Tt]hat|\b[Ww]hich|”) is no (?!longer\b|more\b)": "is not a",
    r"\b(?:is|becomes) a question of its own\b": "becomes a separate question",
    r"\bsays (?:something |nothing )?of itself\b": "reports",
    r"\b[Nn]obody (?:records|fights|is asked on)\b": "it is not recorded, it does not conflict",
}
# Programs speak in these calls; their strings are read by people, too.
SPOKEN = {"CommandError", "add_argument", "write", "print", "AdapterError"}
# So are the notes of system checks, and the code book of an export.
SPOKEN |= {"Warning", "Error", "Column"}
CALLED = re.compile(rf"\b(?:{'|'.join(sorted(SPOKEN))})\(")


def spoken(path: Path) -> Iterator[str]:
    """Yield the sentences that a module says on the command line."""
    if not CALLED.search(text_of(path)):
        return
    for node in ast.walk(ast.parse(text_of(path))):
        if isinstance(node, ast.Call) and _name(node.func) in SPOKEN:
            for part in ast.walk(node):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.value


def _name(function: ast.expr) -> str:
    return getattr(function, "attr", getattr(function, "id", ""))


def prose(path: Path) -> str:
    """Return what a document says, without code."""
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
    return re.sub(r"`[^`]*`", "CODE", text)


@cache
def everything() -> tuple[tuple[str, str], ...]:
    return tuple(_everything())


def _everything() -> Iterator[tuple[str, str]]:
    for entry in po_entries():
        yield "locale", entry["msgid"]
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]:
        if path.name != "CHANGELOG.md":
            yield str(path.relative_to(ROOT)), prose(path)
    for app in PACKAGES:
        for path in python_files(app):
            for text in spoken(path):
                yield str(path.relative_to(ROOT)), text


@pytest.mark.parametrize("pattern", INSTEAD)
def test_no_text_reads_like_a_translation(pattern):
    found = [
        f"{where}: …{text[max(0, hit.start() - 30) : hit.end() + 40]}…"
        for where, text in everything()
        for hit in re.finditer(pattern, text)
    ]
    assert found == [], f"say instead: {INSTEAD[pattern]}"
