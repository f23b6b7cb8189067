"""Figure 8: means where the table has them, shares as areas, and balances of 100 %."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from experiments.analysis.figures.opinions import WHOLE, figure_8a, figure_8b
from experiments.analysis.tables.paper_tables import table_5
from tests.support.analysis.colours import lightness
from tests.support.analysis.study_dataset import made_up

FLOOR = "#ffffff"


@pytest.fixture(scope="module")
def dataset():
    return made_up(np.random.default_rng(55), 12)


def answering(dataset, value):
    return reanswered(dataset, lambda _: value)


def reanswered(dataset, change):
    """The dataset with other answers about the experience: `change` of each answer."""
    responses = [
        replace(one, values={key: change(value) for key, value in one.values.items()})
        if one.questionnaire == "experience"
        else one
        for one in dataset.responses
    ]
    return replace(dataset, responses=tuple(responses))


def test_each_mean_has_its_place_and_the_interval_of_table_5(dataset):
    drawing, table = figure_8a(dataset), table_5(dataset)
    (axes,) = drawing.figure.axes
    points = {line.get_gid(): line for line in axes.lines if line.get_gid()}
    bars = [one for one in axes.containers if one.has_xerr]
    assert len(points) == len(bars) == len(table.rows)
    for row, point, bar in zip(table.rows, points.values(), bars, strict=True):
        mean, half = (row[table.head.index(name)].value for name in ("Mean", "CI95"))
        assert point.get_xdata()[0] == pytest.approx(mean)
        (whisker,) = bar.lines[2]
        left, right = whisker.get_segments()[0][:, 0]
        assert (left, right) == pytest.approx((mean - half, mean + half))
        assert f"{abs(mean):.2f} ± {half:.2f}" in " ".join(one.get_text() for one in axes.texts)


def test_area_of_a_disc_is_its_share_and_it_links_to_the_sessions(dataset):
    drawing = figure_8a(dataset)
    discs = {one.get_gid(): one for one in drawing.figure.axes[0].collections if one.get_gid()}
    assert set(drawing.behind) >= set(discs)
    for row in drawing.numbers.rows:
        assert math.fsum(cell.value for cell in row[4:]) == pytest.approx(100.0, abs=0.5)
    whole = {}
    for gid, disc in discs.items():
        kind = gid.partition("-statement-")[2] or gid.partition("-topic-")[2] or "overall"
        whole[kind] = whole.get(kind, 0.0) + disc.get_sizes()[0]
    assert all(total == pytest.approx(WHOLE) for total in whole.values())


@pytest.mark.parametrize("value", [-2, 0, 2])
def test_the_whole_scale_is_shown_wherever_the_mean_is(dataset, value):
    (axes,) = figure_8a(answering(dataset, value)).figure.axes
    assert axes.get_xticks().tolist() == [-2, -1, 0, 1, 2]
    low, high = axes.get_xlim()
    assert low < -2.0 < 2.0 < high


def test_points_and_discs_can_be_distinguished_without_colours(dataset):
    (axes,) = figure_8a(dataset).figure.axes
    point = next(line.get_color() for line in axes.lines if line.get_gid())
    rgb = next(one for one in axes.collections if one.get_gid()).get_facecolor()[0]
    disc = "#" + "".join(f"{round(255 * part):02x}" for part in rgb[:3])
    assert lightness(disc) - lightness(point) > 50.0
    assert lightness(FLOOR) - lightness(disc) > 10.0


def test_balances_fill_100_percent(dataset):
    for row in figure_8b(dataset).numbers.rows:
        assert row[2].value + row[3].value == pytest.approx(100.0)


def test_a_balance_leads_to_the_same_sessions_on_a_scale_from_1_to_5(dataset):
    def moved(one):
        scales = {
            key: tuple(msgspec.structs.replace(it, value=it.value + 3) for it in points)
            for key, points in one.scales.items()
        }
        return msgspec.structs.replace(one, scales=scales)

    asked = [moved(one) if one.slug == "experience" else one for one in dataset.questionnaires]
    shifted = reanswered(dataset, lambda value: value + 3)
    shifted = replace(shifted, questionnaires=tuple(asked))
    expected = figure_8b(dataset).behind
    assert any(key.startswith("nonpositive") and ids for key, ids in expected.items())
    assert figure_8b(shifted).behind == expected
