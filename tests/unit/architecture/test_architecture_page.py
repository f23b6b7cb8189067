"""Every name in backticks in docs/explanation/architecture.md exists, in the file named before it.

A paragraph, a list item and a row of a table are a block each. In a block a name belongs to the
file or folder named last before it; without one it may be anywhere in our code. Python is parsed;
in JavaScript a declaration is looked for. What is no name, and does not follow a path directly, has
to be a string of the code, such as a topic or the reason of a refusal, or a command.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from tests.support.media.sources import PACKAGES, python_files, text_of
from tests.support.paths import ROOT

PAGE = (ROOT / "docs/explanation/architecture.md").read_text("utf-8")
FOLDERS = (*PACKAGES, "static", "templates", "tests", "deploy", "docs", "benchmarks", "locale")
PATH = re.compile(rf"(?:{'|'.join(FOLDERS)})/\S*|\S+\.(?:py|js|toml|md|html)")
NAME = re.compile(r"_?[A-Za-z]\w*(?:\.\w+)*(?:\(\))?")
TOOLS = {"lint-imports"}


# --- the page -------------------------------------------------------------------------------------


def blocks(page: str) -> list[str]:
    """Return paragraphs, list items and rows of tables; what is drawn in a code block is none."""
    text = re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL)
    return [block for block in re.split(r"\n\s*\n|\n(?=\||- |\d+\. |#)", text) if "`" in block]


def mistakes(page: str) -> list[str]:
    """Return what a page says in backticks that the code does not have."""
    found = []
    for block in blocks(page):
        home, home_ends = "", -1
        for span in re.finditer(r"`([^`]+)`", block):
            word = re.sub(r"\s+", " ", span[1])
            if PATH.fullmatch(word):
                home, home_ends = word, span.end()
                found += [] if (ROOT / word).exists() else [word]
                continue
            is_beside_home = re.fullmatch(r"[,:]\s+", block[max(0, home_ends) : span.start()])
            if not is_known(word, home, declared_only=bool(is_beside_home)):
                found.append(f"{word} in {home or 'our code'}")
    return found


def is_known(word: str, home: str, *, declared_only: bool) -> bool:
    if NAME.fullmatch(word) and is_declared(word.removesuffix("()"), home):
        return True
    return not declared_only and not looks_like_a_name(word) and is_said(word)


def looks_like_a_name(word: str) -> bool:
    """Tell whether a word can only be a class, or a member of one."""
    return re.fullmatch(r"[A-Z][a-z]+(?:[A-Z]\w*)?(?:\.\w+)*", word) is not None and (
        not is_string(word)
    )


def is_said(word: str) -> bool:
    """Tell whether the code has a string such as a topic, a reason, an option or a command."""
    pattern = re.sub(r"<\w+>", "+", word)
    return pattern in commands() | TOOLS or is_string(pattern) or is_string(f"{pattern}/reply")


# --- the code -------------------------------------------------------------------------------------


def is_declared(name: str, home: str) -> bool:
    """Tell whether a name, such as `Kernel.tick`, is declared in a file or folder, or anywhere."""
    if home.endswith(".js"):
        return in_javascript(name, (ROOT / home).read_text("utf-8"))
    folders = PACKAGES if not (ROOT / home).exists() or home == "" else (home,)
    last = name.rpartition(".")[2]
    return any(name in module(path).declared for path in files_with(last, *folders)) or (
        home == "" and name in PACKAGES
    )


def files_with(text: str, *places: str) -> Iterator[Path]:
    """Yield the Python files that have a text anywhere."""
    files = (path for place in places for path in python_files(place))
    return (path for path in files if text in text_of(path))


@dataclass(frozen=True)
class Module:
    """What a module declares (classes, functions and values, and members as `Class.name`), and its
    strings.
    """

    declared: frozenset[str]
    strings: frozenset[str]


@cache
def module(path: Path) -> Module:
    tree = ast.parse(text_of(path))
    constants = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return Module(
        frozenset(declared_in(tree.body)),
        frozenset(value for value in constants if isinstance(value, str)),
    )


def declared_in(body: list[ast.stmt]) -> set[str]:
    found: set[str] = set()
    for node in body:
        match node:
            case ast.ClassDef(name=name, body=members):
                inner = declared_in(members)
                found |= {name, *inner, *(f"{name}.{member}" for member in inner)}
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                found.add(name)
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
            case ast.Assign(targets=targets):
                found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def in_javascript(name: str, source: str) -> bool:
    """Tell whether a script declares a class, a function or a value, or a method `Class.name`."""
    owner, _, member = name.rpartition(".")
    if owner:
        inside = re.search(rf"^export class {owner}\b.*?^}}", source, re.MULTILINE | re.DOTALL)
        return inside is not None and is_method(member, inside[0])
    declares = rf"^(?:export )?(?:class|const|function|async function) {name}\b"
    return re.search(declares, source, re.MULTILINE) is not None


def is_method(name: str, source: str) -> bool:
    return re.search(rf"^  (?:async |get |static )?{name}\(", source, re.MULTILINE) is not None


@cache
def commands() -> frozenset[str]:
    return frozenset(path.stem for path in ROOT.glob("*/management/commands/*.py"))


def is_string(word: str) -> bool:
    """Tell whether our Python has a string, in one piece, or the page's scripts have it or a key
    of its name.
    """
    return word in javascript_strings() or any(
        word in module(path).strings for path in files_with(word, *PACKAGES)
    )


@cache
def javascript_strings() -> frozenset[str]:
    found: set[str] = set()
    for path in (ROOT / "static/js").rglob("*.js"):
        source = path.read_text("utf-8")
        found |= set(re.findall(r'"([^"\n]+)"', source))
        found |= set(re.findall(r"^\s+(\w+):", source, re.MULTILINE))
    return frozenset(found)


# --- tests ----------------------------------------------------------------------------------------


def test_every_name_on_the_page_exists():
    assert mistakes(PAGE) == []


def test_the_page_names_files_and_what_is_in_them():
    spans = [span for block in blocks(PAGE) for span in re.findall(r"`([^`]+)`", block)]
    assert len([span for span in spans if PATH.fullmatch(span)]) > 80
    assert len([span for span in spans if "." in span and not PATH.fullmatch(span)]) > 20


@pytest.mark.parametrize(
    "made_up",
    [
        "See `robots/agent/safety/kernels.py`.",
        "See `robots/agent/unsafety/`.",
        "1. `robots/agent/safety/kernel.py`, `Colonel`.",
        "1. `robots/agent/safety/kernel.py`, `Kernel.tock`.",
        "1. `robots/agent/safety/kernel.py`, `CollisionMonitor`.",
        "- `static/js/input/arbiter.js`, `Referee`.",
        "- `static/js/input/arbiter.js`, `Arbiter.refuse`.",
        "- `static/js/input/arbiter.js`, `Keymap`.",
        "| `run_nothing` | a command |",
        "1. `robots/agent/safety/kernel.py`, `old_seq`.",
        "A `TimeMachine` in no file.",
        "The topic `command/fly`.",
        "Refused: `bad_mood`.",
    ],
)
def test_a_name_that_the_code_does_not_have_is_found(made_up):
    assert mistakes(made_up) != []


@pytest.mark.parametrize(
    "true",
    [
        "1. `robots/agent/safety/kernel.py`, `Kernel.tick`, and `robots/api/messages.py`, `State`.",
        "- `static/js/input/arbiter.js`, `Arbiter.offer`.",
        "- `static/js/input/key_dispatcher.js`: `keyUse`.",
        "| `run_robot` | the topic `command/velocity`, refused as `old_seq` |",
    ],
)
def test_a_name_that_the_code_has_is_not_reported(true):
    assert mistakes(true) == []


def test_every_file_that_a_contributor_is_sent_to_exists():
    page = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    named = {
        span
        for span in re.findall(r"`([^`]+)`", page)
        if PATH.fullmatch(span) and "<" not in span and "/" in span
    }
    assert len(named) > 80
    assert sorted(span for span in named if not (ROOT / span).exists()) == []
