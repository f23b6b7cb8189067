"""Reliability of codings, with intervals of confidence. Pure: numbers in, numbers out.

By time, the units are bins (experiments/coding/agreement.py): for one code a bin is 0 or 1, for all
codes together its value is the set of codes in it. Neighbouring bins depend on each other, so
confidence intervals are percentiles of a bootstrap that draws blocks of BLOCK_S seconds with
replacement (Künsch, 1989, "The jackknife and the bootstrap for general stationary observations",
Annals of Statistics 17, 1217-1241). Kappa and alpha are functions of sums over units, so a draw
only weights the blocks' sums.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from experiments.coding.agreement import (
    Floats,
    Matches,
    SessionCodings,
    Sums,
    Units,
    agreements,
    aligned,
    alphas,
    block_coincidences,
    block_sums,
    coded_bins,
    event_kappas,
    kappas,
    matched_in,
)
from experiments.coding.scheme import CodedEvent

BLOCK_S = 30.0
DRAWS, SEED = 1000, 20_110_125
MAX_BLOCKS = 400
LEAST_UNITS = 10  # blocks or events; draws of fewer make intervals that are far too narrow
LEVEL = 0.95


@dataclass(frozen=True)
class ReliabilityEstimate:
    """A value and its 95 % confidence interval; None where it is not defined."""

    value: float | None
    low: float | None = None
    high: float | None = None


UNKNOWN = ReliabilityEstimate(None)


@dataclass(frozen=True)
class PairReliability:
    """Two coders, by their places. `agreement` is the share of bins in which they say the same."""

    coders: tuple[int, int]
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
    """Two coders' aligned events: rows are what the first coded, columns the second; the last of
    both is none. `table` is (codes + 1, codes + 1).
    """

    coders: tuple[int, int]
    labels: tuple[str, ...]
    table: Floats
    kappa: ReliabilityEstimate


@dataclass(frozen=True)
class Reliability:
    """What a scheme's codes reach in several sessions."""

    codes: tuple[CodeReliability, ...]
    events: tuple[EventReliability, ...]


def reliability(
    sessions: Sequence[SessionCodings], codes: Sequence[str], *, width: float, tolerance: float
) -> Reliability:
    """Return how reliable codings are, for each code, and for all of them when there are several.

    Args:
        sessions: duration in seconds, and the events of each coder in the same order of coders;
            None for one who did not code the session.
        codes: which codes.
        width: of a bin, s.
        tolerance: between beginnings, s.

    Raises:
        ValueError: the width is not positive, or makes too many bins.
    """
    if not width > 0:
        raise ValueError("a bin needs a width")
    coders = len(sessions[0][1]) if sessions else 0
    subjects: list[tuple[str, tuple[str, ...]]] = [(code, (code,)) for code in codes]
    if len(subjects) > 1:
        subjects.append(("", tuple(codes)))
    found = [
        _of_code(name, _values(sessions, some, coders, width), sessions, some, tolerance)
        for name, some in subjects
    ]
    pairs = [pair for pair in combinations(range(coders), 2) if _both(sessions, *pair)]
    return Reliability(
        tuple(found),
        tuple(_of_events(sessions, codes, pair, tolerance) for pair in pairs),
    )


# --- by time --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Blocks:
    """`values` are categories from 0, and -1 where a coder did not code: (coders, bins); `block` is
    the number of each bin's block: (bins,); `shape` is how many blocks and categories there are.
    """

    values: Units
    block: Units
    shape: tuple[int, int]


