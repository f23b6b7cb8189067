"""Figures as a table on the terminal and as JSON in benchmarks/results."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Figure:
    """One measured number: what it is, its unit, and the bound it should not exceed, if any."""

    what: str
    value: float
    unit: str
    bound: float | None = None

    @property
    def missed(self) -> bool:
        return self.bound is not None and self.value > self.bound

    def __str__(self) -> str:
        line = f"  {self.what:<52} {self.value:9.2f} {self.unit:<4}"
        if self.bound is None:
            return line
        return f"{line}   {'MISSED' if self.missed else 'kept'} (at most {self.bound:g})"


def quantiles(what: str, values: list[float], unit: str, **bounds: float | None) -> list[Figure]:
    """Return the figures named in `bounds` (p50, p95, p99, max) of a sample."""
    found = {"p50": 50, "p95": 95, "p99": 99, "max": 100}
    return [
        Figure(f"{what}, {name}", float(np.percentile(values, found[name])), unit, bound)
        for name, bound in bounds.items()
    ]


def keep(name: str, figures: list[Figure], **more: object) -> int:
    print(f"\n{name}")
    for figure in figures:
        print(figure)
    RESULTS.mkdir(exist_ok=True)
    kept = {"figures": [asdict(figure) for figure in figures], **more}
    (RESULTS / f"{name}.json").write_text(json.dumps(kept, indent=1))
    return sum(figure.missed for figure in figures)
