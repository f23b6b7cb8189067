"""How well coders agree. Pure: numbers in, numbers out.

Time is cut into bins of one declared width. In each bin a coder either coded a code or did not: an
interval counts in the bins whose middle it covers, a point in the bin that it lies in. Bins are the
units, coders the judges, and each code is a variable of its own with two values.

- Cohen's kappa (Cohen, 1960, "A coefficient of agreement for nominal scales", Educational and
  Psychological Measurement 20, 37-46): (p_o - p_e) / (1 - p_e).
- Krippendorff's alpha for nominal data, any number of coders and missing values (Krippendorff,
  2011, "Computing Krippendorff's Alpha-Reliability"): 1 - D_o / D_e from the matrix of
  coincidences.
- Beside them, how many events of two coders lie within a tolerance of each other (their beginnings
  do), each matched once, in order of time.

Events of two coders are aligned: first those of one code that match, then the nearest of what is
left, which the coders took for different codes; the rest only one of them has. Nobody can count the
events that both left out, so the cell (none, none) is a structural zero, and kappa takes its
expected shares from quasi-independence (Bakeman, Quera and Gnisci, 2009, "Observer agreement for
timed-event sequential data", Behavior Research Methods 41, 137-147). Without such a cell this is
Cohen's kappa.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.coding.scheme import CodedEvent

MAX_BINS = 200_000
FITTING_ROUNDS = 200
TINY = 1e-12

Floats = NDArray[np.float64]
Units = NDArray[np.int64]
# Duration in seconds, and the events of each coder in the same order of coders; None for one who
# did not code the session.
SessionCodings = tuple[float, Sequence[Sequence[CodedEvent] | None]]


@dataclass(frozen=True)
class Matches:
    """Events of two coders: in both within the tolerance, only in the first, only in the second."""

    both: int
    first: int
    second: int


# --- figures --------------------------------------------------------------------------------------


class Sums(NamedTuple):
    """What kappa and alpha need of n tables (or matrices of coincidences) of k categories:
    `agreed` is (n,), the diagonal's sum; `rows` and `columns` are (n, k), the marginal sums.
    """

    agreed: Floats
    rows: Floats
    columns: Floats


def sums_of(tables: Floats) -> Sums:
    """Return the sums of square tables, one judge's categories as rows and the other's as columns:
    (n, k, k).
    """
    return Sums(np.trace(tables, axis1=1, axis2=2), tables.sum(axis=2), tables.sum(axis=1))


def agreements(sums: Sums) -> Floats:
    """Return the share of units on which two judges agree: (n,), nan without units."""
    return ratio(sums.agreed, sums.rows.sum(axis=1))


def kappas(sums: Sums) -> Floats:
    """Return Cohen's kappa: (n,), nan without units, or when chance agreement is complete."""
    expected = ratio((sums.rows * sums.columns).sum(axis=1), sums.rows.sum(axis=1) ** 2)
    return ratio(agreements(sums) - expected, 1.0 - expected)


def alphas(sums: Sums) -> Floats:
    """Return Krippendorff's alpha of matrices of coincidences: (n,), nan without pairs, or when all
    values are the same.
    """
    total = sums.rows.sum(axis=1)
    expected = ratio(total**2 - (sums.rows**2).sum(axis=1), total - 1.0)
    return 1.0 - ratio(total - sums.agreed, expected)


def event_kappas(tables: Floats) -> Floats:
    """Return kappa of tables whose last cell is a structural zero: the expected shares are those of
    quasi-independence, by iterative proportional fitting.
    """
    fitted = np.ones_like(tables)
    fitted[:, -1, -1] = 0.0
    rows, columns = tables.sum(axis=2), tables.sum(axis=1)
    for _ in range(FITTING_ROUNDS):
        fitted *= np.nan_to_num(ratio(rows, fitted.sum(axis=2)))[:, :, None]
        fitted *= np.nan_to_num(ratio(columns, fitted.sum(axis=1)))[:, None, :]
    expected = agreements(sums_of(fitted))
    return ratio(agreements(sums_of(tables)) - expected, 1.0 - expected)


def ratio(above: Floats, below: Floats) -> Floats:
    """Return quotients, nan where the divisor is nothing."""
    fit = np.abs(below) > TINY
    quotient: Floats = np.where(fit, above / np.where(fit, below, 1.0), np.nan)
    return quotient


def block_sums(values: Units, block: Units, shape: tuple[int, int]) -> Sums:
    """Return the sums of the table of two coders in each block.

    Args:
        values: (2, units) the categories from 0; -1 is a missing value.
        block: (units,) the number of each unit's block, from 0.
        shape: how many blocks and categories there are.
    """
    known = (values >= 0).all(axis=0)
    one, two, at = values[0][known], values[1][known], block[known]
    sums = Sums(np.zeros(shape[0]), np.zeros(shape), np.zeros(shape))
    np.add.at(sums.agreed, at, one == two)
    np.add.at(sums.rows, (at, one), 1.0)
    np.add.at(sums.columns, (at, two), 1.0)
    return sums


