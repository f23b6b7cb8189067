"""A row of a comparison: what was compared, each condition in numbers, and the test."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from experiments.analysis.statistics.comparisons import IntervalEstimate, Test, holm
from experiments.analysis.statistics.descriptive import Spread, spread
from experiments.analysis.tables.table import Cells, Table, amount, count, number, probability
from experiments.dataset.grouping import by_key

REMARK = "Remark"
DIFFERENCE = ("Difference", "Difference: from", "Difference: to")
TESTED = (
    *("Test", "n tested", "Statistic", "df", "df 2", "p", "p (Holm)", *DIFFERENCE),
    *("Effect", "Size", "Size: from", "Size: to", REMARK),
)
READ_AS = (
    "n tested: participants, or pairs for a paired test; from, to: 95 % confidence interval.",
    (
        "Difference: of means or proportions, first less second. Effect: d, the difference over the"
        " root of the mean of both variances; d_z, mean over SD of the differences; η²p, partial"
        " eta squared; W (Kendall); odds and rate ratio, first over second; hazard ratio, second"
        " over first, so that it is above 1 where times of the first are longer. Effects of several"
        " conditions have no interval."
    ),
)


@dataclass(frozen=True)
class ComparedSide:
    """A value a participant, and the sessions behind them. Censored times have no mean."""

    values: Mapping[str, float]
    sessions: Sequence[str] = ()
    is_censored: bool = False
    median: float | None = None


def participant_means(values: Iterable[tuple[str, float]]) -> dict[str, float]:
    return {who: math.fsum(own) / len(own) for who, own in by_key(values).items()}


def head_of(keys: Sequence[str]) -> tuple[str, ...]:
    parts = ("n", "mean", "SD", "median", "IQR")
    return (*(f"{key}: {part}" for key in keys for part in parts), *TESTED)


def compared(label: str, groups: Sequence[ComparedSide], test: Test, corrected: float) -> Cells:
    cells: list[object] = [label]
    for group in groups:
        about, ids = spread(list(group.values.values())), group.sessions
        if group.is_censored:
            about = Spread(about.n, median=group.median)
        cells += [count(about.n, ids), number(about.mean, 3, ids), number(about.sd, 3)]
        cells += [number(about.median, 2, ids), number(about.iqr, 2)]
    return *cells, *tested(test, corrected)


def tested(test: Test, corrected: float) -> Cells:
    degrees = (*test.df, None, None)[:2]
    return (
        *(test.name, count(test.n), number(test.statistic, 2)),
        *(number(one, 0 if one is not None and one.is_integer() else 1) for one in degrees),
        *(probability(test.p), probability(corrected), *estimated(test.difference, 3)),
        *(test.effect_name, *estimated(test.effect, 2), test.remark),
    )


def estimated(estimate: IntervalEstimate, decimals: int) -> Cells:
    return tuple(number(one, decimals) for one in (estimate.value, estimate.low, estimate.high))


Compared = tuple[Test, Sequence[ComparedSide]]  # a test, and the sides that it compares


def comparison_table(
    name: str,
    title: str,
    head: str,
    keys: Sequence[str],
    found: Sequence[tuple[str, Compared]],
    notes: Iterable[str],
) -> Table:
    """Return a table of comparisons between the same sides, whose tests are one family: `head`
    names the column of what was compared, `keys` are the sides, and `found` has a row each.
    """
    corrected, members = corrected_for([one for _, one in found])
    rows = (
        compared(label, own, test, p)
        for (label, (test, own)), p in zip(found, corrected, strict=True)
    )
    return Table.of(name, title, (head, *head_of(keys)), rows, (*notes, family(members), *READ_AS))


def family(members: int) -> str:
    return f"p (Holm): corrected for the {amount(members, 'different test')} of this table."


def corrected_for(found: Sequence[Compared]) -> tuple[tuple[float, ...], int]:
    """Return p values corrected by Holm's method, and the number of tests in the family: rows of
    the same data are one.
    """
    members = [tuple(tuple(sorted(one.values.items())) for one in own) for _, own in found]
    known = {one for one, (test, _) in zip(members, found, strict=True) if test.is_known}
    return holm([test.p for test, _ in found], members), len(known)
