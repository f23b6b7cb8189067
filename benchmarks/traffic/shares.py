"""The CPU share and the memory of each process of a site, with its children (Linux, /proc)."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
TICKS = os.sysconf("SC_CLK_TCK")


def family(pid: int) -> list[int]:
    """Return a process and all that it has started, as far as they live."""
    found = [pid]
    for threads in PROC.glob(f"{pid}/task/*/children"):
        found += [one for child in _read(threads).split() for one in family(int(child))]
    return found


def seconds(pid: int) -> float:
    """Return the processor time that a process has taken, 0 when it is gone."""
    fields = _read(PROC / str(pid) / "stat").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS if fields else 0.0


def megabytes(pid: int) -> float:
    """Return the memory that a process alone would give back (its anonymous pages), 0 when it is
    gone.
    """
    lines = [
        line
        for line in _read(PROC / str(pid) / "status").splitlines()
        if line.startswith("RssAnon")
    ]
    return int(lines[0].split()[1]) / 1024 if lines else 0.0


def busy_seconds() -> tuple[float, float]:
    """Return the time since the computer started that all cores together were not idle, and that a
    virtual one waited for a real one.
    """
    fields = [int(field) for field in _read(PROC / "stat").splitlines()[0].split()[1:9]]
    return (sum(fields) - fields[3] - fields[4] - fields[7]) / TICKS, fields[7] / TICKS


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


@dataclass(frozen=True)
class Reading:
    """The clocks of some processes at one moment."""

    at: float
    busy: float
    stolen: float
    taken: dict[str, float]


def read(processes: dict[str, int]) -> Reading:
    """Look at processes, given as names and pids."""
    taken = {name: sum(seconds(one) for one in family(pid)) for name, pid in processes.items()}
    return Reading(time.monotonic(), *busy_seconds(), taken)


def between(before: Reading, after: Reading) -> dict[str, float]:
    """Return the shares of a core that were taken between two looks.

    `others` is whatever else ran on this computer, `stolen` what other virtual computers took of
    its cores.
    """
    passed = after.at - before.at
    shares = {name: (taken - before.taken[name]) / passed for name, taken in after.taken.items()}
    others = max(0.0, (after.busy - before.busy) / passed - sum(shares.values()))
    return {**shares, "others": others, "stolen": (after.stolen - before.stolen) / passed}


def memory(processes: dict[str, int]) -> dict[str, float]:
    """Return megabytes by name."""
    return {name: sum(megabytes(one) for one in family(pid)) for name, pid in processes.items()}
