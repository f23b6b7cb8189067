"""Numbers that describe samples.

Quantiles are the linear ones of Hyndman and Fan (1996, type 7), numpy's and R's default.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from experiments.dataset.columns import Floats

ROUNDED = "Percentages are rounded one by one and may not sum to 100."


@dataclass(frozen=True)
class Spread:
    """A sample in a few numbers; all but `n` are None if it is empty, `sd` below two values."""

    n: int
    mean: float | None = None
    sd: float | None = None
    p5: float | None = None
    median: float | None = None
    p95: float | None = None
    iqr: float | None = None


def spread(values: Sequence[float] | Floats) -> Spread:
    """Describe the values of a sample that are not NaN."""
    given = np.asarray(values, dtype=np.float64)
    given = given[np.isfinite(given)]
    if not given.size:
        return Spread(0)
    low, first, middle, third, high = np.percentile(given, (5, 25, 50, 75, 95)).tolist()
    sd = float(given.std(ddof=1)) if given.size > 1 else None
    return Spread(given.size, float(given.mean()), sd, low, middle, high, third - first)


def shares(counts: Sequence[int]) -> tuple[float, ...] | None:
    """Return counts as percentages with all digits, or None if all are 0."""
    total = sum(counts)
    return tuple(100.0 * count / total for count in counts) if total else None


def wilson(successes: int, n: int) -> tuple[float, float] | None:
    """Return the bounds of the 95 % interval of a share (Wilson, 1927), or None without trials."""
    if not n:
        return None
    low, high = scipy.stats.binomtest(successes, n).proportion_ci(method="wilson")
    return float(low), float(high)
