"""Agreement of coders. By time, the units are bins of one declared width, coders the judges, and
each code is a variable with two values: an interval counts in the bins whose middle it covers, a
point in its own bin. For all codes together, the value of a bin is the set of codes in it.

- Cohen's kappa (Cohen, 1960, "A coefficient of agreement for nominal scales", Educational and
  Psychological Measurement 20, 37-46): (p_o - p_e) / (1 - p_e).
- Krippendorff's alpha for nominal data, any number of coders and missing values (Krippendorff,
  2011, "Computing Krippendorff's Alpha-Reliability"): 1 - D_o / D_e from the matrix of
  coincidences.

By events, the units are the events of two coders, aligned (alignment.py). Events that both omitted
cannot be counted, so the cell (none, none) is a structural zero, and the expected shares of kappa
are those of quasi-independence (Bakeman, Quera and Gnisci, 2009, "Observer agreement for
timed-event sequential data", Behavior Research Methods 41, 137-147). Without such a cell this is
Cohen's kappa.

Bins and events of one session depend on each other, so confidence intervals resample sessions: they
are those of the jackknife that leaves out one session at a time, with Student's t on Fisher's z
(Efron and Tibshirani, 1993, An Introduction to the Bootstrap, chapter 11). They describe other
sessions of the same coders. Of a single session, parts of BLOCK_S seconds are left out.

Alpha and the kappa of events are formulas of the summed tables: the package krippendorff needs an
array of units × values × values, which is too large for the sets of codes of a whole study.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from experiments.coding.alignment import aligned, matched
from experiments.coding.scheme import CodedEvent

MAX_BINS = 200_000
FITTING_ROUNDS = 200
TINY = 1e-12
BLOCK_S = 30.0
LEAST_CLUSTERS = 5  # sessions, or blocks of one
LEVEL = 0.95

Floats = NDArray[np.float64]
Units = NDArray[np.int64]
Pair = tuple[int, int]
# Duration in seconds, and the events of each coder in the same order of coders; None for one who
# did not code the session.
SessionCodings = tuple[float, Sequence[Sequence[CodedEvent] | None]]


@dataclass(frozen=True)
class Matches:
    """Numbers of events: of both coders within the tolerance, and of each coder alone."""

    both: int = 0
    first: int = 0
    second: int = 0


@dataclass(frozen=True)
class ReliabilityEstimate:
    """A value and its 95 % confidence interval; None where it is not defined."""

    value: float | None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class PairReliability:
    """Two coders, by their places. `agreement` is the share of bins in which they say the same."""

    coders: Pair
    agreement: ReliabilityEstimate
    kappa: ReliabilityEstimate
    matches: Matches


@dataclass(frozen=True)
class CodeReliability:
    """All coders on one code; "" is all codes together. `bins` is how many have two values."""

    code: str
    bins: int
    alpha: ReliabilityEstimate
    pairs: tuple[PairReliability, ...]


@dataclass(frozen=True)
class EventReliability:
    """Two coders' aligned events: `table` is (codes + 1, codes + 1), the first coder's by the
    second's.
    """

    coders: Pair
    labels: tuple[str, ...]
    table: Floats
    kappa: ReliabilityEstimate


@dataclass(frozen=True)
class Reliability:
    codes: tuple[CodeReliability, ...]
    events: tuple[EventReliability, ...]


def reliability(
    sessions: Sequence[SessionCodings], codes: Sequence[str], *, width: float, tolerance: float
) -> Reliability:
    """Return the agreement on each of the codes, and on all together when there are several.
    `width` is that of a bin, `tolerance` that between the beginnings of events, both in s; a width
    that `coded_bins` refuses is a ValueError.
    """
    coders = range(len(sessions[0][1]) if sessions else 0)
    pairs = [pair for pair in combinations(coders, 2) if any(_of_both(sessions, pair))]
    subjects = {code: [code] for code in codes} | ({"": list(codes)} if len(codes) > 1 else {})
    named = subjects.items()
    of_codes = (_of_code(name, some, sessions, pairs, width, tolerance) for name, some in named)
    of_events = (_of_events(codes, sessions, pair, tolerance) for pair in pairs)
    return Reliability(tuple(of_codes), tuple(of_events))


def _of_both(
    sessions: Sequence[SessionCodings], pair: Pair
) -> Iterator[tuple[int, Sequence[CodedEvent], Sequence[CodedEvent]]]:
    """Yield the events of two coders in each session that both have coded, with its number."""
    for number, (_duration, codings) in enumerate(sessions):
        one, two = codings[pair[0]], codings[pair[1]]
        if one is not None and two is not None:
            yield number, one, two


# --- figures of a table (values, values), nan where they are not defined ----------------------


def agreement(table: Floats) -> float:
    total = table.sum()
    return float(np.trace(table) / total) if total else np.nan


def kappa(table: Floats) -> float:
    """Return Cohen's kappa."""
    # A package for analysis, which a robot's computer lacks.
    from statsmodels.stats.inter_rater import cohens_kappa  # noqa: PLC0415

    if not table.any():
        return np.nan
    with np.errstate(divide="ignore", invalid="ignore"):  # chance agreement may be complete
        return float(cohens_kappa(table, return_results=False))


