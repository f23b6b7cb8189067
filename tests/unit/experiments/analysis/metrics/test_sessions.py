"""Metrics of made-up sessions against pandas, and of sessions that lack what others have."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pandas
import pytest

from experiments.analysis.metrics.definitions import METRICS, SEGMENT_METRICS
from experiments.analysis.metrics.milestones import docking_attempts, milestones
from experiments.analysis.metrics.sessions import measure, measure_all
from experiments.dataset.columns import columns_of
from experiments.dataset.levels import METHODS
from experiments.dataset.records import (
    Dataset,
    EventRecord,
    SessionRecord,
)
from experiments.dataset.states import NO_NETWORK, NO_STATES, STATES
from experiments.dataset.trajectory import Trajectory
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import made_up

STUDY = shipped()["exploration"]
DATASET = made_up(np.random.default_rng(8), 12)
MEASURED = measure_all(DATASET)


def frame(session):
    return pandas.DataFrame(DATASET.states(session))


@pytest.mark.parametrize(
    "one", [one for one in MEASURED if len(one.positions)], ids=lambda one: one.session.id
)
def test_metrics_agree_with_an_independent_computation(one):
    states = frame(one.session.id)
    at = states.stamp - states.clock_offset
    task = states[(at >= one.milestones.start) & (at <= one.milestones.end)]
    values = one.values
    assert values["total_time"] == pytest.approx(one.milestones.end - one.milestones.start)
    assert values["odometer"] == pytest.approx(task.distance.max() - task.distance.min())
    assert values["path"] == pytest.approx(
        np.hypot(task.x.diff(), task.y.diff()).sum(), rel=0.05, abs=0.05
    )
    assert values["collisions"] == task.contacts.sum()
    assert values["commands"] == task.commands.sum()
    assert values["command_age"] == pytest.approx(task.age_sum.sum() / task.commands.sum())
    assert values["command_age_p95"] == pytest.approx(
        task.age_max[task.commands > 0].quantile(0.95)
    )
    commanded = task[task.commands > 0]
    assert values["command_age_median"] == pytest.approx(
        (commanded.age_sum / commanded.commands).repeat(commanded.commands).median()
    )
    assert values["answer_age"] == pytest.approx(
        commanded.answer_age.repeat(commanded.commands).median()
    )
    assert values["answer_age_p95"] == pytest.approx(
        commanded.answer_age.repeat(commanded.commands).quantile(0.95)
    )
    assert sum(values[f"share_{method}"] for method in METHODS) == pytest.approx(1.0)
    assert values["rate"] == pytest.approx(4.0, abs=0.01)
    assert values["least_clearance"] == task.clearance.min()
    network = pandas.DataFrame(DATASET.network(one.session.id))
    assert values["round_trip"] == pytest.approx(network.round_trip.median())
    assert values["loss"] == pytest.approx(network.loss.mean())
    assert values["frame_age_p95"] == pytest.approx(network.frame_age.quantile(0.95))


def test_every_session_has_every_metric_and_every_segment_its_own():
    for one in MEASURED:
        assert list(one.values) == [column.name for column in METRICS]
        for segment in one.segments:
            assert list(segment.values) == [column.name for column in SEGMENT_METRICS]


def test_the_segments_of_a_completed_task_fill_its_time():
    for one in MEASURED:
        if one.session.outcome == "completed":
            assert [segment.number for segment in one.segments] == [1, 2, 3, 4, 5]
            assert sum(segment.values["seconds"] for segment in one.segments) == pytest.approx(
                one.values["task_time"]
            )


def test_no_driven_distance_is_below_the_shortest_path():
    found = [
        one.values["efficiency"] for one in MEASURED if not math.isnan(one.values["efficiency"])
    ]
    assert found
    assert all(0.5 < value <= 1.0 for value in found)


def test_a_session_without_anything_is_full_of_unknowns_and_no_error():
    session = SessionRecord("s", "a", "giraff", site="office", outcome="connection_refused")
    found = measure(
        replace(
            DATASET, sessions=(session,), states=lambda _: NO_STATES, network=lambda _: NO_NETWORK
        ),
        session,
        (),
    )
    assert found.segments == ()
    assert len(found.positions) == 0
    assert math.isnan(found.values["path"])
    assert math.isnan(found.values["efficiency"])
    assert found.values["passed"] == 0.0


def test_a_robot_without_course_or_plan_is_measured_all_the_same():
    one = next(one for one in MEASURED if len(one.positions))
    session = replace(one.session, robot="unknown", site="moon")
    states = DATASET.states(one.session.id)
    found = measure(replace(DATASET, states=lambda _: states), session, ())
    assert found.values["path"] == pytest.approx(one.values["path"], rel=0.1)
    assert math.isnan(found.values["efficiency"])


def test_a_course_without_a_photo_task_has_no_photo_metric():
    one = next(one for one in MEASURED if one.session.outcome == "completed")
    for photo, value in ((STUDY.courses[0].photo, 0.0), (None, math.nan)):
        courses = tuple(msgspec.structs.replace(it, photo=photo) for it in STUDY.courses)
        study = msgspec.structs.replace(STUDY, courses=courses)
        found = measure(replace(DATASET, study=study), one.session, ())
        assert found.values["photo"] == pytest.approx(value, nan_ok=True)


def test_a_drive_without_a_course_has_no_checkpoints_to_pass():
    session = SessionRecord("s", "a", "giraff", site="moon", outcome="cancelled")
    nothing = replace(DATASET, states=lambda _: NO_STATES, network=lambda _: NO_NETWORK)
    values = measure(nothing, session, ()).values
    empty = ("passed", "photo", "gaps", "missing_states")
    assert {name for name in empty if math.isnan(values[name])} == set(empty)


def test_docking_counts_once_every_checkpoint_was_passed():
    session = SessionRecord("s", "a", "giraff", site="office", first_frame=0.0, ended=99.0)
    course = STUDY.courses[0]
    early = [
        EventRecord("s", 10.0, "task", "docked"),
        *(EventRecord("s", 20.0 + n, "task", "checkpoint", {"number": n}) for n in (1, 2, 3)),
    ]
    assert math.isnan(milestones(session, early, course).docked)
    late = [
        *early,
        EventRecord("s", 30.0, "task", "checkpoint", {"number": 4}),
        EventRecord("s", 40.0, "task", "docked"),
    ]
    assert milestones(session, reversed(late), course).docked == 40.0


def test_malformed_event_is_no_milestone():
    session = SessionRecord("s", "a", "giraff")
    events = [
        EventRecord("s", 1.0, "task", "checkpoint", data)
        for data in ({}, {"number": "4"}, {"number": None}, {"number": -1})
    ]
    assert milestones(session, events, STUDY.courses[0]).checkpoints == {}


def test_coming_near_the_station_twice_is_two_attempts():
    x = np.array([3.0, 1.0, 0.7, 0.9, 0.7, 1.0, 2.0, 0.5, 0.1])
    n = len(x)
    track = Trajectory.of(
        columns_of(
            STATES,
            stamp=np.arange(n),
            clock_offset=np.zeros(n),
            boot=np.zeros(n),
            x=x,
            y=np.zeros(n),
        )
    )
    assert docking_attempts(track, (0.0, 0.0), 0.0) == 2
    assert docking_attempts(track, (0.0, 0.0), 7.5) == 1


def test_a_dataset_without_sessions_has_nothing_to_measure():
    assert measure_all(Dataset(STUDY)) == []
