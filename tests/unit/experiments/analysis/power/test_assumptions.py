"""Assumptions about a measure come from the plan or from the defaults."""

from experiments.analysis.power.draws import assumed
from tests.support.analysis.powered import expected, powered_study


def test_expectations_come_from_the_plan_and_else_from_defaults():
    study = powered_study(expected=[expected(1, 30.0, sd=60.0), expected(0, 0.0)])
    found = assumed(study, "task_time")
    assert (found.source, found.mean("c1"), found.sd("c0"), found.correlation) == (
        *("plan", 30.0, 60.0),
        0.5,
    )
    default = assumed(powered_study(), "task_time")
    assert (default.source, default.sd("c0"), default.correlation) == ("default", 1.0, 0.5)


def test_levels_of_a_proportion_are_what_the_plan_expects_in_each_condition():
    found = assumed(powered_study(expected=[expected(0, 0.0, level=0.9)]), "task_time")
    assert found.levels == {"c0": 0.9}