def block_coincidences(values: Units, block: Units, shape: tuple[int, int]) -> Sums:
    """Return the sums of the matrix of coincidences of each block, as `block_sums` of all coders:
    two values of a unit that has m of them count 1 / (m - 1), in either order.
    """
    valued = (values >= 0).sum(axis=0)
    sums = Sums(np.zeros(shape[0]), np.zeros(shape), np.zeros(shape))
    for one, two in combinations(values, 2):
        known = (one >= 0) & (two >= 0)
        share, at = 1.0 / (valued[known] - 1), block[known]
        np.add.at(sums.agreed, at, 2.0 * share * (one[known] == two[known]))
        for value in (one[known], two[known]):
            np.add.at(sums.rows, (at, value), share)
            np.add.at(sums.columns, (at, value), share)
    return sums


# --- bins -----------------------------------------------------------------------------------------


def coded_bins(
    events: Sequence[CodedEvent], code: str, duration: float, width: float
) -> NDArray[np.float64]:
    """Return 1 for each bin in which the code was coded, else 0; (bins,).

    Args:
        events: of one coder.
        code: which of them count.
        duration: of the session, s.
        width: of a bin, s.

    Raises:
        ValueError: the width is not positive, or makes too many bins.
    """
    if not width > 0:
        raise ValueError("a bin needs a width")
    count = max(int(np.ceil(duration / width - 1e-9)), 1)
    if count > MAX_BINS:
        raise ValueError(f"{count} bins are too many; make them wider")
    found = np.zeros(count)
    middles = (np.arange(count) + 0.5) * width
    for event in events:
        if event.code != code:
            continue
        if event.end is None:
            found[min(int(event.begin / width + 1e-9), count - 1)] = 1.0
        else:
            found[(middles >= event.begin) & (middles < event.end)] = 1.0
    return found


# --- events ---------------------------------------------------------------------------------------


def matched(
    first: Sequence[CodedEvent], second: Sequence[CodedEvent], code: str, tolerance: float
) -> Matches:
    """Return how many events of a code two coders have in common: beginnings at most `tolerance`
    seconds apart, the earliest pairs first.
    """
    one, two = (
        sorted(event.begin for event in events if event.code == code) for events in (first, second)
    )
    i = j = both = 0
    while i < len(one) and j < len(two):
        if abs(one[i] - two[j]) <= tolerance + 1e-9:
            both, i, j = both + 1, i + 1, j + 1
        elif one[i] < two[j]:
            i += 1
        else:
            j += 1
    return Matches(both, len(one) - both, len(two) - both)


def aligned(
    first: Sequence[CodedEvent], second: Sequence[CodedEvent], tolerance: float
) -> list[tuple[str, str]]:
    """Return the events of two coders as pairs of codes, "" where one of them has none: first those
    of one code as in `matched`, then the nearest of the others, within the tolerance.
    """
    pairs: list[tuple[str, str]] = []
    left: list[CodedEvent] = []
    right: list[CodedEvent] = []
    for code in sorted({event.code for event in (*first, *second)}):
        one, two = (
            sorted((event for event in events if event.code == code), key=lambda e: e.begin)
            for events in (first, second)
        )
        i = j = 0
        while i < len(one) and j < len(two):
            if abs(one[i].begin - two[j].begin) <= tolerance + 1e-9:
                pairs.append((code, code))
                i, j = i + 1, j + 1
            elif one[i].begin < two[j].begin:
                left.append(one[i])
                i += 1
            else:
                right.append(two[j])
                j += 1
        left += one[i:]
        right += two[j:]
    return [*pairs, *_confused(left, right, tolerance)]


def _confused(
    left: Sequence[CodedEvent], right: Sequence[CodedEvent], tolerance: float
) -> Iterator[tuple[str, str]]:
    """Yield events of different codes that lie near each other, and those that nobody else has."""
    right = sorted(right, key=lambda event: event.begin)
    begins = [event.begin for event in right]
    near = []
    for i, one in enumerate(left):
        first = bisect_left(begins, one.begin - tolerance - 1e-9)
        last = bisect_right(begins, one.begin + tolerance + 1e-9)
        near += [
            (abs(one.begin - begins[j]), i, j)
            for j in range(first, last)
            if one.code != right[j].code
        ]
    ones, twos = set(range(len(left))), set(range(len(right)))
    for _distance, i, j in sorted(near):
        if i in ones and j in twos:
            ones.discard(i)
            twos.discard(j)
            yield left[i].code, right[j].code
    yield from ((left[i].code, "") for i in ones)
    yield from (("", right[j].code) for j in twos)


def matched_in(
    sessions: Sequence[SessionCodings],
    pair: tuple[int, int],
    codes: Sequence[str],
    tolerance: float,
) -> Matches:
    """Return the matches of two coders on some codes in several sessions."""
    parts = [
        matched(one, two, code, tolerance)
        for _duration, codings in sessions
        if (one := codings[pair[0]]) is not None and (two := codings[pair[1]]) is not None
        for code in codes
    ]
    return Matches(
        sum(part.both for part in parts),
        sum(part.first for part in parts),
        sum(part.second for part in parts),
    )
