"""When and where a base came to rest, by its own readings."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True)
class SpeedSample:
    """The base's linear velocity in m/s, and when it arrived, monotonic seconds."""

    at: float
    speed: float


def stopped_after(samples: Sequence[SpeedSample], silent_at: float, at_rest: float) -> float | None:
    """Return the seconds between `silent_at` and the first reading of the base's final rest, None
    while it moves.
    """
    stood_at: float | None = None
    for sample in samples:
        if abs(sample.speed) >= at_rest:
            stood_at = None
        elif stood_at is None:
            stood_at = sample.at
    return None if stood_at is None else max(0.0, stood_at - silent_at)


def travelled(samples: Sequence[SpeedSample]) -> float:
    """Return the metres between the first and the last sample, by the trapezoidal rule."""
    return sum(
        abs(before.speed + after.speed) / 2 * (after.at - before.at)
        for before, after in pairwise(samples)
    )
