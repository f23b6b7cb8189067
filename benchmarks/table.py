"""Figures as a table on the terminal and as JSON in benchmarks/results."""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).parent / "results"
CAMERA_FPS = 30  # of the simulated robot where the video matters; the fixture of tests has fewer


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


def conditions(camera_fps: int | None = None) -> str:
    """Return what figures depend on, for their heading."""
    load = f"load {os.getloadavg()[0]:.1f}"
    return load if camera_fps is None else f"camera of {camera_fps} frames a second, {load}"


def keep(name: str, figures: list[Figure], *, camera_fps: int | None = None, **more: object) -> int:
    heading = conditions(camera_fps)
    print(f"\n{name} ({heading})")
    for figure in figures:
        print(figure)
    RESULTS.mkdir(exist_ok=True)
    kept = {"conditions": heading, "figures": [asdict(figure) for figure in figures], **more}
    (RESULTS / f"{name}.json").write_text(json.dumps(kept, indent=1))
    return sum(figure.missed for figure in figures)