def alpha(coincidences: Floats) -> float:
    total = coincidences.sum()
    expected = (total**2 - (coincidences.sum(axis=1) ** 2).sum()) / (total - 1.0)
    return float(1.0 - (total - np.trace(coincidences)) / expected) if expected > TINY else np.nan


def event_kappa(table: Floats) -> float:
    """Return kappa of a table whose last cell is a structural zero: the expected shares are those
    of quasi-independence, by iterative proportional fitting.
    """
    if not table.any():
        return np.nan
    fitted = np.ones_like(table)
    fitted[-1, -1] = 0.0
    for _ in range(FITTING_ROUNDS):
        for axis in (1, 0):
            sums = fitted.sum(axis=axis, keepdims=True)
            fitted *= table.sum(axis=axis, keepdims=True) / np.where(sums > TINY, sums, 1.0)
    observed, expected = (np.trace(one) / one.sum() for one in (table, fitted))
    return float((observed - expected) / (1.0 - expected)) if 1.0 - expected > TINY else np.nan


def estimate(
    figure: Callable[[Floats], float], tables: Floats, *, least: float = -1.0
) -> ReliabilityEstimate:
    """Return a figure of the sum of the clusters' tables (clusters, values, values), and its
    interval by the jackknife. The figure has values from `least` to 1.
    """
    whole = tables.sum(axis=0)
    value = figure(whole)
    if np.isnan(value):
        return ReliabilityEstimate(None)
    others = np.array([figure(whole - one) for one in tables if one.any()])
    count = len(others)
    if count < LEAST_CLUSTERS or np.isnan(others).any():
        return ReliabilityEstimate(value)
    error = np.sqrt((count - 1) / count * ((others - others.mean()) ** 2).sum())
    reach = error * special.stdtrit(count - 1, (1.0 + LEVEL) / 2.0)
    # On Fisher's z the interval ends within the bounds; its standard error is that of the figure
    # times the slope of z (delta method).
    half = (1.0 - least) / 2.0
    scaled = (value - 1.0) / half + 1.0
    if abs(scaled) >= 1.0:
        return ReliabilityEstimate(value, value, value)
    z, wide = np.arctanh(scaled), reach / half / (1.0 - scaled**2)
    low, high = (float((np.tanh(end) - 1.0) * half + 1.0) for end in (z - wide, z + wide))
    return ReliabilityEstimate(value, low, high)


def _of_code(
    name: str,
    codes: Sequence[str],
    sessions: Sequence[SessionCodings],
    pairs: Sequence[Pair],
    width: float,
    tolerance: float,
) -> CodeReliability:
    values, cluster = _values(sessions, codes, width)
    shape = (int(cluster.max(initial=-1)) + 1, int(values.max(initial=-1)) + 1)
    found = []
    for pair in pairs:
        tables = pair_tables(values[list(pair)], cluster, shape)
        share = estimate(agreement, tables, least=0.0)
        parts = [
            [len(some) for some in matched(one, two, code, tolerance)]
            for _number, one, two in _of_both(sessions, pair)
            for code in codes
        ]
        matches = Matches(*map(sum, zip(*parts, strict=True)))
        found.append(PairReliability(pair, share, estimate(kappa, tables), matches))
    bins = int(((values >= 0).sum(axis=0) >= 2).sum())
    of_all = estimate(alpha, coincidences(values, cluster, shape))
    return CodeReliability(name, bins, of_all, tuple(found))


