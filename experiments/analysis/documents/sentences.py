"""Tests as sentences of the APA (Publication Manual, 7th edition, 6.36 and 6.40 to 6.45): symbols
in italics, no zero before the point of what cannot exceed 1, no p below .001, intervals behind
effects.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from experiments.analysis.documents.typesetting import Run, marked, plain, runs_of
from experiments.analysis.tables.comparisons import REMARK
from experiments.analysis.tables.table import Table, TableCell

RowKey = tuple[str, str, str]  # the table, measure and contrast or effect of a declared test
Decisions = Mapping[RowKey, Sequence[tuple[str, float]]]  # hypotheses with p in their families
NO_DECISIONS: Decisions = MappingProxyType({})
Cells = Mapping[str, TableCell]
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
# Symbols inside the names of methods, which are in italics, too.
_ITALIC = re.compile(r"\b([tF])\b(?= test)")
NEEDED = frozenset({"Test", "Statistic", "p", REMARK})


@dataclass(frozen=True)
class Sentence:
    """The result of a test in a table, and the plan's hypothesis that it decides on, if any."""

    table: str
    runs: tuple[Run, ...]
    hypothesis: str = ""

    @property
    def text(self) -> str:
        return plain(self.runs)


def sentences_of(
    table: Table, alpha: float, decisions: Decisions = NO_DECISIONS
) -> Iterator[Sentence]:
    """Yield a sentence for each test of a table, and for each hypothesis that it decides on."""
    if not set(table.head) >= NEEDED:
        return
    for row in table.rows:
        cells = dict(zip(table.head, row, strict=True))
        if cells["Test"].text in METHODS and cells["p"].value is not None:
            for key, p in decisions.get(key_of(table, cells), (("", math.nan),)):
                yield Sentence(table.name, runs_of(_sentence(table, cells, alpha, key, p)), key)


def key_of(table: Table, cells: Mapping[str, TableCell]) -> RowKey:
    """Return what names a test: its table, its measure, and its contrast or effect."""
    named = [cells[head].text for head in ("Measure", "Contrast", "Effect") if head in cells]
    measure, label, *_ = (*named, "", "")
    return table.name, measure, label


def _sentence(table: Table, cells: Cells, alpha: float, hypothesis: str, in_family: float) -> str:
    method, sign = METHODS[cells["Test"].text]
    method = _ITALIC.sub(lambda found: marked(found[0]), method)
    p_values: dict[str, float] = {
        name: value
        for name in ("p", "p (Holm)")
        if name in cells and (value := cells[name].value) is not None
    }
    if hypothesis:
        p_values = {"p": p_values["p"], "p (family)": in_family}
    names = [name for name in table.head[: table.head.index("Test")] if ":" not in name]
    label = ", ".join(cells[name].text for name in names if cells[name].value is None)
    parts = [
        f"{label}: {method}{_claim(cells, sign, is_found=[*p_values.values()][-1] < alpha)}",
        _statistic(cells, sign),
        *(f"{marked(name)} {probability(value)}" for name, value in p_values.items()),
        *_effect(cells),
    ]
    return f"{', '.join([hypothesis, *parts] if hypothesis else parts)}."


def _claim(cells: Cells, sign: str, *, is_found: bool) -> str:
    """Return whether there is a difference, and the mean and SD of each condition."""
    groups = [name.removesuffix(": mean") for name in cells if name.endswith(": mean")]
    what = "relation" if sign == "ρ" else "difference" if groups else "effect"
    text = f" showed {'a' if is_found else 'no'} significant {what}"
    described = []
    for one in groups:
        mean, sd = cells[f"{one}: mean"].value, cells[f"{one}: SD"].value
        if mean is not None and f"{one}: left out" not in cells[REMARK].text:
            numbers = f"{marked('M')} = {_number(mean, 2)}, {marked('SD')} = {_number(sd, 2)}"
            described.append(f"{one} ({numbers})")
    *others, last = described or [""]
    listed = " and ".join(filter(None, (", ".join(others), last)))
    return f"{text} between {listed}" if listed else text


def _statistic(cells: Cells, sign: str) -> str:
    degrees = [
        f"{value:.0f}" if value.is_integer() else f"{value:.2f}"
        for name in ("df", "df 2")
        if name in cells and (value := cells[name].value) is not None
    ]
    n = cells["n tested"].value if "n tested" in cells else None
    people = "" if n is None else f", {marked('N')} = {n:.0f}"
    text = marked(sign)
    if degrees:
        text += f"({', '.join(degrees)}{people if sign in {'χ²', 'H', 'Q'} else ''})"
    text += f" = {_number(cells['Statistic'].value, 2, bounded=sign in BOUNDED)}"
    return text if degrees else f"{text}{people}"


def _effect(cells: Cells) -> Iterator[str]:
    name = cells["Effect"].text if "Effect" in cells else ""
    size = cells["Size"].value if "Size" in cells else None
    if size is None:
        return
    bounded = name in BOUNDED
    if name != "ρ":  # else it is the statistic itself
        yield f"{marked(name)} = {_number(size, 2, bounded=bounded)}"
    low, high = cells["Size: from"].value, cells["Size: to"].value
    if low is not None and high is not None:
        bounds = ", ".join(_number(one, 2, bounded=bounded) for one in (low, high))
        yield f"95% CI [{bounds}]"


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
