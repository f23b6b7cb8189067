"""Text with italics, subscripts and superscripts, as statistical symbols are set in print."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Position = Literal["", "sub", "super"]


@dataclass(frozen=True)
class Run:
    """A piece of text that is set in one way."""

    text: str
    italic: bool = False
    position: Position = ""


# Symbols as the APA sets them: Latin letters in italics, Greek ones and subscripts that are words
# upright (Publication Manual, 7th edition, section 6.44).
SYMBOLS: dict[str, tuple[Run, ...]] = {
    "p (Holm)": (Run("p", italic=True), Run("Holm", position="sub")),
    "p (family)": (Run("p", italic=True), Run("family", position="sub")),
    "d_z": (Run("d", italic=True), Run("z", italic=True, position="sub")),
    "η²p": (Run("η"), Run("2", position="super"), Run("p", italic=True, position="sub")),
    "W (Kendall)": (Run("W", italic=True),),
    "ρ": (Run("r", italic=True), Run("s", italic=True, position="sub")),
    "ε²": (Run("ε"), Run("2", position="super")),
    "χ²": (Run("χ"), Run("2", position="super")),
    **{one: (Run(one, italic=True),) for one in ("p", "t", "F", "n", "N", "M", "SD", "SE", "d")},
    **{one: (Run(one, italic=True),) for one in ("r", "df", "Mdn", "W", "U", "H", "V", "z")},
}
# What those symbols are called as heads of columns.
_HEADS = {"mean": "M", "Mean": "M", "median": "Mdn", "Median": "Mdn", "df 2": "df"}


def symbol(name: str) -> tuple[Run, ...]:
    """Return a symbol as it is set; another word unchanged."""
    return SYMBOLS.get(name, (Run(name),))


def head_runs(name: str) -> tuple[Run, ...]:
    """Return the head of a column: `slow: mean` is the mean's symbol after the condition."""
    before, colon, last = name.rpartition(": ")
    last = _HEADS.get(last, last)
    second = (Run("2", position="sub"),) if name == "df 2" else ()
    return (*((Run(f"{before}{colon}"),) if colon else ()), *symbol(last), *second)


def plain(runs: Iterable[Run]) -> str:
    """Return the text as letters alone: `d_z`, `χ²`, `η²p`."""
    joined = "".join(_letters(run) for run in runs)
    return re.sub(r"²_p", "²p", joined)


def _letters(run: Run) -> str:
    if run.position == "sub":
        return f"_{run.text}"
    return "²" if run.position == "super" and run.text == "2" else run.text