def _values(
    sessions: Sequence[SessionCodings], codes: Sequence[str], width: float
) -> tuple[Units, Units]:
    """Return the categories of bins from 0, -1 where a coder did not code: (coders, bins); and the
    number of each bin's cluster: (bins,). A category is a set of codes.
    """
    coders = len(sessions[0][1]) if sessions else 0
    parts, clusters = [np.zeros((coders, 0), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for number, (duration, codings) in enumerate(sessions):
        count = len(coded_bins((), "", duration, width))
        rows = np.full((coders, count), -1, dtype=np.int64)
        for row, events in zip(rows, codings, strict=True):
            if events is not None:
                # at most 40 codes, so that their bits fit
                coded = (coded_bins(events, code, duration, width) for code in codes)
                row[:] = np.sum([one << n for n, one in enumerate(coded)], axis=0)
        bins = np.arange(count)
        parts.append(rows)
        is_single = len(sessions) == 1
        clusters.append((bins * width // BLOCK_S).astype(int) if is_single else 0 * bins + number)
    values = np.concatenate(parts, axis=1)
    known = np.unique(values[values >= 0])
    numbered = np.where(values < 0, -1, np.searchsorted(known, values))
    return numbered, np.concatenate(clusters)


def coded_bins(events: Iterable[CodedEvent], code: str, duration: float, width: float) -> Units:
    """Return 1 for each bin in which a coder's events have the code, else 0; (bins,). The duration
    of the session and the width of a bin are in s; a width that is not positive, or makes too many
    bins, is a ValueError.
    """
    if not width > 0:
        raise ValueError("a bin needs a width")
    count = max(int(np.ceil(duration / width - 1e-9)), 1)
    if count > MAX_BINS:
        raise ValueError(f"{count} bins are too many; make them wider")
    found = np.zeros(count, dtype=np.int64)
    middles = (np.arange(count) + 0.5) * width
    for event in events:
        if event.code != code:
            continue
        if event.end is None:
            found[min(int(event.begin / width + 1e-9), count - 1)] = 1
        else:
            found[(middles >= event.begin) & (middles < event.end)] = 1
    return found


def pair_tables(
    values: Units, cluster: Units, shape: tuple[int, int], weight: Floats | float = 1.0
) -> Floats:
    """Return the table of two coders in each cluster: (clusters, values, values). `values` (2,
    units) are the categories from 0, -1 is a missing value; `cluster` (units,) is the number of
    each unit's cluster from 0, `shape` the numbers of clusters and categories.
    """
    known = (values >= 0).all(axis=0)
    tables = np.zeros((*shape, shape[1]))
    counts = np.broadcast_to(weight, known.shape)[known]
    np.add.at(tables, (cluster[known], *values[:, known]), counts)
    return tables


def coincidences(values: Units, cluster: Units, shape: tuple[int, int]) -> Floats:
    """Return the matrix of coincidences of all coders in each cluster, as `pair_tables`: two values
    of a unit that has m of them count 1 / (m - 1), in either order.
    """
    weight = 1.0 / np.maximum((values >= 0).sum(axis=0) - 1, 1)
    found = np.zeros((*shape, shape[1]))
    for pair in permutations(range(len(values)), 2):
        found += pair_tables(values[list(pair)], cluster, shape, weight)
    return found


def _of_events(
    codes: Sequence[str], sessions: Sequence[SessionCodings], pair: Pair, tolerance: float
) -> EventReliability:
    place = {code: number for number, code in enumerate((*codes, ""))}
    found = [
        (int(begin // BLOCK_S) if len(sessions) == 1 else number, place[first], place[second])
        for number, one, two in _of_both(sessions, pair)
        for begin, first, second in aligned(one, two, tolerance)
    ]
    clusters = max((number for number, *_codes in found), default=0) + 1
    tables = np.zeros((clusters, len(place), len(place)))
    for cell in found:
        tables[cell] += 1.0
    of_pair = estimate(event_kappa, tables)
    return EventReliability(pair, tuple(codes), tables.sum(axis=0), of_pair)
