"""The tests of a table as sentences in the style of the APA (Publication Manual, 7th edition,
sections 6.36 and 6.40 to 6.45): symbols in italics, no zero before the point of what cannot exceed
1, p with three decimals and nothing below .001, and an interval behind each effect.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from experiments.analysis.documents.runs import Run, plain, symbol
from experiments.analysis.tables.comparisons import REMARK
from experiments.analysis.tables.table import Table, TableCell

RowKey = tuple[str, str, str]  # the table, measure and contrast or effect of a declared test
Decisions = Mapping[RowKey, Sequence[tuple[str, float]]]  # hypotheses with p in their families
NO_DECISIONS: Decisions = MappingProxyType({})
LEAST_P = 0.001
# What cannot exceed 1: it is written without a zero before the point.
BOUNDED = frozenset({"r", "ρ", "W (Kendall)", "η²p", "ε²"})
METHODS = {
    "paired t": ("A paired t test", "t"),
    "Welch t": ("A Welch t test", "t"),
    "Welch F": ("A Welch analysis of variance", "F"),
    "repeated-measures F": ("An analysis of variance for repeated measures", "F"),
    "Wald F": ("A Wald F test in a linear mixed model", "F"),
    "score F (logistic)": ("A score test in a logistic regression", "F"),
    "score F (Poisson)": ("A score test in a Poisson regression", "F"),
    "score F (Cox)": ("A score test in a Cox regression", "F"),
    "log-rank χ²": ("A log-rank test", "χ²"),
    "N−1 χ²": ("An N−1 χ² test of proportions", "χ²"),
    "Boschloo": ("Boschloo’s exact test", "statistic"),
    "McNemar mid-p": ("A McNemar test (mid-p)", "b"),
    "Cochran Q": ("Cochran’s test", "Q"),
    "Friedman χ²": ("A Friedman test", "χ²"),
    "Kruskal-Wallis H": ("A Kruskal-Wallis test", "H"),
    "Mann-Whitney U": ("A Mann-Whitney test", "U"),
    "Wilcoxon signed rank": ("A Wilcoxon signed-rank test", "V"),
    "Spearman ρ": ("Spearman’s rank correlation", "ρ"),
}
# Symbols inside the names of methods are set in italics, too.
_ITALIC = re.compile(r"\b([tF])\b(?= test)")
NEEDED = frozenset({"Test", "Statistic", "p", REMARK})


@dataclass(frozen=True)
class Sentence:
    """What a test found, in which table it is, and the hypothesis of the plan that it decides on;
    without one it is exploratory.
    """

    table: str
    runs: tuple[Run, ...]
    hypothesis: str = ""

    @property
    def text(self) -> str:
        """The sentence without italics."""
        return plain(self.runs)


def sentences_of(
    table: Table, alpha: float, decisions: Decisions = NO_DECISIONS
) -> Iterator[Sentence]:
    """Yield a sentence for each row of a table that has a test, and for each hypothesis that it
    decides on; none for other tables.

    Args:
        table: of a report.
        alpha: the level of significance.
        decisions: of declared tests, the hypotheses of the plan and p as corrected in their family.
    """
    if not set(table.head) >= NEEDED:
        return
    for row in table.rows:
        cells = dict(zip(table.head, row, strict=True))
        if cells["Test"].text in METHODS and cells["p"].value is not None:
            for key, p in decisions.get(key_of(table, cells), (("", math.nan),)):
                yield Sentence(table.name, tuple(_sentence(table, cells, alpha, key, p)), key)


def key_of(table: Table, cells: Mapping[str, TableCell]) -> RowKey:
    """Return what names a test: its table, its measure, and its contrast or effect."""
    named = [cells[head].text for head in ("Measure", "Contrast", "Effect") if head in cells]
    measure, label, *_ = (*named, "", "")
    return table.name, measure, label


def _sentence(
    table: Table, cells: dict[str, TableCell], alpha: float, hypothesis: str, in_family: float
) -> Iterator[Run]:
    method, letter = METHODS[cells["Test"].text]
    probabilities: dict[str, float] = {
        name: value
        for name in ("p", "p (Holm)")
        if name in cells and (value := cells[name].value) is not None
    }
    if hypothesis:
        probabilities = {"p": probabilities["p"], "p (family)": in_family}
        yield Run(f"{hypothesis}, ")
    yield Run(f"{_label(table, cells)}: ")
    yield from _method(method)
    yield from _claim(cells, letter, is_found=[*probabilities.values()][-1] < alpha)
    yield Run(", ")
    yield from _statistic(cells, letter)
    for name, value in probabilities.items():
        yield from (Run(", "), *symbol(name), Run(f" {probability(value)}"))
    yield from _effect(cells)
    yield Run(".")


def _label(table: Table, cells: dict[str, TableCell]) -> str:
    """Return what was tested: the words in front of the numbers."""
    names = [name for name in table.head[: table.head.index("Test")] if ":" not in name]
    return ", ".join(cells[name].text for name in names if cells[name].value is None)


def _method(text: str) -> Iterator[Run]:
    at = 0
    for found in _ITALIC.finditer(text):
        yield Run(text[at : found.start()])
        yield Run(found[0], italic=True)
        at = found.end()
    yield Run(text[at:])


def _claim(cells: dict[str, TableCell], letter: str, *, is_found: bool) -> Iterator[Run]:
    """Say whether there is a difference, and what each condition was like."""
    what = "relation" if letter == "ρ" else "difference" if _groups_in(cells) else "effect"
    yield Run(f" showed {'a' if is_found else 'no'} significant {what}")
    left_out = cells[REMARK].text
    described = [
        one
        for one in _groups_in(cells)
        if cells[f"{one}: mean"].value is not None and f"{one}: left out" not in left_out
    ]
    if described:
        yield Run(" between ")
        yield from _groups(described, cells)


def _groups_in(cells: dict[str, TableCell]) -> list[str]:
    return [name.removesuffix(": mean") for name in cells if name.endswith(": mean")]


def _groups(names: list[str], cells: dict[str, TableCell]) -> Iterator[Run]:
    for place, name in enumerate(names):
        if place:
            yield Run(" and " if place == len(names) - 1 else ", ")
        yield Run(f"{name} (")
        yield from _equal("M", _number(cells[f"{name}: mean"].value, 2))
        yield Run(", ")
        yield from _equal("SD", _number(cells[f"{name}: SD"].value, 2))
        yield Run(")")


def _statistic(cells: dict[str, TableCell], letter: str) -> Iterator[Run]:
    degrees = [
        _degrees(cell.value)
        for name in ("df", "df 2")
        if (cell := cells.get(name)) is not None and cell.value is not None
    ]
    n = cells["n tested"].value if "n tested" in cells else None
    yield from symbol(letter)
    if degrees:
        yield Run(f"({', '.join(degrees)}")
        if letter in {"χ²", "H", "Q"} and n is not None:
            yield from (Run(", "), *_equal("N", f"{n:.0f}"))
        yield Run(")")
    yield Run(f" = {_number(cells['Statistic'].value, 2, bounded=letter in BOUNDED)}")
    if not degrees and n is not None:
        yield from (Run(", "), *_equal("N", f"{n:.0f}"))


def _degrees(value: float) -> str:
    return f"{value:.0f}" if value.is_integer() else f"{value:.2f}"


def _effect(cells: dict[str, TableCell]) -> Iterator[Run]:
    name = cells["Effect"].text if "Effect" in cells else ""
    size = cells["Size"].value if "Size" in cells else None
    if size is None:
        return
    bounded = name in BOUNDED
    if name != "ρ":  # else it is the statistic itself
        yield from (Run(", "), *symbol(name), Run(f" = {_number(size, 2, bounded=bounded)}"))
    low, high = cells["Size: from"].value, cells["Size: to"].value
    if low is not None and high is not None:
        bounds = ", ".join(_number(one, 2, bounded=bounded) for one in (low, high))
        yield Run(f", 95% CI [{bounds}]")


def _equal(name: str, value: str) -> Iterable[Run]:
    return (*symbol(name), Run(f" = {value}"))


def probability(value: float) -> str:
    """Return the sign and the number of a p value: `= .024`, `< .001`, `> .999`."""
    if value < LEAST_P:
        return "< .001"
    text = f"{value:.3f}"
    return "> .999" if text == "1.000" else f"= {text.removeprefix('0')}"


def _number(value: float | None, decimals: int, *, bounded: bool = False) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{abs(value):.{decimals}f}"
    sign = "−" if value < 0.0 and float(text) > 0.0 else ""
    return f"{sign}{text.removeprefix('0') if bounded else text}"
