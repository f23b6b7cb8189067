"""Decides which practice robots run: pure; times are Unix seconds.

A simulated robot costs a large part of a core, so it runs only on demand: one for each visitor who
practises, and one more while a visitor waits for a real robot. It is restarted after each visitor,
so that the next one finds it in its charging station. When all are taken, the next visitor waits in
the queue of one of them, whose turns are short.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

LINGER = 60.0  # s for which an unused robot stays ready for the next visitor
AGAIN = 5.0  # s between two starts of a robot: one that dies at once must not use up the computer


@dataclass(frozen=True)
class Demand:
    """`wanted_at` is when a visitor last waited for a real robot or requested a practice robot,
    `taken` the practice robots with a visitor, `left_at` when the last visitor of a robot left.
    """

    wanted_at: float | None
    taken: frozenset[str]
    left_at: Mapping[str, float]


def decide(
    names: Sequence[str],
    demand: Demand,
    started_at: Mapping[str, float],
    running: Collection[str],
    now: float,
) -> tuple[list[str], list[str]]:
    """Return the robots to stop, and those to start.

    Args:
        names: of all practice robots, in the order in which they are used.
        demand: of visitors.
        started_at: the last start of each robot that was ever started, Unix seconds.
        running: the robots whose processes run.
        now: Unix seconds.
    """
    alive = [name for name in names if name in running]
    used = sorted(
        name
        for name in alive
        if name not in demand.taken and demand.left_at.get(name, 0.0) > started_at[name]
    )
    kept = [name for name in alive if name not in used]
    spare = demand.wanted_at is not None and now - demand.wanted_at < LINGER
    needed = min(len(names), len(demand.taken) + spare)
    missing = [
        name
        for name in names
        if name not in alive and now - started_at.get(name, -math.inf) >= AGAIN
    ]
    # first those that died under a visitor
    missing.sort(key=lambda name: name not in demand.taken)
    idle = [name for name in reversed(kept) if name not in demand.taken]
    return (
        used + idle[: max(0, len(kept) - needed)],
        missing[: max(0, needed - len(kept))],
    )
