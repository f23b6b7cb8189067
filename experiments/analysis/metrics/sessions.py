"""What a session was like in numbers, and each of its segments from checkpoint to checkpoint.

metrics/definitions.py names them with unit and meaning. A number that cannot be known is NaN, never
zero.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from experiments.analysis.metrics.definitions import DRIVING, METRICS, SEGMENT_METRICS
from experiments.analysis.metrics.geodesic import nearer
from experiments.analysis.metrics.milestones import Milestones, docking_attempts, milestones
from experiments.analysis.metrics.motion import Trajectory, drive
from experiments.dataset.columns import Columns, Floats
from experiments.dataset.levels import METHODS, WAYS
from experiments.dataset.records import COMPLETED, Dataset, EventRecord, SessionRecord
from experiments.dataset.states import SERIES
from experiments.definition.schema import Course

Values = dict[str, float]


@dataclass(frozen=True)
class CheckpointSegment:
    """From one checkpoint to the next: 0 stands for the charging station at both ends; `values` by
    SEGMENT_METRICS' names.
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
    """A session with its numbers by METRICS' names, its segments in order, and its way, (n, 2)
    metres.
    """

    session: SessionRecord
    milestones: Milestones
    values: Values
    segments: tuple[CheckpointSegment, ...]
    way: Floats


def measure_all(dataset: Dataset) -> list[Measured]:
    """Return every session with its numbers, in the dataset's order."""
    events: dict[str, list[EventRecord]] = {}
    for event in dataset.events:
        events.setdefault(event.session, []).append(event)
    return [measure(dataset, session, events.get(session.id, [])) for session in dataset.sessions]


def measure(dataset: Dataset, session: SessionRecord, events: Iterable[EventRecord]) -> Measured:
    """Return a session with its numbers."""
    course = dataset.course(session)
    found = milestones(session, events, course)
    whole = Trajectory.of(dataset.states(session.id))
    network = dataset.network(session.id)
    task = whole.between(found.start, found.end)
    segments = tuple(_segments(dataset, session, course, found, task, network))
    values = _times(session, found) | _numbers(task, network) | _record(session, whole)
    values["seen"] = task.share_seen(found.end - found.start)
    if course is not None and not math.isnan(found.last_checkpoint):
        dock = course.checkpoints[0]
        values["docking_attempts"] = float(
            docking_attempts(task, (dock.x, dock.y), found.last_checkpoint)
        )
    driven = [
        segment.values for segment in segments if not math.isnan(segment.values["efficiency"])
    ]
    values["shortest"] = math.fsum(one["shortest"] for one in driven) if driven else math.nan
    values["efficiency"] = _share(values["shortest"], math.fsum(_driven(one) for one in driven))
    values["efficiency_bounded"] = (
        math.fsum(one["efficiency_bounded"] for one in driven) if driven else math.nan
    )
    ordered = {column.name: values.get(column.name, math.nan) for column in METRICS}
    way = np.column_stack((task.states["x"], task.states["y"]))
    return Measured(session, found, ordered, segments, way[np.isfinite(way).all(axis=1)])


def _times(session: SessionRecord, found: Milestones) -> Values:
    return {
        "completed": float(session.outcome == COMPLETED) if session.outcome else math.nan,
        "total_time": found.end - found.start,
        "time_to_motion": found.motion - found.start,
        "task_time": found.docked - found.start if session.outcome == COMPLETED else math.nan,
        "docking_time": found.docked - found.last_checkpoint,
        "passed": float(len(found.checkpoints)),
        "photo": float(not math.isnan(found.photo)),
    }


def _numbers(track: Trajectory, network: Columns) -> Values:
    return _driving(track) | _commands(track) | _link(network)


def _driving(track: Trajectory) -> Values:
    if not len(track):
        return {}
    found = drive(track)
    return {
        column.name: float(getattr(found, column.name))
        for column in DRIVING
        if hasattr(found, column.name)
    } | {"odometer": _odometer(track)}


def _odometer(track: Trajectory) -> float:
    """A run's odometer only grows; what lies between two runs is not known."""
    steps = np.diff(track.states["distance"])
    same = np.diff(track.states["boot"]) == 0.0
    return float(np.nansum(np.where(same, np.maximum(steps, 0.0), 0.0)))


def _commands(track: Trajectory) -> Values:
    if not len(track):
        return {}
    states = track.states
    count = float(np.nansum(states["commands"]))
    refused = float(np.nansum(states["refused"]))
    found = {"commands": count, "refused": refused}
    if count + refused:
        found["share_refused"] = refused / (count + refused)
        found["share_too_old"] = _known_sum(states["too_old"]) / (count + refused)
    if not count:
        return found
    ages = states["age_max"][states["commands"] > 0]
    ages = ages[np.isfinite(ages)]
    found |= {
        f"share_{method}": float(np.nansum(states[f"by_{method}"])) / count for method in METHODS
    }
    found |= {f"share_{way}": float(np.nansum(states[f"on_{way}"])) / count for way in WAYS}
    found["command_age"] = float(np.nansum(states["age_sum"])) / count
    found["command_age_p95"] = _quantile(ages, 0.95)
    return found | _answered(states) | _asked_and_allowed(states)


