"""How far a robot drove while its states were seen: by its odometry where it has one, otherwise by
its position, less the measurement noise.

A position that trembles while the robot stands would add a step at every state. So positions go
through the smoother of a body whose velocity changes at random (Rauch, Tung and Striebel 1965,
*Maximum likelihood estimates of linear dynamic systems*), which is the cubic smoothing spline
(Wahba 1978, *Improper priors, spline smoothing and the problem of guarding against model errors in
regression*):

    minimize   sum |z_i - y_i|² / σ²   +   ∫ |z''|² dt / q

Its σ is that of the session's own positions, by differences (Gasser, Sroka and Jennen-Steinmetz
1986, *Residual variance and residual pattern in nonlinear regression*). The remaining noise
is below a dead band of BAND times σ. Odometry does not tremble, but wheels slip: where they
turned for much more than the position moved, the position counts.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from experiments.dataset.columns import Floats

DEAD_BAND = 0.01  # m: smaller movements are measurement noise
BAND = 3.0  # times the noise: wider than what smoothing leaves of it
LEAST_SMOOTHED = 5  # positions: a spline needs as many
LEAST_NOISE = 0.001  # m, rad: less needs no smoothing
SHORTEST_STEP = 0.02  # s: states closer together than this would weigh without bound
# (m/s²)² s: a velocity that changes at random by 0.1 m/s in a second; the turn rate by 0.3 rad/s
WANDER, TURN_WANDER = 0.1**2, 0.3**2
TURN_BAND = math.radians(0.5)
# m/s, m: a robot that moves farther between two states found itself somewhere else
JUMP_SPEED, JUMP_SLACK = 2.5, 0.5
# Wheels slip where they turn for a third more than the position moves, in so many seconds and over
# so many metres at least.
SLIP_SECONDS, SLIP_SHARE, SLIP_LEAST = 5.0, 1.0 / 3.0, 0.3
Bools = npt.NDArray[np.bool_]
Counts = npt.NDArray[np.intp]


@dataclass(frozen=True)
class DrivenPath:
    """Metres: `length` in the time that has states, `unseen` at least in gaps, `slipped` by the
    wheels alone. `by_odometry` tells what the length is by; `jumps` counts positions not driven to.
    """

    length: float
    unseen: float
    slipped: float
    by_odometry: bool
    jumps: int


@dataclass(frozen=True)
class PositionSteps:
    """Metres by which the smoothed position moved to each state, (n,); `unseen` lie straight over
    gaps.
    """

    steps: Floats
    unseen: float
    jumps: int
    noise: float


def path_travelled(
    position: Floats, odometer: Floats, at: Floats, seen: Bools, trusted: Bools
) -> DrivenPath:
    """Return how far a robot drove, from its positions, (n, 2) metres, and its odometer, (n,)
    metres, NaN where unknown, at (n,) seconds. `seen`: whether the time to the next state was;
    `trusted`: whether the robot knew its position.
    """
    moved = position_steps(position, at, seen)
    turned = np.diff(odometer, prepend=np.nan)
    turned[1:][~seen[:-1]] = np.nan
    if not len(at) or not np.nanmax(odometer, initial=0.0) > 0.0:
        length = float(moved.steps.sum())
        return DrivenPath(length, moved.unseen, 0.0, by_odometry=False, jumps=moved.jumps)
    wheels = np.maximum(np.nan_to_num(turned), 0.0)
    slipped = _slipped(wheels, moved, at, seen, trusted)
    # A run's odometer only grows: over a gap it knows more than the straight line, over a restart
    # nothing.
    in_gaps = float(np.nansum(np.maximum(np.diff(odometer)[~seen[:-1]], 0.0)))
    length, unseen = float(wheels.sum()) - slipped, max(moved.unseen, in_gaps)
    return DrivenPath(length, unseen, slipped, by_odometry=True, jumps=moved.jumps)


def position_steps(position: Floats, at: Floats, seen: Bools) -> PositionSteps:
    """Return how far the position moved to each state, without noise; see `path_travelled`."""
    steps = np.zeros(len(at))
    known = np.flatnonzero(np.isfinite(position).all(axis=1))
    known = known[_is_new(position[known])]
    pieces, unseen, jumps = _pieces(known, position, at, seen)
    noise = noise_of([(at[piece], position[piece]) for piece in pieces])
    for piece in pieces:
        smooth = smoothed(at[piece], position[piece], noise, WANDER)
        steps[piece] = steps_of(smooth, max(DEAD_BAND, BAND * noise))
    return PositionSteps(steps, unseen, jumps, noise)


def turned(theta: Floats, at: Floats, seen: Bools) -> float:
    """Return how far a robot turned in radians, left and right added, without noise."""
    known = np.flatnonzero(np.isfinite(theta))
    angle = np.full((len(theta), 1), np.nan)
    angle[known, 0] = np.unwrap(theta[known])
    known = known[_is_new(angle[known])]
    breaks = np.flatnonzero(~_together(known, seen)) + 1
    pieces = [piece for piece in np.split(known, breaks) if len(piece)]
    noise = noise_of([(at[piece], angle[piece]) for piece in pieces])
    band = max(TURN_BAND, BAND * noise)
    return math.fsum(
        float(steps_of(smoothed(at[piece], angle[piece], noise, TURN_WANDER), band).sum())
        for piece in pieces
    )


def noise_of(pieces: list[tuple[Floats, Floats]]) -> float:
    """Return the standard deviation of noise along one axis, from pieces of times, (n,), and
    values, (n, axes): each value is compared with the line through its neighbours (Gasser et al.,
    formula 2.1), and the median of these residuals is not moved by corners and starts.
    """
    residuals = [_residuals(*piece) for piece in pieces if len(piece[0]) > 2]
    found = np.abs(np.concatenate(residuals)) if residuals else np.empty(0)
    return float(np.median(found)) / 0.6745 if found.size else 0.0


def _residuals(at: Floats, values: Floats) -> Floats:
    before, after = np.diff(at)[:-1, None], np.diff(at)[1:, None]
    left, right = after / (before + after), before / (before + after)
    off_line = left * values[:-2] + right * values[2:] - values[1:-1]
    return np.ravel(off_line / np.sqrt(1.0 + left**2 + right**2))


def smoothed(at: Floats, values: Floats, noise: float, wander: float) -> Floats:
    """Return values, (n, axes), without noise of that standard deviation; `wander` is q above."""
    if len(at) < LEAST_SMOOTHED or noise < LEAST_NOISE:
        return values
    apart = np.cumsum(np.maximum(np.diff(at, prepend=at[0]), SHORTEST_STEP))
    spline = scipy.interpolate.make_smoothing_spline(apart, values, lam=noise**2 / wander)
    return np.asarray(spline(apart))


def steps_of(values: Floats, band: float) -> Floats:
    """Return how far a point, (n, axes), moved to each state, (n,), in steps of `band` or more."""
    steps = np.zeros(len(values))
    rows = values.tolist()
    last = rows[0] if rows else []
    for index, here in enumerate(rows):
        step = math.dist(here, last)
        if step >= band:
            steps[index], last = step, here
    return steps


def _is_new(values: Floats) -> Bools:
    """Tell of each position whether it is a new measurement, not the last one reported again."""
    found: Bools = np.ones(len(values), dtype=np.bool_)
    found[1:] = np.diff(values, axis=0).any(axis=1)
    return found


def _together(known: Counts, seen: Bools) -> Bools:
    """Tell of each pair of neighbours among states whether all the time between them was seen."""
    holes = np.concatenate(([0], np.cumsum(~seen)))
    return np.asarray(holes[known[1:]] == holes[known[:-1]])


def _pieces(
    known: Counts, position: Floats, at: Floats, seen: Bools
) -> tuple[list[Counts], float, int]:
    """Return pieces of states without gap or jump, metres straight over gaps, and jumps."""
    together = _together(known, seen)
    steps = np.hypot(*np.diff(position[known], axis=0).T)
    jumped = steps > JUMP_SPEED * np.maximum(np.diff(at[known]), 0.0) + JUMP_SLACK
    pieces = np.split(known, np.flatnonzero(~together | jumped) + 1)
    unseen = float(steps[~together & ~jumped].sum())
    return [piece for piece in pieces if len(piece)], unseen, int(jumped.sum())


def _slipped(
    wheels: Floats, moved: PositionSteps, at: Floats, seen: Bools, trusted: Bools
) -> float:
    """Return the metres by which wheels went farther than the position where they slipped."""
    slack, found = max(DEAD_BAND, BAND * moved.noise), 0.0
    for window in _windows(at, seen):
        if not trusted[window].all():
            continue
        turned_, went = float(wheels[window].sum()), float(moved.steps[window].sum())
        if turned_ > SLIP_LEAST and turned_ - went > SLIP_SHARE * turned_ + slack:
            found += turned_ - went
    return found


def _windows(at: Floats, seen: Bools) -> Iterator[slice]:
    """Yield stretches of SLIP_SECONDS without a gap, and shorter ones before gaps."""
    start = 0
    for index in range(len(at)):
        is_last = index + 1 == len(at) or not seen[index]
        if is_last or at[index] - at[start] >= SLIP_SECONDS:
            yield slice(start, index + 1)
            start = index + 1
