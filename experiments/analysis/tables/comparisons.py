"""A row of a comparison: what was compared, each condition in numbers, and the test with everything
that a reader needs to check it.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from experiments.analysis.statistics.comparisons import IntervalEstimate, Test, holm
from experiments.analysis.statistics.descriptive import Spread, spread
from experiments.analysis.tables.table import (
    Table,
    TableCell,
    amount,
    count,
    number,
    probability,
    words,
)

REMARK = "Remark"
TESTED = (
    "Test",
    "n tested",
    "Statistic",
    "df",
    "df 2",
    "p",
    "p (Holm)",
    "Difference",
    "Difference: from",
    "Difference: to",
    "Effect",
    "Size",
    "Size: from",
    "Size: to",
    REMARK,
)
READ_AS = (
    "n tested: participants, or pairs for a paired test; from, to: 95 % confidence interval.",
    (
        "Difference: of means or proportions, first less second. Effect: d, the difference over the"
        " root of the mean of both variances; d_z, mean over SD of the differences; η²p, partial"
        " eta squared; W (Kendall); odds, rate and hazard ratio (second over first: above 1, times"
        " of the first are longer). Effects of several conditions have no interval."
    ),
)


@dataclass(frozen=True)
class ComparedSide:
    """A side of a comparison: a value a participant, and the sessions behind them. Times that are
    censored have no mean, and the median that is given.
    """

    values: Mapping[str, float]
    sessions: Sequence[str] = ()
    is_censored: bool = False
    median: float | None = None


def head_of(keys: Sequence[str]) -> tuple[str, ...]:
    """Return the head of `compared`, without its first word."""
    parts = ("n", "mean", "SD", "median", "IQR")
    return (*(f"{key}: {part}" for key in keys for part in parts), *TESTED)


def compared(
    label: str, groups: Sequence[ComparedSide], test: Test, corrected: float
) -> tuple[TableCell, ...]:
    """Return a row: what was compared, each group, and the test with its corrected p value."""
    cells: list[TableCell] = []
    for group in groups:
        about, ids = spread(list(group.values.values())), group.sessions
        if group.is_censored:
            about = Spread(about.n, median=group.median)
        cells += [count(about.n, ids), number(about.mean, 3, ids), number(about.sd, 3)]
        cells += [number(about.median, 2, ids), number(about.iqr, 2)]
    return words(label), *cells, *tested(test, corrected)


def tested(test: Test, corrected: float) -> tuple[TableCell, ...]:
    """Return the cells of TESTED."""
    first, second = (*test.df, None, None)[:2]
    return (
        words(test.name),
        count(test.n),
        number(test.statistic, 2),
        _freedom(first),
        _freedom(second),
        probability(test.p),
        probability(corrected),
        *estimated(test.difference, 3),
        words(test.effect_name),
        *estimated(test.effect, 2),
        words(test.remark),
    )


def estimated(estimate: IntervalEstimate, decimals: int) -> tuple[TableCell, TableCell, TableCell]:
    """Return a number and the bounds of its interval."""
    return (
        number(estimate.value, decimals),
        number(estimate.low, decimals),
        number(estimate.high, decimals),
    )


def _freedom(value: float | None) -> TableCell:
    return number(value, 0 if value is not None and value.is_integer() else 1)


Comparison = tuple[str, Test, Sequence[ComparedSide]]  # what was compared, the test, its sides


def comparison_table(
    name: str,
    title: str,
    head: str,
    keys: Sequence[str],
    found: Sequence[Comparison],
    notes: Iterable[str],
) -> Table:
    """Return a table of comparisons between the same sides, whose tests are one family.

    Args:
        name: of its files.
        title: above it.
        head: of the column that says what was compared.
        keys: the names of the sides.
        found: a row each.
        notes: below it, before what every such table says.
    """
    corrected, members = corrected_for([test for _, test, _ in found], [own for *_, own in found])
    rows = tuple(
        compared(label, own, test, p)
        for (label, test, own), p in zip(found, corrected, strict=True)
    )
    heads = (head, *head_of(keys))
    return Table(name, title, heads, rows, (*notes, family(members), *READ_AS))


def family(members: int) -> str:
    """Return the sentence on what the p values of a table are corrected for."""
    return f"p (Holm): corrected for the {amount(members, 'different test')} of this table."


def corrected_for(
    tests: Sequence[Test], rows: Sequence[Sequence[ComparedSide]]
) -> tuple[tuple[float, ...], int]:
    """Return the p values of a table, corrected by Holm's method, and how many tests the family
    has: rows of the same data are one of them.
    """
    members = [_data(groups) for groups in rows]
    values = [test.p for test in tests]
    known = {one for one, test in zip(members, tests, strict=True) if test.is_known}
    return holm(values, members), len(known)


def _data(groups: Sequence[ComparedSide]) -> Hashable:
    return tuple(tuple(sorted(group.values.items())) for group in groups)
