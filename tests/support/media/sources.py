"""The sources of the project, each read once in a process. To parse one takes a hundred times as
long as to search its text, so a test parses only those that have the words that it is after.
"""

from functools import cache
from pathlib import Path

from tests.support.paths import ROOT

PACKAGES = ("accounts", "experiments", "robots", "sessions", "surveys", "telepresence_site")


@cache
def text_of(path: Path) -> str:
    return path.read_text("utf-8")


@cache
def python_files(place: str) -> tuple[Path, ...]:
    """Return a file, or the files in a folder, by its path in the repository."""
    path = ROOT / place
    return (path,) if path.suffix == ".py" else tuple(sorted(path.rglob("*.py")))
