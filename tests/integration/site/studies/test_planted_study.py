"""A study with planted effects, run unattended to its end: bots take part over the site's pages,
with drives on a simulated robot; its dataset is exported and analysed, and the report finds what
was planted and nothing else, in the numbers that R computes from the export alone.
"""

import csv

import pytest

from tests.support.analysis.planted_effects.agreement import (
    PACKAGES,
    by_a_stranger,
    by_the_report,
    differing,
    has_r,
)
from tests.support.analysis.planted_effects.findings import found_in, hypotheses_in
from tests.support.analysis.planted_effects.site import play_planted, store_planted
from tests.support.analysis.planted_effects.study import PLANTED
from tests.support.sessions.site import Site
from tests.support.studies.short_study import bots_command

HOURS = 3600.0
BOTS = 24
# The orders of the conditions are drawn anew in each run: where nothing was planted, a `period` has
# such a p value by chance in one run of a thousand or fewer.
BY_CHANCE = 0.001

pytestmark = [pytest.mark.broker, pytest.mark.soak, pytest.mark.timeout(4 * HOURS)]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The folders of the dataset and of the report."""
    folder = tmp_path_factory.mktemp("planted")
    site = Site(folder / "site")
    site.prepare()
    store_planted(site)
    dataset, report = folder / "dataset", folder / "report"
    print(play_planted(site, dataset, bots=BOTS, speed=10.0, within=3.5 * HOURS))
    arguments = ("--dataset", str(dataset), "--out", str(report), "--kind", "bot")
    bots_command(site, "analyse_study", *arguments)
    yield dataset, report / "all" / "tables"
    site.stop_all()


def test_all_bots_came_to_the_end_in_every_condition(study):
    dataset, _ = study
    with (dataset / "data" / "description-sessions_data.csv").open(newline="") as file:
        sessions = list(csv.DictReader(file))
    assert len(sessions) == 4 * BOTS
    assert {one["outcome"] for one in sessions} == {"completed"}
    assert {one["mismatch"] for one in sessions} == {""}


def test_every_planted_effect_is_found_and_nothing_else(study):
    _, report = study
    found = found_in(report, "analysis-answers")
    assert found >= PLANTED
    assert {(measure, term) for measure, term in found - PLANTED if term != "period"} == set()
    assert found_in(report, "analysis-answers", BY_CHANCE) <= PLANTED
    assert ("speed", "page") in found_in(report, "analysis-driving")
    confirmed = hypotheses_in(report)
    assert {key: confirmed[key] for key in ("h1", "h2", "h3")} == dict.fromkeys(
        ("h1", "h2", "h3"), "yes"
    )


@pytest.mark.skipif(not has_r(), reason=f"R is missing: apt-get install {PACKAGES}")
def test_every_number_is_the_one_that_r_computes(study, tmp_path):
    dataset, report = study
    theirs = by_a_stranger(dataset, "bot", tmp_path / "numbers.csv")
    assert list(differing(by_the_report(report), theirs)) == []
