"""Metrics of a robot's motion, from its states as arrays."""

import math

import numpy as np
import numpy.typing as npt

from experiments.analysis.metrics.path import path_travelled, turned
from experiments.dataset.columns import Floats
from experiments.dataset.trajectory import Trajectory

STANDING, GOING = 0.02, 0.05  # m/s
TURNING = 0.05  # rad/s
STOP_SECONDS = 1.0
NEAR, CLEAR = 0.20, 0.25  # m: nearer begins a near-collision, farther ends it
Bools = npt.NDArray[np.bool_]


def drive(track: Trajectory) -> dict[str, float]:
    """Return the metrics of driving (metrics.csv) of a track, for the time that has states; those
    that the robot cannot measure are left out.
    """
    states, seconds = track.states, track.lasts
    is_moving = (np.abs(states["linear"]) > STANDING) | (np.abs(states["angular"]) > TURNING)
    return {
        **_path(track, is_moving),
        "idle": float(seconds[~is_moving].sum()),
        "stops": float(_stops(np.abs(states["linear"]), track.at, seconds <= 0.0)),
        "collisions": float(np.nansum(states["contacts"])),
        **_distances(track),
    }


def _path(track: Trajectory, is_moving: Bools) -> dict[str, float]:
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
