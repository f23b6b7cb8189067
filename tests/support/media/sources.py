"""The sources of the project, each read once in a process. To parse one takes a hundred times as
long as to search its text, so a test parses only those that have the words that it is after.
"""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.support.paths import ROOT

PACKAGES = ("accounts", "experiments", "robots", "sessions", "surveys", "telepresence_site")
# Prefixes of lines of a comment: of Python, of JavaScript, and of a block of JavaScript.
SIGN = re.compile(r"\s+(?:(?:\*|#|//)\s+)?")
DOCSTRING = re.compile(r'"""(.*?)"""', re.DOTALL)
COMMENTS = {
    ".py": re.compile(r"(?:^|\s)# (.+(?:\n\s*# .+)*)"),
    ".js": re.compile(r"(?:^|\s)// (.+(?:\n\s*// .+)*)"),
}
BLOCK = re.compile(r"/\*(.*?)\*/", re.DOTALL)


@cache
def text_of(path: Path) -> str:
    return path.read_text("utf-8")


@cache
def python_files(place: str) -> tuple[Path, ...]:
    """Return a file, or the files in a folder, by its path in the repository."""
    path = ROOT / place
    return (path,) if path.suffix == ".py" else tuple(sorted(path.rglob("*.py")))


@cache
def scripts(place: str) -> tuple[Path, ...]:
    """Return the scripts in a folder, by its path in the repository."""
    return tuple(sorted((ROOT / place).rglob("*.js")))


@cache
def notes(path: Path) -> tuple[str, ...]:
    """Return the comments and docstrings of a source, each in one line."""
    text = text_of(path)
    block = DOCSTRING if path.suffix == ".py" else BLOCK
    found = [*COMMENTS[path.suffix].findall(text), *block.findall(text)]
    return tuple(SIGN.sub(" ", note).strip() for note in found)


def code(path: Path) -> str:
    """Return a source without its comments and docstrings."""
    block = DOCSTRING if path.suffix == ".py" else BLOCK
    return COMMENTS[path.suffix].sub(" ", block.sub(" ", text_of(path)))


def names_of_tests(path: Path) -> Iterator[str]:
    """Yield the names of a source's tests as sentences."""
    if path.suffix == ".py":
        yield from (name.replace("_", " ") for name in re.findall(r"def test_(\w+)", text_of(path)))
    else:
        yield from re.findall(r"""^\s*test\(["'](.+)["']""", text_of(path), re.MULTILINE)
