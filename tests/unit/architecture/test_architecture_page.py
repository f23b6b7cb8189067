"""Every name in backticks in docs/explanation/architecture.md exists, in the file named before it.

A paragraph, a list item and a row of a table are a block each. In a block a name belongs to the
file or folder named last before it; without one it may be anywhere in our code. Python is parsed;
in JavaScript a declaration is looked for. What is no name, and does not follow a path directly, has
to be a string of the code, such as a topic or the reason of a refusal, or a command.
"""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from tests.support.paths import ROOT

PAGE = (ROOT / "docs/explanation/architecture.md").read_text("utf-8")
PACKAGES = (
    "accounts",
    "experiments",
    "robots",
    "sessions",
    "surveys",
    "telepresence_site",
)
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
        word not in strings()
    )


def is_said(word: str) -> bool:
    """Tell whether the code has a string such as a topic, a reason, an option or a command."""
    pattern = re.sub(r"<\w+>", "+", word)
    commands = {path.stem for path in ROOT.glob("*/management/commands/*.py")}
    return pattern in strings() | commands | TOOLS or f"{pattern}/reply" in strings()


# --- the code -------------------------------------------------------------------------------------


def is_declared(name: str, home: str) -> bool:
    """Tell whether a name, such as `Kernel.tick`, is declared in a file or folder, or anywhere."""
    if home.endswith(".js"):
        return in_javascript(name, (ROOT / home).read_text("utf-8"))
    folders = PACKAGES if not (ROOT / home).exists() or home == "" else (home,)
    return any(name in declared(path) for folder in folders for path in python_files(folder)) or (
        home == "" and name in PACKAGES
    )


@cache
def python_files(place: str) -> tuple[Path, ...]:
    path = ROOT / place
    return (path,) if path.suffix == ".py" else tuple(sorted(path.rglob("*.py")))


@cache
def declared(path: Path) -> frozenset[str]:
    """Return what a module declares: classes, functions and values, and members as `Class.name`."""
    return frozenset(declared_in(ast.parse(path.read_text("utf-8")).body))


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
    """Tell whether a script declares a class, a function or a value, or a method as `Class.name`."""
    owner, _, member = name.rpartition(".")
    if owner:
        inside = re.search(rf"^export class {owner}\b.*?^}}", source, re.MULTILINE | re.DOTALL)
        return inside is not None and is_method(member, inside[0])
    declares = rf"^(?:export )?(?:class|const|function|async function) {name}\b"
    return re.search(declares, source, re.MULTILINE) is not None


def is_method(name: str, source: str) -> bool:
    return re.search(rf"^  (?:async |get |static )?{name}\(", source, re.MULTILINE) is not None


@cache
def strings() -> frozenset[str]:
    """Return every string in our Python, and every key and string in the page's scripts."""
    found = {
        node.value
        for package in PACKAGES
        for path in python_files(package)
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
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
