"""Two studies with planted effects: bots take part over the site's pages, with drives on a
simulated robot. Some never move the robot, take it twice, run out of time, leave or withdraw. The
exported datasets are analysed; the reports find the planted effects and no others, and R computes
the same numbers from the exports.
"""

import pytest

from tests.support.analysis.planted_effects import study as planted
from tests.support.analysis.planted_effects.agreement import (
    PACKAGES,
    by_a_stranger,
    by_the_report,
    differing,
    has_r,
)
from tests.support.analysis.planted_effects.counted import (
    drawn_again,
    reasons,
    reported_reasons,
    rows_of,
    withdrawn,
)
from tests.support.analysis.planted_effects.findings import found_in, hypotheses_in
from tests.support.analysis.planted_effects.site import play
from tests.support.sessions.site import Site
from tests.support.studies.short_study import bots_command

HOURS = 3600.0
# The order of conditions is random in each run: without a planted effect a `period` reaches this p
# value in one run of a thousand.
BY_CHANCE = 0.001
# At a higher speed images are older, for which the robot slows down: drivers differ less, and
# miss time limits.
SPEEDS = {planted.SLUG: 4.0, planted.SUCCESS_SLUG: 2.0}
STUDIES = {
    planted.SLUG: (planted.planted_study, 32, planted.EFFECTS, planted.ENDINGS),
    planted.SUCCESS_SLUG: (
        planted.success_study,
        40,
        planted.SUCCESS_EFFECTS,
        planted.SUCCESS_ENDINGS,
    ),
}

pytestmark = [pytest.mark.broker, pytest.mark.soak, pytest.mark.timeout(8 * HOURS)]


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """The folders of the datasets and of the reports' tables, by study."""
    folder, found = tmp_path_factory.mktemp("planted"), {}
    site = Site(folder / "site")
    site.prepare()
    for slug, (study, bots, effects, endings) in STUDIES.items():
        dataset, report = folder / slug, folder / f"{slug}-report"
        orders = {"bots": bots, "effects": effects, "endings": endings, "speed": SPEEDS[slug]}
        print(play(site, study(), dataset, within=3.5 * HOURS, **orders))
        arguments = ("--dataset", str(dataset), "--out", str(report), "--kind", "bot")
        bots_command(site, "analyse_study", *arguments)
        found[slug] = (dataset, report / "counting" / "tables")
    yield found
    site.stop_all()


@pytest.mark.parametrize("slug", STUDIES)
def test_export_has_a_row_for_each_counted_drive(studies, slug):
    dataset, report = studies[slug]
    expected = reasons(dataset)
    assert reported_reasons(report) == expected
    assert {"", "not_exposed", "not_driven"} == set(expected.values())
    sessions = rows_of(dataset / "data" / "description-sessions_data.csv")
    assert {one["mismatch"] for one in sessions} == {""}
    assert {"completed", "timed_out", "cancelled"} == {one["outcome"] for one in sessions}
    # the page for novices shows the condition before the video: the cell stays assigned
    assert bool(list(drawn_again(dataset))) == (not STUDIES[slug][0]().reveals_condition)
    left = {one["id"] for one in withdrawn(dataset)}
    assert bool(left) == ("withdraws" in STUDIES[slug][-1])
    assert not left & {one["participant"] for one in sessions}


def test_planted_effects_on_scores_and_speed_are_found_and_no_others(studies):
    _, report = studies[planted.SLUG]
    found = found_in(report, "analysis-answers")
    assert found >= planted.PLANTED
    assert {term for _, term in found - planted.PLANTED} <= {"period"}
    assert found_in(report, "analysis-answers", BY_CHANCE) <= planted.PLANTED
    assert ("speed", "page") in found_in(report, "analysis-driving")
    confirmed = hypotheses_in(report)
    assert [confirmed[key] for key in ("h1", "h2", "h3")] == ["yes"] * 3


def test_planted_effects_on_success_and_its_time_are_found_and_no_others(studies):
    _, report = studies[planted.SUCCESS_SLUG]
    tables = ("analysis-success-model", "analysis-times-model")
    assert {one for table in tables for one in found_in(report, table)} == planted.SUCCESS_PLANTED
    decided = hypotheses_in(report)
    assert (decided["h1"], decided["h2"]) == ("yes", "yes")
    # without a test where no bot with the brake succeeds
    assert {decided["h3"], decided["h4"]} <= {"no", "unknown"}


@pytest.mark.parametrize("slug", STUDIES)
@pytest.mark.skipif(not has_r(), reason=f"R is missing: apt-get install {PACKAGES}")
def test_every_number_equals_that_of_r(studies, slug, tmp_path):
    dataset, report = studies[slug]
    theirs = by_a_stranger(dataset, "bot", tmp_path / "numbers.csv")
    assert list(differing(by_the_report(report), theirs)) == []
