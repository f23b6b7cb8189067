import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, strategies as st

from experiments.definition.course import CourseError, CourseStop, Motion, PhotoSpot, lay_out
from experiments.definition.shipped import shipped
from robots.api.geometry import Pose2D, wrap_angle
from robots.world.sites import load_plan
from tests.support.examples import examples
from tests.support.studies.studies import cabin, small_study
from tests.support.studies.task_drives import START, Drive, cues, milestones, run

metres = st.floats(-5.0, 5.0)
points = st.tuples(metres, metres)


@pytest.mark.parametrize(
    ("series", "doors"),
    [("giraff", ["lab-door", "lounge-door"]), ("rhodon", ["lab-door", "lounge-door"])],
)
def test_suggested_path_of_the_paper_completes_its_task(series, doors):
    study, plan = shipped()["exploration"], load_plan("office")[0]
    condition = study.condition(f"{series}_open")
    track, course = lay_out(study, condition, plan), study.course_of(condition)
    drive = Drive()
    drive.records.clear()
    (drive.x, drive.y), drive.at = course.path[0], START
    drive.see(docked=True)
    drive.records.extend(record for record in Drive().records if not hasattr(record, "seq"))
    engine = run(drive.go(*course.path).dock().records, track)
    assert [number for event, number in milestones(engine) if event == "checkpoint"] == [1, 2, 3, 4]
    assert sorted(engine.result.doors) == sorted(doors)
    assert (engine.result.outcome, engine.result.doors_missed) == ("completed", ())
    assert any(key.startswith("photo_") for key in cues(engine)) is (series == "giraff")


def test_doors_that_a_condition_closes_are_not_required():
    study = small_study()
    assert [
        door.required for door in lay_out(study, study.condition("all_open"), cabin()).doorways
    ] == [True]
    assert [
        door.required for door in lay_out(study, study.condition("shut"), cabin()).doorways
    ] == [False]


def test_a_course_that_does_not_fit_the_plan_is_an_error():
    study = shipped()["exploration"]
    with pytest.raises(CourseError):
        lay_out(study, study.conditions[0], cabin())


@examples(50, thorough=1000)
@given(start=points, end=points, x=metres, y=metres, theta=st.floats(-3.1, 3.1))
def test_distance_to_the_mirror_is_half_that_to_the_reflection(start, end, x, y, theta):
    assume(math.dist(start, end) > 0.5)
    sight = PhotoSpot(CourseStop(1, 0.0, 0.0, 1.0), 1.0, 0.6, start, end).sight(Pose2D(x, y, theta))
    # The reflection of the point, by complex numbers: z' = a + conj((z - a) / d) d with d along the
    # mirror.
    a, d = complex(*start), complex(*end) - complex(*start)
    d /= abs(d)
    reflection = a + ((complex(x, y) - a) / d).conjugate() * d
    away = reflection - complex(x, y)
    assert abs(away) == pytest.approx(2.0 * abs(sight.distance), abs=1e-9)
    if sight.distance > 0.01:
        bearing = math.atan2(away.imag, away.real) - theta
        assert abs(wrap_angle(bearing - sight.bearing)) < 1e-6
    assert not sight.sees or (sight.before and sight.distance > 0.0 and abs(sight.bearing) <= 0.6)


@examples(50, thorough=1000)
@given(line=st.lists(points, min_size=2, max_size=30))
def test_crossings_of_a_door_alternate_between_its_sides(line):
    door = ((0.0, -50.0), (0.0, 50.0))  # too long to drive around
    crossings = sum(Motion(one, other).crosses(*door) for one, other in pairwise(line))
    changed_side = (line[0][0] < 0.0) != (line[-1][0] < 0.0)
    assert crossings % 2 == changed_side


@examples(50, thorough=1000)
@given(start=points, end=points, x=metres, y=metres)
def test_the_nearest_point_of_a_motion_is_nearer_than_any_other(start, end, x, y):
    nearest = math.dist(Motion(start, end).nearest(x, y), (x, y))
    for n in range(11):
        other = (start[0] + n / 10 * (end[0] - start[0]), start[1] + n / 10 * (end[1] - start[1]))
        assert nearest <= math.dist(other, (x, y)) + 1e-9
