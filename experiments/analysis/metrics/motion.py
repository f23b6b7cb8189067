"""Metrics of a robot's motion, from its states as arrays. Durations are by the robot's clock within
one run of its agent, because clocks of two machines drift apart.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from experiments.analysis.metrics.path import path_travelled, turned
from experiments.dataset.columns import Columns, Floats
from sessions.recording.sequence_tracker import MAX_GAP

STANDING, GOING = 0.02, 0.05  # m/s
TURNING = 0.05  # rad/s
STOP_SECONDS = 1.0
NEAR, CLEAR = 0.20, 0.25  # m: nearer begins a near-collision, farther ends it
GAP_SECONDS = 1.0  # longer without a state is a gap
Bools = npt.NDArray[np.bool_]


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


def drive(track: Trajectory) -> dict[str, float]:
    """Return the metrics of driving (metrics.csv) of a track, for the time that has states; those
    that the robot cannot measure are left out.
    """
    states, seconds = track.states, track.lasts
    is_moving = (np.abs(states["linear"]) > STANDING) | (np.abs(states["angular"]) > TURNING)
    return {
        **_way(track, is_moving),
        "idle": float(seconds[~is_moving].sum()),
        "stops": float(_stops(np.abs(states["linear"]), track.at, seconds <= 0.0)),
        "collisions": float(np.nansum(states["contacts"])),
        **_distances(track),
    }


def _way(track: Trajectory, is_moving: Bools) -> dict[str, float]:
    """Return how far and fast a robot drove and turned, which needs a position or an odometer."""
    states, seconds, seen = track.states, track.lasts, track.lasts > 0.0
    position, trusted = np.column_stack((states["x"], states["y"])), states["localized"] != 0.0
    odometer = np.where(states["distance_by_position"] == 1.0, np.nan, states["distance"])
    path = path_travelled(position, odometer, track.at, seen, trusted)
    is_localized = bool((np.isfinite(position).all(axis=1) & trusted).any())
    found = {"path_by_odometry": float(path.by_odometry)}
    if is_localized:
        found["jumps"] = float(path.jumps)
        found["rotation"] = turned(states["theta"], track.at, seen)
    if path.by_odometry:
        found["slipped"] = path.slipped
    elif not is_localized:
        return {}
    return found | {
        "path": path.length,
        "path_unseen": path.unseen,
        "speed": _ratio(path.length, float(seconds.sum())),
        "moving_speed": _ratio(path.length, float(seconds[is_moving].sum())),
    }


def _distances(track: Trajectory) -> dict[str, float]:
    """Return how near a robot came to anything, which needs a sensor of distance."""
    clearance, seconds = track.states["clearance"], track.lasts
    known = clearance[np.isfinite(clearance)]
    if not known.size:
        return {}
    near, count = _near(clearance, track.states["docked"] == 1.0)
    return {
        "near_collisions": float(count),
        "near_seconds": float(seconds[near].sum()),
        "least_clearance": float(known.min()),
    }


def _ratio(amount: float, of: float) -> float:
    return amount / of if of > 0.0 else math.nan


def _stops(speed: Floats, at: Floats, gap_follows: Bools) -> int:
    """Count standstills of STOP_SECONDS without a gap, each after a speed above GOING."""
    known = np.isfinite(speed)
    stretch: npt.NDArray[np.intp] = np.cumsum(gap_follows) - gap_follows
    speed, at, stretch = speed[known], at[known], stretch[known]
    if not speed.size:
        return 0
    is_still = speed < STANDING
    edges = np.flatnonzero(np.diff(is_still) | (np.diff(stretch) > 0)) + 1
    starts = np.concatenate(([0], edges))
    ends = np.concatenate((edges, [len(speed)])) - 1
    count, went = 0, False
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if not is_still[start]:
            went = went or bool((speed[start : end + 1] > GOING).any())
        elif went and at[end] - at[start] >= STOP_SECONDS:
            count, went = count + 1, False
    return count


def _near(clearance: Floats, docked: Bools) -> tuple[Bools, int]:
    """Return where the robot was near something, (n,), and how often that began; an unknown
    clearance changes nothing. Stretches in which it was docked do not count: its station is near.
    """
    reported = np.where(clearance < NEAR, 1, np.where(clearance > CLEAR, 0, -1))
    reported[0:1] = np.maximum(reported[0:1], 0)
    held = np.maximum.accumulate(np.where(reported >= 0, np.arange(len(reported)), 0))
    near = reported[held] == 1
    stretch = np.cumsum(np.diff(near, prepend=False))  # of states alike, numbered
    near &= ~np.isin(stretch, stretch[docked & near])
    return near, int((np.diff(near.astype(np.int8), prepend=0) == 1).sum())
