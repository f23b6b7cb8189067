"""The report finds the effects that are planted into the answers of bots, and nothing else, and all
of its statistics are those that R has computed from the dataset's files (numbers.csv; stranger.R
says how). The same on a site, with drives and with R:
tests/integration/site/studies/test_planted_study.py.
"""

import pytest

from experiments.analysis.report import reports
from experiments.analysis.tables.table import as_csv
from experiments.dataset.folder import read
from tests.support.analysis.planted_effects.agreement import (
    SCRIPT,
    by_the_report,
    differing,
    labels_of,
    numbers_of,
)
from tests.support.analysis.planted_effects.answers import planted_dataset, written
from tests.support.analysis.planted_effects.findings import found_in, hypotheses_in
from tests.support.analysis.planted_effects.study import PLANTED

EXPECTED = SCRIPT.with_name("numbers.csv")
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return written(planted_dataset(), tmp_path_factory.mktemp("planted"))


@pytest.fixture(scope="module")
def found(dataset):
    (found,) = reports(read(dataset))
    return found


@pytest.fixture(scope="module")
def report(found, tmp_path_factory):
    """The tables as CSV, in a folder."""
    folder = tmp_path_factory.mktemp("tables")
    for table in found.tables:
        (folder / f"{table.name}.csv").write_text(as_csv(table), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_every_planted_effect_is_found_and_nothing_else(report):
    assert found_in(report, "analysis-answers") == PLANTED
    assert found_in(report, "analysis-driving") == {("speed", "page"), ("task_time", "page")}
    assert found_in(report, "answers") == set()
    assert found_in(report, "score-tests-godspeed") == set()
    assert hypotheses_in(report) == {"h1": "yes", "h2": "yes", "h3": "yes", "h4": "no"}


@pytest.mark.slow
def test_every_number_is_the_one_that_r_computed(report):
    ours, theirs = by_the_report(report), numbers_of(EXPECTED)
    assert {table for table, _, _ in ours} == {table for table, _, _ in theirs}
    assert list(differing(ours, theirs)) == []
    assert len(ours) > 4000


def test_r_has_computed_every_table_with_a_test(report):
    tested = {
        path.stem for path in report.glob("*.csv") if ",p," in path.read_text().split("\n")[0]
    }
    assert {name for name in tested if not labels_of(name)} == {"hypotheses"}


def test_every_figure_fits_on_a_page_and_names_conditions_by_their_titles(found):
    for drawing in found.figures:
        assert drawing.figure.get_size_inches()[1] <= 9.5, drawing.name
    titles = list(found.titles.values())
    scores = [one.figure for one in found.figures if one.name.startswith("figure-scores-")]
    assert len(scores) == 4
    for figure in scores:
        labels = [tick.get_text() for tick in figure.axes[0].get_yticklabels()]
        assert labels == titles
