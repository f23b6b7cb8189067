"""What a robot did, from its states: how far, how fast, how often it stood, how close it came to
things. Pure arrays.

Durations come from the robot's own clock within one run of its agent, because clocks of two
machines drift apart.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from experiments.analysis.dataset.records import Columns, Floats

DEAD_BAND = 0.01  # m: a position that trembles is no way
TURN_BAND = math.radians(0.5)
STANDING, GOING = 0.02, 0.05  # m/s
TURNING = 0.05  # rad/s
STOP_SECONDS = 1.0
NEAR, CLEAR = 0.20, 0.25  # m: nearer begins a near-collision, farther ends it
# m/s, m: a robot that moves farther between two states found itself somewhere else
JUMP_SPEED, JUMP_SLACK = 2.5, 0.5
GAP_SECONDS = 1.0  # longer without a state is a gap
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Trajectory:
    """States of a session, or of a part of it: `at` is each state's time by the server's clock,
    `lasts` how long it held; gaps hold nothing.
    """

    states: Columns
    at: Floats
    lasts: Floats

    @classmethod
    def of(cls, states: Columns) -> "Trajectory":
        """Return the track of states in the order in which they were made."""
        offset = states["clock_offset"]
        known = offset[np.isfinite(offset)]
        at = states["stamp"] - (float(np.median(known)) if known.size else 0.0)
        steps = np.diff(states["stamp"], append=np.nan)
        alive = np.diff(states["boot"], append=np.nan) == 0.0
        return cls(states, at, np.where(alive & (steps > 0.0) & (steps <= GAP_SECONDS), steps, 0.0))

    def between(self, start: float, end: float) -> "Trajectory":
        """Return the part from one time to another; a bound that is NaN bounds nothing."""
        inside = ~(self.at < start) & ~(self.at > end)
        return Trajectory(
            Columns(self.states.layout, self.states.values[inside]),
            self.at[inside],
            self.lasts[inside],
        )

    def __len__(self) -> int:
        return len(self.states)

    def gaps(self) -> Floats:
        """Return the lengths of the holes between its states in seconds, those longer than
        GAP_SECONDS.
        """
        steps = np.diff(self.at)
        return steps[steps > GAP_SECONDS]

    def rate(self) -> float:
        """Return how many states there were a second, from the first to the last; NaN with fewer
        than two.
        """
        seconds = float(self.at[-1] - self.at[0]) if len(self) > 1 else 0.0
        return (len(self) - 1) / seconds if seconds > 0.0 else math.nan


@dataclass(frozen=True)
class DriveMotion:
    """How a robot was driven: metres, seconds, radians, m/s. `jumps` are places that it did not
    drive to.
    """

    path: float
    rotation: float
    jumps: int
    moving: float
    idle: float
    seconds: float
    stops: int
    collisions: int
    near_collisions: int
    near_seconds: float
    least_clearance: float

    @property
    def speed(self) -> float:
        """Mean speed over all of the time."""
        return self.path / self.seconds if self.seconds > 0.0 else math.nan

    @property
    def moving_speed(self) -> float:
        """Mean speed while it moved."""
        return self.path / self.moving if self.moving > 0.0 else math.nan


def drive(track: Trajectory) -> DriveMotion:
    """Return how a robot was driven along a track."""
    states = track.states
    path, jumps = travelled(states["x"], states["y"], track.at)
    going = np.abs(states["linear"]) > STANDING
    turning = np.abs(states["angular"]) > TURNING
    near, begun = _near(states["clearance"])
    clearance = states["clearance"][np.isfinite(states["clearance"])]
    return DriveMotion(
        path=path,
        rotation=_turned(states["theta"]),
        jumps=jumps,
        moving=float(track.lasts[going | turning].sum()),
        idle=float(track.lasts[~(going | turning)].sum()),
        seconds=float(track.lasts.sum()),
        stops=_stops(np.abs(states["linear"]), track.at),
        collisions=int(np.nansum(states["contacts"])),
        near_collisions=begun,
        near_seconds=float(track.lasts[near].sum()),
        least_clearance=float(clearance.min()) if clearance.size else math.nan,
    )


def travelled(x: Floats, y: Floats, at: Floats) -> tuple[float, int]:
    """Return the length of a way in metres with a dead band, and how often it jumps."""
    known = np.isfinite(x) & np.isfinite(y)
    length, jumps, last = 0.0, 0, None
    for here in zip(x[known].tolist(), y[known].tolist(), at[known].tolist(), strict=True):
        if last is None:
            last = here
            continue
        step = math.hypot(here[0] - last[0], here[1] - last[1])
        if step < DEAD_BAND:
            continue
        if step > JUMP_SPEED * max(0.0, here[2] - last[2]) + JUMP_SLACK:
            jumps += 1
        else:
            length += step
        last = here
    return length, jumps


def _turned(theta: Floats) -> float:
    angles = np.unwrap(theta[np.isfinite(theta)]).tolist()
    total, last = 0.0, None
    for angle in angles:
        if last is None or abs(angle - last) >= TURN_BAND:
            total += 0.0 if last is None else abs(angle - last)
            last = angle
    return total


def _stops(speed: Floats, at: Floats) -> int:
    """Count how often a robot that went faster than GOING stood for STOP_SECONDS."""
    known = np.isfinite(speed)
    speed, at = speed[known], at[known]
    if not speed.size:
        return 0
    standing = speed < STANDING
    edges = np.flatnonzero(np.diff(standing)) + 1
    starts = np.concatenate(([0], edges))
    ends = np.concatenate((edges, [len(speed)])) - 1
    count, went = 0, False
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if not standing[start]:
            went = went or bool((speed[start : end + 1] > GOING).any())
        elif went and at[end] - at[start] >= STOP_SECONDS:
            count, went = count + 1, False
    return count


def _near(clearance: Floats) -> tuple[Bools, int]:
    """Return where the robot was near something, (n,), and how often that began; an unknown
    clearance changes nothing.
    """
    told = np.where(clearance < NEAR, 1, np.where(clearance > CLEAR, 0, -1))
    told[0:1] = np.maximum(told[0:1], 0)
    held = np.maximum.accumulate(np.where(told >= 0, np.arange(len(told)), 0))
    near = told[held] == 1
    return near, int(near[:1].sum() + (np.diff(near.astype(np.int8)) == 1).sum())
