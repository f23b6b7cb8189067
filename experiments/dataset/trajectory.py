"""The states of a drive in time. Durations are by the robot's clock within one run of its agent,
because clocks of two machines drift apart.
"""

import math
from dataclasses import dataclass

import numpy as np

from experiments.dataset.columns import Columns, Floats
from sessions.recording.sequence_tracker import MAX_GAP

GAP_SECONDS = 1.0  # longer without a state is a gap


@dataclass(frozen=True)
class Trajectory:
    """States of a session, or of a part of it: `at` is each state's time by the server's clock,
    `lasts` the seconds to the next state, or 0 where a gap or the end of the part follows: what
    happened then was not seen.
    """

    states: Columns
    at: Floats
    lasts: Floats

    @classmethod
    def of(cls, states: Columns) -> "Trajectory":
        offset = states["clock_offset"]
        known = offset[np.isfinite(offset)]
        at = states["stamp"] - (float(np.median(known)) if known.size else 0.0)
        steps = np.diff(states["stamp"], append=np.nan)
        alive = np.diff(states["boot"], append=np.nan) == 0.0
        return cls(states, at, np.where(alive & (steps > 0.0) & (steps <= GAP_SECONDS), steps, 0.0))

    def between(self, start: float, end: float) -> "Trajectory":
        """Return the part from one time to another; a bound that is NaN bounds nothing."""
        inside = ~(self.at < start) & ~(self.at > end)
        lasts = self.lasts[inside]
        lasts[-1:] = 0.0
        return Trajectory(self.states[inside], self.at[inside], lasts)

    def __len__(self) -> int:
        return len(self.states)

    def gaps(self) -> Floats:
        """Return how many seconds each hole between its states lasts that is a gap."""
        steps = np.diff(self.at)
        return steps[steps > GAP_SECONDS]

    def missing(self) -> int:
        """Return how many states are missing by their numbers, which have no holes within a run;
        wider holes than any agent keeps are not counted.
        """
        skipped = np.diff(self.states["seq"]) - 1.0
        alike = np.diff(self.states["boot"]) == 0.0
        return int(skipped[alike & (skipped > 0.0) & (skipped < MAX_GAP)].sum())

    def share_seen(self, seconds: float) -> float:
        """Return the share of a time, in seconds, of which there are states; NaN of no time."""
        return min(1.0, float(self.lasts.sum()) / seconds) if seconds > 0.0 else math.nan

    def rate(self) -> float:
        """Return the states a second, from the first to the last; NaN with fewer than two."""
        seconds = float(self.at[-1] - self.at[0]) if len(self) > 1 else 0.0
        return (len(self) - 1) / seconds if seconds > 0.0 else math.nan