def _values(
    sessions: Sequence[SessionCodings], codes: Sequence[str], coders: int, width: float
) -> _Blocks:
    """Return the categories of bins; a set of codes is the number of its bits, then counted."""
    parts, blocks, first = [np.zeros((coders, 0), dtype=np.int64)], [np.zeros(0, np.int64)], 0
    total = sum(duration for duration, _ in sessions)
    length = max(1, round(max(BLOCK_S, total / MAX_BLOCKS) / width))
    for duration, codings in sessions:
        rows = [_row(events, codes, duration, width) for events in codings]
        bins = rows[0].size
        parts.append(np.stack(rows))
        blocks.append(first + np.arange(bins, dtype=np.int64) // length)
        first += (bins - 1) // length + 1
    values = np.concatenate(parts, axis=1)
    known = np.unique(values[values >= 0])
    numbered = np.where(values < 0, -1, np.searchsorted(known, values))
    return _Blocks(numbered, np.concatenate(blocks), (first, len(known)))


def _row(
    events: Sequence[CodedEvent] | None, codes: Sequence[str], duration: float, width: float
) -> Units:
    bins = len(coded_bins((), "", duration, width))
    if events is None:
        return np.full(bins, -1, dtype=np.int64)
    total = np.zeros(bins, dtype=np.int64)
    for place, code in enumerate(codes):  # at most 40 codes, so the bits fit
        total += coded_bins(events, code, duration, width).astype(np.int64) << place
    return total


def _of_code(
    name: str,
    blocks: _Blocks,
    sessions: Sequence[SessionCodings],
    codes: Sequence[str],
    tolerance: float,
) -> CodeReliability:
    generator = np.random.default_rng(SEED)
    weights = _weights(blocks.shape[0], generator)
    pairs = []
    for a, b in combinations(range(len(blocks.values)), 2):
        if not _both(sessions, a, b):
            continue
        sums = block_sums(blocks.values[[a, b]], blocks.block, blocks.shape)
        pairs.append(
            PairReliability(
                (a, b),
                _estimate(agreements, sums, weights),
                _estimate(kappas, sums, weights),
                matched_in(sessions, (a, b), codes, tolerance),
            )
        )
    values = (blocks.values >= 0).sum(axis=0)
    together = block_coincidences(blocks.values, blocks.block, blocks.shape)
    alpha = _estimate(alphas, together, weights)
    return CodeReliability(name, int((values >= 2).sum()), alpha, tuple(pairs))


def _weights(blocks: int, generator: np.random.Generator) -> Floats:
    """Return how often each block is drawn: (1 + draws, blocks); the first row is the data."""
    if blocks == 0:
        return np.zeros((1, 0))
    drawn = generator.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=DRAWS)
    return np.concatenate([np.ones((1, blocks)), drawn]).astype(np.float64)


def _estimate(
    figure: Callable[[Sums], Floats], blocks: Sums, weights: Floats
) -> ReliabilityEstimate:
    if not blocks.rows.size:
        return UNKNOWN
    drawn = Sums(weights @ blocks.agreed, weights @ blocks.rows, weights @ blocks.columns)
    return _interval(figure(drawn), units=len(blocks.rows))


def _interval(found: Floats, units: int) -> ReliabilityEstimate:
    """Return the first figure with the percentiles of the others; few units have no interval."""
    if np.isnan(found[0]):
        return UNKNOWN
    drawn = found[1:][~np.isnan(found[1:])]
    if units < LEAST_UNITS or drawn.size < DRAWS / 2:
        return ReliabilityEstimate(float(found[0]))
    tail = 100.0 * (1.0 - LEVEL) / 2.0
    low, high = np.percentile(drawn, [tail, 100.0 - tail])
    return ReliabilityEstimate(float(found[0]), float(low), float(high))


# --- by events ------------------------------------------------------------------------------------


def _of_events(
    sessions: Sequence[SessionCodings],
    codes: Sequence[str],
    pair: tuple[int, int],
    tolerance: float,
) -> EventReliability:
    table = np.zeros((len(codes) + 1, len(codes) + 1))
    place = {code: number for number, code in enumerate(codes)} | {"": len(codes)}
    for _duration, codings in sessions:
        one, two = codings[pair[0]], codings[pair[1]]
        if one is not None and two is not None:
            for first, second in aligned(one, two, tolerance):
                table[place[first], place[second]] += 1.0
    return EventReliability(pair, tuple(codes), table, event_kappa(table))


def event_kappa(table: Floats) -> ReliabilityEstimate:
    """Return kappa of a table whose last cell cannot be counted, its interval by a bootstrap over
    the aligned events.
    """
    total = int(table.sum())
    if total == 0:
        return UNKNOWN
    generator = np.random.default_rng(SEED)
    drawn = generator.multinomial(total, (table / total).ravel(), size=DRAWS)
    tables = np.concatenate([table[None], drawn.reshape(DRAWS, *table.shape)]).astype(np.float64)
    return _interval(event_kappas(tables), units=total)


def _both(sessions: Sequence[SessionCodings], a: int, b: int) -> bool:
    return any(codings[a] is not None and codings[b] is not None for _d, codings in sessions)
