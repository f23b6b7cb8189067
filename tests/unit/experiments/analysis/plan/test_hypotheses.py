"""A report tells what was planned from what was not."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.plan.hypotheses import (
    NO_PLAN,
    NOT_PLANNED,
    SENSITIVITY,
    decisions_of,
    exclusion_effects,
    hypotheses_table,
    marked_table,
)
from experiments.analysis.report import report
from experiments.analysis.statistics.comparisons import holm
from experiments.analysis.tables.declared import declared
from tests.support.analysis.planned import PLAN, hypothesis, plan_with
from tests.support.analysis.planned_data import planned_data


def times(difference=30.0, people=12, seed=4):
    rng = np.random.default_rng(seed)
    shut = rng.normal(100.0 + difference, 10.0, people)
    return {"shut": shut.tolist(), "all_open": rng.normal(100.0, 10.0, people).tolist()}


def column(table, head):
    return [row[table.head.index(head)].text for row in table.rows]


def declared_of(plan, **more):
    dataset, measured = planned_data(plan, times(**more))
    tables = declared(dataset, measured)
    return tables, hypotheses_table(dataset.study, decisions_of(dataset.study, tables))


def whole(plan, **more):
    """The whole report, and the one on a sensitivity analysis."""
    dataset, measured = planned_data(plan, times())
    dataset = replace(dataset, **more)
    return report(dataset, {one.session.id: one for one in measured}, dataset)


def test_each_declared_test_names_its_hypothesis_or_is_exploratory():
    (driving, answers), _ = declared_of(PLAN)
    assert column(driving, "Measure") == ["task_time", "stops"]
    assert column(driving, "Plan") == ["h1", "exploratory"]
    assert column(answers, "Plan") == ["exploratory"]


def test_a_hypothesis_has_its_test_and_its_direction():
    (driving, _), table = declared_of(PLAN)
    assert column(table, "Hypothesis") == ["h1"]
    assert column(table, "Test") == ["driving: shut - open"]
    assert column(table, "As expected") == ["yes"]
    assert column(table, "Significant") == ["yes"]
    assert column(table, "p")[0] == column(driving, "p")[0]
    assert "h1: A closed door takes time." in table.notes


def test_a_difference_in_the_other_direction_is_not_as_expected():
    _, table = declared_of(plan_with(hypotheses=[hypothesis(direction="less")]))
    assert (column(table, "As expected"), column(table, "Significant")) == (["no"], ["yes"])


def test_a_family_corrects_across_analyses():
    both = [hypothesis(), hypothesis(key="h2", analysis="answers", measures=[], direction="less")]
    plan = plan_with(hypotheses=both, families=[{"key": "all", "hypotheses": ["h1", "h2"]}])
    _, table = declared_of(plan, difference=8.0)
    at, corrected = (table.head.index(head) for head in ("p", "p (family)"))
    ps = [row[at].value for row in table.rows]
    assert [row[corrected].value for row in table.rows] == pytest.approx(holm(ps))


def test_a_difference_of_nothing_is_in_no_direction():
    same = {"shut": [90.0, 100.0, 110.0], "all_open": [110.0, 90.0, 100.0]}
    for direction in ("less", "greater"):
        dataset, measured = planned_data(
            plan_with(hypotheses=[hypothesis(direction=direction)]), same
        )
        decisions = decisions_of(dataset.study, declared(dataset, measured))
        assert column(hypotheses_table(dataset.study, decisions), "As expected") == ["no"]


@pytest.mark.parametrize("plan", [None, plan_with(hypotheses=[])])
def test_without_a_hypothesis_every_test_is_exploratory(plan):
    found = whole(plan)
    tested = [table for table in found.tables if "p" in table.head]
    assert len(tested) > 4
    assert all(NOT_PLANNED in table.notes for table in tested)
    (cells,) = next(table for table in found.tables if table.name == "hypotheses").rows
    assert cells[0].text.endswith("everything here is exploratory.")
    assert (cells[0].text == NO_PLAN) == (plan is None)


def test_other_tests_and_figures_of_a_study_with_a_plan_are_exploratory():
    found = whole(PLAN)
    notes = {table.name: table.notes for table in found.tables}
    assert NOT_PLANNED in notes["conditions"]
    assert NOT_PLANNED not in notes["analysis-driving"]
    assert NOT_PLANNED not in notes["flow"]
    figures = {figure.name: figure.numbers.notes for figure in found.figures}
    assert NOT_PLANNED in figures["figure-8a"]
    assert NOT_PLANNED not in figures["figure-7"]


def test_sensitivity_analysis_is_labelled_everywhere_and_decides_no_hypothesis():
    found = whole(PLAN, is_with_excluded=True)
    parts = [*found.tables[:-1], *(figure.numbers for figure in found.figures)]
    assert all(SENSITIVITY in part.notes for part in parts)
    assert found.decisions == {}
    assert SENSITIVITY in found.note
    assert "hypotheses" not in {table.name for table in found.tables}


def test_a_figure_of_planned_measures_names_the_hypothesis():
    about = [hypothesis(key="h2", analysis="answers", measures=[])]
    figures = {one.name: one.numbers.notes for one in whole(plan_with(hypotheses=about)).figures}
    assert "Shows measures of: h2." in figures["figure-8a"]


def test_a_table_without_tests_is_not_marked():
    (first, *_) = whole(PLAN).tables
    assert marked_table(first, is_sensitivity=False) == first


def test_exclusions_that_change_significance_are_named():
    dataset, measured = planned_data(PLAN, times(difference=0.0, people=8))
    raised = [
        one
        if one.session.condition == "all_open"
        else one.__class__(
            **{**vars(one), "values": {**one.values, "task_time": one.values["task_time"] + 40.0}}
        )
        for one in measured
    ]
    table = exclusion_effects(declared(dataset, raised), declared(dataset, measured), 0.05)
    assert column(table, "Significance")[0] == "changes"
    assert "The exclusions change the significance of: driving, task_time, shut - open." in (
        table.notes
    )
    same = exclusion_effects(declared(dataset, measured), declared(dataset, measured), 0.05)
    assert "The exclusions change the significance of no declared test." in same.notes
