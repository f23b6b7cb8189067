"""Pages, messages and documents are in plain English, and so are comments, docstrings and the names
of tests: phrases that read like a translation are found, with what to say instead.
"""

import ast
import operator
import re
from bisect import bisect
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.media.sources import (
    PACKAGES,
    names_of_tests,
    notes,
    python_files,
    scripts,
    text_of,
)
from tests.support.paths import ROOT
from tests.unit.site.test_templates import po_entries


class Phrase(NamedTuple):
    pattern: str
    instead: str
    example: str


START = r"(?:^|(?<=[.!?:;] )|(?<=\n))"
# The broker is not plain yet.
BROKERS = ("robots/broker", "robots/enrol", "benchmarks/floods.py")
# Said nowhere: not in texts, and not in comments, docstrings, names of tests and scripts.
NOWHERE = (
    Phrase(r"\bby (?:your|their|its) wish\b", "at your request", "by their wish"),
    Phrase(r"\bat hand\b", "available", "no robot is at hand"),
    Phrase(r"\bgoes by the name\b", "is called", "it goes by the name of giraff"),
    Phrase(r"\bmeasuring noise\b", "measurement noise", "more than measuring noise"),
    Phrase(r"\bsince the state before\b", "since the previous state", "since the state before"),
    Phrase(
        START + r"You (?:already )?have [^.!?\n]*\?", "Do you have …?", "You already have a robot?"
    ),
    Phrase(
        r"\b(?:is|becomes) a question of its own\b",
        "becomes a separate question",
        "each row is a question of its own",
    ),
    Phrase(
        r"\b[Nn]obody (?:records|fights|is asked on)\b",
        "it is not recorded, it does not conflict",
        "so that nobody fights a planner",
    ),
    Phrase(
        r"(?<!one )\bof whom\b(?! \d)",
        "whose, of which visitor",
        "one robot, of whom no state is known",
    ),
    Phrase(r"\b[Ww]homever\b", "the visitor who", "for whomever it is meant"),
    Phrase(r"\berrands?\b", "action, task", "runs an errand"),
    Phrase(r"\brungs?\b", "layer, level", "the lowest rung"),
    Phrase(r"\b(?:in|of|the) company\b", "peers", "the company at a robot"),
    Phrase(r"\bfrom then on\b", "after that", "it stops from then on"),
    Phrase(r"\bin one go\b", "at once, in one step", "written in one go"),
    Phrase(r"\blet be\b", "left alone, ignored", "a stopped robot is let be"),
    Phrase(r"\b[Nn]othing (?:stands|goes)\b", "no obstacle is", "Nothing stands in the way"),
    Phrase(r"\bwhat leaves\b", "what is exported", "what leaves is listed"),
    Phrase(r"\b[Ll]est\b", "so that … not", "lest a key moves it"),
)
# Not in comments and docstrings of the product.
NOT_IN_PRODUCT = (
    Phrase(r"\b[Ww]hoever\b", "the driver, the visitor who", "whoever drives"),
    Phrase(r"\b[Ss]omebody(?! else is here)\b", "a visitor, the driver", "somebody waits"),
    Phrase(r"\b[Nn]obody\b", "no visitor, no client", "nobody listens"),
    Phrase(r"\b[Aa]nybody\b", "any visitor, anyone", "before anybody asks"),
    Phrase(r"\b(?:is|are|was|were|be) told\b", "receives, is sent", "the page is told"),
    Phrase(r"\b[Hh]eard? (?:of|from|by)\b", "received, noticed", "was heard of"),
    Phrase(r"\ball the same\b", "still, anyway", "it drives all the same"),
    Phrase(r"\banew\b", "again, restart", "it begins anew"),
    Phrase(
        r"\b[Mm]eanwhile,? (?=\w+ (?:has|have|is|are|was|were)\b)|\bmeanwhile\.?$",
        "while …",
        "it ended meanwhile",
    ),
    Phrase(r"\bcomes? back\b", "returns, reconnects", "the page comes back"),
    Phrase(r"\b[Ll]ets? go\b", "releases", "the driver lets go"),
    Phrase(r"\bsays? nothing\b(?! about)", "sends nothing", "the robot says nothing"),
    Phrase(r"\bsigns? of life\b", "heartbeat, activity", "the last sign of life"),
    Phrase(r"\b(?:is|are|was|were) looked at\b", "checked, read", "the row is looked at"),
    Phrase(r"\bhas to wait\b", "must wait", "the user has to wait"),
    Phrase(r"\b[Ii]t stands\b", "it is, it is at rest", "while it stands"),
    Phrase(
        r"\bstands? (?:there|still|where|behind|for all|at the)\b",
        "is, is at rest",
        "it stands there",
    ),
    Phrase(r"\b[Nn]othing comes\b", "no … arrives", "when nothing comes"),
)
# Not in texts that people read.
NOT_IN_TEXTS = (
    Phrase(
        START + r"Who (?![^.?!\n]*\?)(?=[a-z]+ [a-z]+ )",
        "say who it is: you, the driver, participants",
        "Who drives first gets it.",
    ),
    Phrase(r"\b[Ww]hoever\b", "say who it is: you, the driver", "Whoever drives"),
    Phrase(r"\b[Ii]t stands\b", "it is, it has stopped, it is written", "It stands in the list"),
    Phrase(r"\bstands (?:in|on|there|where|until|for all|at the)\b", "is", "stands in the way"),
    Phrase(START + r"Nothing (?:is|stands|comes|goes)\b", "no … is", "Nothing is stored."),
    Phrase(r"\b(?:is|are|was|were) looked at\b", "checked, reviewed, tested", "it is looked at"),
    Phrase(r"\ball the same\b", "still, anyway", "drives all the same"),
    Phrase(r"\b[Mm]eanwhile\b", "while …", "Meanwhile it waits."),
    Phrase(
        r"(?<!\ba )\b[Ss]ign(?:ed|s|ing)?[ -](?:in|out)\b", "log in, log out", "Sign in to drive."
    ),
    Phrase(r"\banew\b", "again, restart", "begin anew"),
    Phrase(r"\bway driven\b", "distance driven, path driven", "the way driven"),
    Phrase(
        r"\b(?:sends?|drives?|goes?|way) (?:it |the robot )?home\b",
        "to its charging station",
        "it drives home",
    ),
    Phrase(r"\b[Ll]ets? go of\b", "releases", "let go of the key"),
    Phrase(
        r"(?:\b[Ii]t|\b[Tt]hat|\b[Ww]hich|”) is no (?!longer\b|more\b)",
        "is not a",
        "It is no robot.",
    ),
    Phrase(r"\bsays (?:something |nothing )?of itself\b", "reports", "says of itself"),
)
PATTERN = operator.attrgetter("pattern")
PHRASES = (*NOWHERE, *NOT_IN_PRODUCT, *NOT_IN_TEXTS)
# Programs speak in these calls; their strings are read by people, too.
SPOKEN = {"CommandError", "add_argument", "write", "print", "AdapterError"}
# So are the notes of system checks, and the code book of an export.
SPOKEN |= {"Warning", "Error", "Column"}
CALLED = re.compile(rf"\b(?:{'|'.join(sorted(SPOKEN))})\(")


