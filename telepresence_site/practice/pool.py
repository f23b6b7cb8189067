"""How many practice robots run, and which: a decision on plain data, without processes or a
database.

A simulated robot costs a good part of a core, so it runs only when somebody may want it: one for
everybody who practises, and one more while somebody waits. It is started anew after each visitor,
so that everybody finds it in its charging station. When all are taken the next visitor waits in the
queue of one of them, whose turns are short: a full house delays and never blocks.

Times are Unix seconds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

LINGER = 60.0  # how long a robot that nobody needs stays ready for the next one who waits
# between two starts of the same robot, so that one that cannot live does not eat the computer
AGAIN = 5.0


@dataclass(frozen=True)
class Process:
    """One robot's process: when it was started last, and whether it lives."""

    started_at: float
    alive: bool


@dataclass(frozen=True)
class Demand:
    """Who is there: `wanted_at` is the last time that somebody waited for a real robot or asked
    for a practice robot, `taken` the practice robots with living visits.

    `left_at` says when the last visitor of each left, of those that had one.
    """

    wanted_at: float | None
    taken: frozenset[str]
    left_at: Mapping[str, float]


@dataclass(frozen=True)
class StartRobot:
    """Start this robot's process."""

    name: str


@dataclass(frozen=True)
class StopRobot:
    """End this robot's process."""

    name: str


def decide(
    names: Sequence[str], demand: Demand, processes: Mapping[str, Process], now: float
) -> list[StartRobot | StopRobot]:
    """Return what is to be done now.

    Args:
        names: of all practice robots, in the order in which they are used.
        demand: who is there.
        processes: those that were ever started, by name.
        now: Unix seconds.
    """
    alive = [name for name in names if name in processes and processes[name].alive]
    used = {
        name
        for name in alive
        if name not in demand.taken and demand.left_at.get(name, 0.0) > processes[name].started_at
    }
    kept = [name for name in alive if name not in used]
    spare = demand.wanted_at is not None and now - demand.wanted_at < LINGER
    needed = min(len(names), len(demand.taken) + spare)
    acts: list[StartRobot | StopRobot] = [StopRobot(name) for name in sorted(used)]
    missing = [name for name in names if name not in alive and _may_start(processes.get(name), now)]
    # whoever practises first: theirs has died
    missing.sort(key=lambda name: name not in demand.taken)
    acts += [StartRobot(name) for name in missing[: max(0, needed - len(kept))]]
    idle = [name for name in reversed(kept) if name not in demand.taken]
    return acts + [StopRobot(name) for name in idle[: max(0, len(kept) - needed)]]


def _may_start(process: Process | None, now: float) -> bool:
    return process is None or now - process.started_at >= AGAIN
