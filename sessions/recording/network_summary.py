"""The summary of a visitor's connection, from its samples of one second each."""

import statistics
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class NetworkSummary:
    """`round_trip` and `round_trip_95` in seconds, `loss` a share, `fps` frames a second; None
    where nothing was measured.
    """

    samples: int
    round_trip: float | None
    round_trip_95: float | None
    loss: float | None
    fps: float | None
    freezes: float
    ways: dict[str, int]


def summarise_network(samples: Iterable[Mapping[str, Any]]) -> NetworkSummary:
    """Return the summary of samples as in NetworkSample.data."""
    kept = list(samples)
    trips = _values(kept, "roundTrip")
    return NetworkSummary(
        samples=len(kept),
        round_trip=statistics.median(trips) if trips else None,
        round_trip_95=_percentile(trips, 0.95) if trips else None,
        loss=_mean(_values(kept, "loss")),
        fps=_mean(_values(kept, "fps")),
        freezes=max(_values(kept, "freezes"), default=0.0),
        ways=dict(Counter(sample.get("way", "") for sample in kept)),
    )


def _values(samples: list[Mapping[str, Any]], name: str) -> list[float]:
    return [sample[name] for sample in samples if sample.get(name) is not None]


def _mean(values: list[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _percentile(values: list[float], share: float) -> float:
    """Return the percentile by nearest rank."""
    ordered = sorted(values)
    return ordered[max(0, -(-len(ordered) * round(share * 100) // 100) - 1)]