def _asked_and_allowed(states: Columns) -> Values:
    """Means over the commands; of a session whose robot did not say it, unknown."""
    some = states["commands"] > 0
    counts = states["commands"][some]
    return {"share_slowed": float((states["slowed"][some]).sum() / counts.sum())} | {
        f"{name}_speed": float(
            (np.abs(states[f"{name}_linear"][some]) * counts).sum() / counts.sum()
        )
        for name in SERIES
    }


def _median(values: Floats) -> float:
    """Return the median, NaN of nothing. NumPy's takes ten times as long for so few."""
    if not values.size:
        return math.nan
    ordered, half = np.sort(values), values.size // 2
    return float(ordered[half] if values.size % 2 else (ordered[half - 1] + ordered[half]) / 2.0)


def _quantile(values: Floats, share: float) -> float:
    """Return the value below which a share lies, straight between neighbours as NumPy's does it;
    NaN of nothing.
    """
    if not values.size:
        return math.nan
    place = share * (values.size - 1)
    below = math.floor(place)
    low, high = np.sort(values)[[below, min(below + 1, values.size - 1)]].tolist()
    beyond = place - below
    step = high - low
    return float(high - step * (1.0 - beyond) if beyond >= 0.5 else low + step * beyond)


def _known_sum(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.sum()) if known.size else math.nan


def _answered(states: Columns) -> Values:
    """A quarter of a second counts as often as it has commands."""
    counts = np.nan_to_num(states["commands"]).astype(np.int64)
    some = np.maximum(counts, 1)
    ages, answers = (
        np.repeat(values, counts) for values in (states["age_sum"] / some, states["answer_age"])
    )
    ages, answers = ages[np.isfinite(ages)], answers[np.isfinite(answers)]
    return {
        "command_age_median": _median(ages),
        "answer_age": _median(answers),
        "answer_age_p95": _quantile(answers, 0.95),
    }


def _link(network: Columns) -> Values:
    def known(name: str) -> Floats:
        values: Floats = network[name]
        return values[np.isfinite(values)]

    trips, loss, fps, ages, freezes = (
        known("round_trip"),
        known("loss"),
        known("fps"),
        known("frame_age"),
        known("freezes"),
    )
    return {
        "round_trip": _median(trips),
        "round_trip_p95": _quantile(trips, 0.95),
        "loss": float(loss.mean()) if loss.size else math.nan,
        "fps": float(fps.mean()) if fps.size else math.nan,
        "freezes": float(freezes.sum()) if freezes.size else math.nan,
        "frame_age": _median(ages),
        "frame_age_p95": _quantile(ages, 0.95),
    }


def _record(session: SessionRecord, track: Trajectory) -> Values:
    gaps, offsets = track.gaps(), np.abs(track.states["clock_offset"])
    known = offsets[np.isfinite(offsets)]
    return {
        "rate": track.rate(),
        "gaps": float(len(gaps)),
        "longest_gap": float(gaps.max()) if gaps.size else 0.0 if len(track) > 1 else math.nan,
        "missing_states": float(max(session.missing, track.missing())),
        "clock_offset": float(known.max()) if known.size else math.nan,
    }


def _segments(
    dataset: Dataset,
    session: SessionRecord,
    course: Course | None,
    found: Milestones,
    task: Trajectory,
    network: Columns,
) -> Iterable[CheckpointSegment]:
    if course is None:
        return
    home = course.checkpoints[0]
    legs = [*course.checkpoints, home]
    times: Mapping[int, float] = {0: found.start, **found.checkpoints}
    ends = [
        *(found.checkpoints.get(stop.number, math.nan) for stop in course.checkpoints[1:]),
        found.docked,
    ]
    for number, (begin, end, at) in enumerate(zip(legs, legs[1:], ends, strict=False), start=1):
        start = times.get(begin.number, math.nan)
        if math.isnan(start) or math.isnan(at) or at < start:
            continue
        part = task.between(start, at)
        values = {"seconds": at - start} | _numbers(part, _during(network, start, at))
        values["shortest"] = _shortest(dataset, session, part, (end.x, end.y))
        values["seen"] = part.share_seen(at - start)
        driven = _driven(values)
        values["efficiency"] = _share(values["shortest"], driven)
        values["efficiency_bounded"] = (
            float(values["shortest"] > driven) if driven > 0.0 else math.nan
        )
        yield CheckpointSegment(
            session.id,
            number,
            begin.number,
            end.number,
            start,
            at,
            {one.name: values.get(one.name, math.nan) for one in SEGMENT_METRICS},
        )


def _during(network: Columns, start: float, end: float) -> Columns:
    inside = (network["stamp"] >= start) & (network["stamp"] <= end)
    return network[inside]


def _shortest(
    dataset: Dataset, session: SessionRecord, part: Trajectory, goal: tuple[float, float]
) -> float:
    plan = dataset.plans.get(session.site)
    x, y = part.states["x"], part.states["y"]
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if plan is None or not known.size:
        return math.nan
    first, last = (
        (float(x[known[0]]), float(y[known[0]])),
        (float(x[known[-1]]), float(y[known[-1]])),
    )
    return nearer(plan, frozenset(session.doors_closed), goal, first, last)


def _driven(values: Values) -> float:
    """All of the way that is known, as the shortest way leads over what was not seen, too."""
    return values.get("path", 0.0) + values.get("path_unseen", 0.0)


def _share(shortest: float, path: float) -> float:
    """Nobody drives less than the shortest way: what is above 1 is measuring noise, and a straight
    line over cells that is up to 3 % too long.
    """
    return min(1.0, shortest / path) if path > 0.0 else math.nan
