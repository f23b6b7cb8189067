"""Pages, messages and documents are in plain English: constructions that read like a translation
are found, with what to say instead. Phrases of `NOWHERE` are not in the sources either; the others
move there as soon as no comment has them.
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
# What is said nowhere: also not in comments, docstrings, names of tests and scripts.
NOWHERE = {
    r"\bby (?:your|their) wish\b": "at your request",
    r"\bat hand\b": "available",
    r"\bgoes by the name\b": "is called",
    r"\bmeasuring noise\b": "measurement noise",
    r"\bsince the state before\b": "since the previous state",
    START + r"You (?:already )?have [^.!?\n]*\?": "Do you have …?",
    r"\b(?:is|becomes) a question of its own\b": "becomes a separate question",
    r"\b[Nn]obody (?:records|fights|is asked on)\b": "it is not recorded, it does not conflict",
}
INSTEAD = NOWHERE | {
    START
    + r"Who (?![^.?!\n]*\?)(?=[a-z]+ [a-z]+ )": "say who it is: you, the driver, participants",
    r"\b[Ww]hoever\b": "say who it is: you, the driver, participants",
    r"\b[Ii]t stands\b": "it is, it has stopped, it is written",
    r"\bstands (?:in|on|there|where|until|for all|at the)\b": "is",
    START + r"Nothing (?:is|stands|comes|goes)\b": "no … is",
    r"\b(?:is|are|was|were) looked at\b": "checked, reviewed, tested",
    r"\ball the same\b": "still, anyway",
    r"\b[Mm]eanwhile\b": "while …",
    r"\bfrom then on\b": "after that",
    r"(?<!\ba )\b[Ss]ign(?:ed|s|ing)?[ -](?:in|out)\b": "log in, log out",
    r"\banew\b": "again, restart",
    r"\bway driven\b": "distance driven, path driven",
    r"\b(?:sends?|drives?|goes?|way) (?:it |the robot )?home\b": "to its charging station",
    r"\b[Ll]ets? go of\b": "releases",
    r"(?:\b[Ii]t|\b[Tt]hat|\b[Ww]hich|”) is no (?!longer\b|more\b)": "is not a",
    r"\bsays (?:something |nothing )?of itself\b": "reports",
}
# Programs speak in these calls; their strings are read by people, too.
SPOKEN = {"CommandError", "add_argument", "write", "print", "AdapterError"}
# So are the notes of system checks, and the code book of an export.
SPOKEN |= {"Warning", "Error", "Column"}
CALLED = re.compile(rf"\b(?:{'|'.join(sorted(SPOKEN))})\(")


def spoken(path: Path) -> Iterator[str]:
    """Yield the sentences that a module says on the command line: all of a command or of the system
    checks.
    """
    whole = "commands" in path.parts or path.name == "checks.py"
    if not whole and not CALLED.search(text_of(path)):
        return
    tree = ast.parse(text_of(path))
    calls = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and _name(node.func) in SPOKEN
    ]
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for part in (part for node in ([tree] if whole else calls) for part in ast.walk(node)):
        is_text = isinstance(part, ast.Constant) and isinstance(part.value, str)
        if is_text and id(part) not in docstrings:
            yield part.value


def _name(function: ast.expr) -> str:
    return getattr(function, "attr", getattr(function, "id", ""))


def notes(path: Path) -> Iterator[str]:
    """Yield the comments, docstrings and names of tests in a source."""
    text = text_of(path)
    sign = "#" if path.suffix == ".py" else "//"
    yield from re.findall(rf"(?:^|\s){sign} (.+(?:\n\s*{sign} .+)*)", text)
    if path.suffix == ".py":
        yield from re.findall(r'"""(.*?)"""', text, re.DOTALL)
        yield from (name.replace("_", " ") for name in re.findall(r"def test_(\w+)", text))
    else:
        yield from re.findall(r"/\*(.*?)\*/", text, re.DOTALL)
        yield from re.findall(r"""^\s*test\(["'](.+)["']""", text, re.MULTILINE)


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


@cache
def all_notes() -> tuple[tuple[str, str], ...]:
    scripts = [*(ROOT / "static/js").rglob("*.js"), *(ROOT / "tests/js").rglob("*.js")]
    modules = [path for app in (*PACKAGES, "benchmarks", "tests") for path in python_files(app)]
    return tuple(
        (str(path.relative_to(ROOT)), re.sub(r"\s+(?:(?:\*|#|//)\s+)?", " ", note).strip())
        for path in [*modules, *scripts]
        if path != Path(__file__)
        for note in notes(path)
    )


@pytest.mark.parametrize("pattern", NOWHERE)
def test_no_comment_docstring_or_name_of_a_test_reads_like_a_translation(pattern):
    found = [f"{where}: {note}" for where, note in all_notes() if re.search(pattern, note)]
    assert found == [], f"say instead: {NOWHERE[pattern]}"


def test_comments_docstrings_and_names_of_tests_are_read():
    assert any("names of tests are read" in note for note in notes(Path(__file__)))
    assert any(where.endswith(".js") for where, _ in all_notes())
