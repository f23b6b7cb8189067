"""Metrics of sessions and of segments between checkpoints; what cannot be known is NaN, not 0."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from experiments.analysis.metrics.definitions import METRICS, SEGMENT_METRICS
from experiments.analysis.metrics.geodesic import nearer
from experiments.analysis.metrics.milestones import Milestones, docking_attempts, milestones
from experiments.analysis.metrics.motion import drive
from experiments.dataset.columns import Column, Columns, Floats
from experiments.dataset.grouping import by_key
from experiments.dataset.levels import METHODS, WAYS
from experiments.dataset.record_quality import record_numbers
from experiments.dataset.records import COMPLETED, Dataset, EventRecord, SessionRecord
from experiments.dataset.states import SERIES
from experiments.dataset.trajectory import Trajectory
from experiments.definition.schema import Course

Values = dict[str, float]


@dataclass(frozen=True)
class CheckpointSegment:
    """From one checkpoint to the next, by number; 0 is the charging station, at both ends. Times
    are in the session's seconds.
    """

    session: str
    number: int
    begins: int
    ends: int
    start: float
    end: float
    values: Values


@dataclass(frozen=True)
class Measured:
    """A session with its metrics, its segments in order, and its positions, (n, 2) metres."""

    session: SessionRecord
    milestones: Milestones
    values: Values
    segments: tuple[CheckpointSegment, ...]
    positions: Floats


def measure_all(dataset: Dataset) -> list[Measured]:
    events = by_key((event.session, event) for event in dataset.events)
    return [measure(dataset, session, events.get(session.id, [])) for session in dataset.sessions]


def measure(dataset: Dataset, session: SessionRecord, events: Iterable[EventRecord]) -> Measured:
    course = dataset.course(session)
    found = milestones(session, events, course)
    whole = Trajectory.of(dataset.states(session.id))
    network = dataset.network(session.id)
    task = whole.between(found.start, found.end)
    segments = tuple(_segments(dataset, session, found, task, network))
    values = record_numbers(session, whole) | _numbers(task, network)
    values |= _times(session, found, course)
    values["seen"] = task.share_seen(found.end - found.start)
    if course is not None and not math.isnan(found.last_checkpoint):
        dock = course.checkpoints[0]
        attempts = docking_attempts(task, (dock.x, dock.y), found.last_checkpoint)
        values["docking_attempts"] = float(attempts)
    known = [one.values for one in segments if not math.isnan(one.values["efficiency"])]
    if known:
        for name in ("shortest", "efficiency_bounded"):
            values[name] = math.fsum(one[name] for one in known)
        values["efficiency"] = _share(values["shortest"], math.fsum(map(_distance, known)))
    positions = np.column_stack((task.states["x"], task.states["y"]))
    positions = positions[np.isfinite(positions).all(axis=1)]
    return Measured(session, found, _ordered(values, METRICS), segments, positions)


def _ordered(values: Values, columns: Iterable[Column]) -> Values:
    """Return all columns in their order, the unknown ones as NaN."""
    return {column.name: values.get(column.name, math.nan) for column in columns}


def _times(session: SessionRecord, found: Milestones, course: Course | None) -> Values:
    is_completed, passed = session.outcome == COMPLETED, len(found.checkpoints)
    asks_photo = course is not None and course.photo is not None
    has_stops = passed or (course is not None and len(course.checkpoints) > 1)
    return {
        "completed": float(is_completed) if session.outcome else math.nan,
        "total_time": found.end - found.start,
        "time_to_motion": found.motion - found.start,
        "task_time": found.docked - found.start if is_completed else math.nan,
        "docking_time": found.docked - found.last_checkpoint,
        "passed": float(passed) if has_stops else math.nan,
        "photo": float(not math.isnan(found.photo)) if asks_photo else math.nan,
    }


def _numbers(track: Trajectory, network: Columns) -> Values:
    if not len(track):
        return _link(network)
    found = drive(track)
    if found.get("path_by_odometry"):
        # A run's odometer only grows; the distance between two runs is not known.
        steps = np.maximum(np.diff(track.states["distance"]), 0.0)
        is_one_run = np.diff(track.states["boot"]) == 0.0
        found["odometer"] = float(np.nansum(np.where(is_one_run, steps, 0.0)))
    return found | _commands(track.states) | _link(network)


def _commands(states: Columns) -> Values:
    counts = states["commands"]
    count, refused = float(np.nansum(counts)), float(np.nansum(states["refused"]))
    found = {"commands": count, "refused": refused}
    if count + refused:
        found["share_refused"] = refused / (count + refused)
        found["share_too_old"] = _or_nan(states["too_old"], np.sum) / (count + refused)
    if not count:
        return found
    for name, source in _SHARES.items():
        found[name] = float(np.nansum(states[source])) / count
    found["command_age"] = float(np.nansum(states["age_sum"])) / count
    _, found["command_age_p95"] = _median_and_p95(states["age_max"][counts > 0])
    # A state, a quarter of a second, counts as often as it has commands.
    times = np.nan_to_num(counts).astype(np.int64)
    ages = np.repeat(states["age_sum"] / np.maximum(times, 1), times)
    found["command_age_median"], _ = _median_and_p95(ages)
    answers = np.repeat(states["answer_age"], times)
    found["answer_age"], found["answer_age_p95"] = _median_and_p95(answers)
    # Means over the commands; unknown where the robot did not report them.
    some = counts > 0
    found["share_slowed"] = float(states["slowed"][some].sum() / counts[some].sum())
    for name in SERIES:
        speeds = np.abs(states[f"{name}_linear"][some]) * counts[some]
        found[f"{name}_speed"] = float(speeds.sum() / counts[some].sum())
    return found


_SHARES = {f"share_{method}": f"by_{method}" for method in METHODS} | {
    f"share_{channel}": f"on_{channel}" for channel in WAYS
}


def _or_nan(values: Floats, summary: Callable[[Floats], np.float64]) -> float:
    """Return a summary of the known values, NaN without any."""
    known = values[np.isfinite(values)]
    return float(summary(known)) if known.size else math.nan


def _median_and_p95(values: Floats) -> tuple[float, float]:
    """Return the median and the 95th percentile of the known values, NaN without any."""
    known = values[np.isfinite(values)]
    if not known.size:
        return math.nan, math.nan
    return float(np.median(known)), float(np.quantile(known, 0.95))


def _link(network: Columns) -> Values:
    trips, trips_p95 = _median_and_p95(network["round_trip"])
    age, age_p95 = _median_and_p95(network["frame_age"])
    return {
        "round_trip": trips,
        "round_trip_p95": trips_p95,
        "loss": _or_nan(network["loss"], np.mean),
        "fps": _or_nan(network["fps"], np.mean),
        "freezes": _or_nan(network["freezes"], np.sum),
        "frame_age": age,
        "frame_age_p95": age_p95,
    }


def _segments(
    dataset: Dataset, session: SessionRecord, found: Milestones, task: Trajectory, network: Columns
) -> Iterator[CheckpointSegment]:
    course = dataset.course(session)
    if course is None:
        return
    legs = [*course.checkpoints, course.checkpoints[0]]
    times: Mapping[int, float] = {0: found.start, **found.checkpoints}
    passed = (found.checkpoints.get(stop.number, math.nan) for stop in course.checkpoints[1:])
    ends = [*passed, found.docked]
    for number, ((begin, end), at) in enumerate(zip(pairwise(legs), ends, strict=True), start=1):
        start = times.get(begin.number, math.nan)
        if not at >= start:  # one of them never came
            continue
        part = task.between(start, at)
        during = network[(network["stamp"] >= start) & (network["stamp"] <= at)]
        values = {"seconds": at - start, "seen": part.share_seen(at - start)}
        values |= _numbers(part, during)
        shortest, path = _shortest(dataset, session, part, (end.x, end.y)), _distance(values)
        values |= {"shortest": shortest, "efficiency": _share(shortest, path)}
        if path > 0.0:
            values["efficiency_bounded"] = float(shortest > path)
        ordered = _ordered(values, SEGMENT_METRICS)
        yield CheckpointSegment(session.id, number, begin.number, end.number, start, at, ordered)


def _shortest(
    dataset: Dataset, session: SessionRecord, part: Trajectory, goal: tuple[float, float]
) -> float:
    plan = dataset.plans.get(session.site)
    positions = np.column_stack((part.states["x"], part.states["y"]))
    known = positions[np.isfinite(positions).all(axis=1)].tolist()
    if plan is None or not known:
        return math.nan
    first, last = ((x, y) for x, y in (known[0], known[-1]))
    return nearer(plan, frozenset(session.doors_closed), goal, first, last)


def _distance(values: Values) -> float:
    """Return the distance driven including gaps, which the shortest path covers, too."""
    return values.get("path", 0.0) + values.get("path_unseen", 0.0)


def _share(shortest: float, path: float) -> float:
    """Return the efficiency. Above 1, it is measurement noise, and a straight line over cells that
    is up to 3 % too long.
    """
    return min(1.0, shortest / path) if path > 0.0 else math.nan
