"""Figure 7: a panel a robot and condition, which shows the part of the plan that was recorded."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.figures.floor import AROUND, view_of, whole_of
from experiments.analysis.figures.trajectories import TALLEST, figure_7
from experiments.analysis.metrics.sessions import measure_all
from tests.support.analysis.study_dataset import made_up


@pytest.fixture(scope="module")
def dataset():
    return made_up(np.random.default_rng(54), 8)


@pytest.fixture(scope="module")
def measured(dataset):
    return measure_all(dataset)


def lines_of(axes):
    return [one.get_gid() for one in axes.lines if str(one.get_gid()).startswith("session-")]


def test_each_condition_has_a_panel_with_its_own_sessions(dataset, measured):
    drawing = figure_7(dataset, measured)
    titles = {one.key: one.title["en"] for one in dataset.study.conditions}
    recorded = [one for one in measured if len(one.positions)]
    conditions = {one.session.condition for one in recorded}
    panels = [axes for axes in drawing.figure.axes if lines_of(axes)]
    assert len(panels) == len(conditions) > 1
    for axes in panels:
        own = {gid.removeprefix("session-") for gid in lines_of(axes)}
        (condition,) = {one.session.condition for one in recorded if one.session.id in own}
        assert len(own) == sum(one.session.condition == condition for one in recorded)
        assert titles[condition] in axes.get_title("left").replace("\n", " ")
        assert axes.get_title("left").count("Giraff") < 2  # the condition begins with the robot
    assert sorted(drawing.behind) == sorted(gid for axes in panels for gid in lines_of(axes))
    assert drawing.figure.get_size_inches()[1] <= TALLEST


def test_the_panels_of_a_site_show_the_same_part_of_its_plan(dataset, measured):
    panels = [axes for axes in figure_7(dataset, measured).figure.axes if lines_of(axes)]
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in panels}) == 1


def test_lines_are_thin_and_fainter_where_they_are_many(dataset, measured):
    first = next(one for one in measured if len(one.positions))
    alone = figure_7(dataset, [first]).figure.axes[0]
    many = figure_7(dataset, [first] * 16).figure.axes[0]
    one, several = (
        next(line for line in axes.lines if line.get_gid() in lines_of(axes))
        for axes in (alone, many)
    )
    assert one.get_linewidth() < 0.5
    assert several.get_alpha() < one.get_alpha()


def test_a_view_is_what_was_driven_with_some_room_and_no_more_than_the_plan(dataset):
    plan = dataset.plans["office"]
    whole = whole_of(plan)
    positions = np.array([[3.0, 3.0], [np.nan, np.nan], [4.0, 5.0]])
    assert view_of(plan, [positions]).tolist() == [
        [3.0 - AROUND, 3.0 - AROUND],
        [4.0 + AROUND, 5.0 + AROUND],
    ]
    assert (view_of(plan, [np.array([[-99.0, -99.0], [99.0, 99.0]])]) == whole).all()
    assert (view_of(plan, []) == whole).all()


def test_a_study_without_drives_shows_only_the_plan(dataset):
    drawing = figure_7(replace(dataset, sessions=()), [])
    (axes,) = drawing.figure.axes
    assert axes.get_title("left") == "(a) Giraff\n0 sessions of 0 participants"
    assert drawing.behind == {}