class Library:
    """Texts in one string, which is searched in a tenth of the time of many."""

    def __init__(self, texts: Iterable[tuple[str, str]]) -> None:
        self.paths, parts = zip(*texts, strict=True)
        self.starts = list(accumulate((len(part) + 1 for part in parts), initial=0))
        self.whole = "\n".join(parts)

    def hits(self, phrase: Phrase) -> list[str]:
        return [
            f"{self.paths[bisect(self.starts, hit.start()) - 1]}:"
            f" …{self.whole[max(0, hit.start() - 30) : hit.end() + 40]}…"
            for hit in re.finditer(phrase.pattern, self.whole)
        ]


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


def prose(path: Path) -> str:
    """Return what a document says, without code."""
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
    return re.sub(r"`[^`]*`", "CODE", text)


@cache
def texts() -> Library:
    return Library(_everything())


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


@pytest.mark.parametrize("phrase", [*NOWHERE, *NOT_IN_TEXTS], ids=PATTERN)
def test_texts_are_in_plain_english(phrase):
    assert texts().hits(phrase) == [], f"say instead: {phrase.instead}"


def all_notes(paths: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Yield (path, text) of each comment, docstring and name of a test."""
    for path in paths:
        if path != Path(__file__) and "migrations" not in path.parts:
            relative = str(path.relative_to(ROOT))
            yield from ((relative, note) for note in (*notes(path), *names_of_tests(path)))


def product() -> list[Path]:
    folders = (*PACKAGES, "benchmarks", "deploy", "docs")
    return [path for folder in folders for path in python_files(folder)]


@cache
def notes_of_the_product() -> Library:
    unread = {path for place in BROKERS for path in python_files(place)}
    return Library(all_notes(path for path in product() if path not in unread))


@cache
def notes_of_everything() -> Library:
    others = (*python_files("tests"), *scripts("static/js"), *scripts("tests/js"))
    return Library(all_notes((*product(), *others)))


@pytest.mark.parametrize("phrase", NOWHERE, ids=PATTERN)
def test_comments_docstrings_and_test_names_are_in_plain_english(phrase):
    assert notes_of_everything().hits(phrase) == [], f"say instead: {phrase.instead}"


@pytest.mark.parametrize("phrase", NOT_IN_PRODUCT, ids=PATTERN)
def test_comments_and_docstrings_of_the_product_are_in_plain_english(phrase):
    assert notes_of_the_product().hits(phrase) == [], f"say instead: {phrase.instead}"


@pytest.mark.parametrize("phrase", PHRASES, ids=PATTERN)
def test_a_phrase_finds_its_example(phrase):
    assert Library([("example", phrase.example)]).hits(phrase) != []


def test_comments_docstrings_and_names_of_tests_are_read():
    mine = (*notes(Path(__file__)), *names_of_tests(Path(__file__)))
    assert "comments docstrings and names of tests are read" in mine
    assert {"tests/conftest.py", "static/js/lib/ids.js"} <= set(notes_of_everything().paths)
