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
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from experiments.coding.scheme import CodedEvent

MAX_BINS = 200_000


@dataclass(frozen=True)
class Matches:
    """Events of two coders: in both within the tolerance, only in the first, only in the second."""

    both: int
    first: int
    second: int


@dataclass(frozen=True)
class PairAgreement:
    """Two coders, by their places, on one code. `kappa` is None when chance alone explains all."""

    coders: tuple[int, int]
    kappa: float | None
    matches: Matches


@dataclass(frozen=True)
class CodeAgreement:
    """All coders on one code."""

    code: str
    alpha: float | None
    pairs: tuple[PairAgreement, ...]


def cohen_kappa(table: NDArray[np.float64]) -> float | None:
    """Return kappa of a square table of counts, one judge's categories as rows and the other's as
    columns; None without counts, or when chance agreement is complete.
    """
    total = float(table.sum())
    if total == 0:
        return None
    shares = table / total
    observed = float(np.trace(shares))
    expected = float(shares.sum(axis=1) @ shares.sum(axis=0))
    return None if np.isclose(expected, 1.0) else (observed - expected) / (1.0 - expected)


def krippendorff_alpha(values: NDArray[np.float64]) -> float | None:
    """Return alpha for nominal data.

    Args:
        values: (coders, units), each category a number; nan is a missing value.

    Returns:
        None when no unit has two values, or all values are the same.
    """
    paired = values[:, (~np.isnan(values)).sum(axis=0) >= 2]
    categories = np.unique(paired[~np.isnan(paired)])
    if len(categories) < 2:
        return None
    # counts[c, u]: how many coders gave unit u the category c.
    counts = np.stack([(paired == category).sum(axis=0) for category in categories]).astype(float)
    pairable = counts.sum(axis=0)
    # o_ck = sum over units of n_uc (n_uk - [c = k]) / (m_u - 1)
    coincidences = (counts / (pairable - 1)) @ counts.T - np.diag(
        (counts / (pairable - 1)).sum(axis=1)
    )
    of_category = coincidences.sum(axis=1)
    total = of_category.sum()
    different_observed = total - np.trace(coincidences)
    different_expected = (total**2 - (of_category**2).sum()) / (total - 1)
    return float(1.0 - different_observed / different_expected)


def in_bins(
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


Session = tuple[float, Sequence[Sequence[CodedEvent] | None]]


def agreement(
    sessions: Sequence[Session], codes: Sequence[str], *, width: float, tolerance: float
) -> list[CodeAgreement]:
    """Return how coders agree on each code over several sessions.

    Args:
        sessions: duration in seconds, and the events of each coder in the same order of coders;
            None for one who did not code the session.
        codes: which codes.
        width: of a bin, s.
        tolerance: between beginnings, s.
    """
    coders = len(sessions[0][1]) if sessions else 0
    found = []
    for code in codes:
        values = _values(sessions, code, coders, width)
        pairs = tuple(
            PairAgreement(
                (a, b), _kappa_of(values[a], values[b]), _matches(sessions, a, b, code, tolerance)
            )
            for a, b in combinations(range(coders), 2)
            if _have_both(sessions, a, b)
        )
        found.append(CodeAgreement(code, krippendorff_alpha(values), pairs))
    return found


def _values(
    sessions: Sequence[Session], code: str, coders: int, width: float
) -> NDArray[np.float64]:
    """Return (coders, bins of all sessions): 1, 0, or nan where a coder did not code a session."""
    parts = [np.zeros((coders, 0))]
    for duration, codings in sessions:
        empty = np.full(len(in_bins((), code, duration, width)), np.nan)
        rows = [
            empty if events is None else in_bins(events, code, duration, width)
            for events in codings
        ]
        parts.append(np.stack(rows))
    return np.concatenate(parts, axis=1)


def _kappa_of(one: NDArray[np.float64], two: NDArray[np.float64]) -> float | None:
    known = ~(np.isnan(one) | np.isnan(two))
    table = np.array(
        [[((one == a) & (two == b) & known).sum() for b in (0, 1)] for a in (0, 1)], dtype=float
    )
    return cohen_kappa(table)


def _have_both(sessions: Sequence[Session], a: int, b: int) -> bool:
    return any(codings[a] is not None and codings[b] is not None for _d, codings in sessions)


def _matches(sessions: Sequence[Session], a: int, b: int, code: str, tolerance: float) -> Matches:
    parts = [
        matched(one, two, code, tolerance)
        for _duration, codings in sessions
        if (one := codings[a]) is not None and (two := codings[b]) is not None
    ]
    return Matches(
        sum(part.both for part in parts),
        sum(part.first for part in parts),
        sum(part.second for part in parts),
    )
