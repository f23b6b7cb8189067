"""A study is rehearsed in a sandbox whose time is faster than that of the site beside it."""

import json

import pytest

from tests.support.sessions.site import Site
from tests.support.studies.short_study import bots_command, store_in

pytestmark = [pytest.mark.broker, pytest.mark.soak]


@pytest.fixture(scope="module")
def rehearsed(tmp_path_factory):
    """A site with a short study that was rehearsed, and what was reported."""
    site = Site(tmp_path_factory.mktemp("rehearsing"))
    site.prepare()
    store_in(site)
    report = site.var / "report.json"
    bots_command(
        site, "rehearse_study", "short", "--speed", "6", "--each", "1", "--report", str(report)
    )
    yield site, json.loads(report.read_text())
    site.stop_all()


def test_valid_study_passes_and_keeps_its_report(rehearsed):
    site, report = rehearsed
    assert report["passed"], report["problems"]
    ((passed, kept),) = site.rows("SELECT passed, report FROM experiments_rehearsal")
    assert passed == 1
    assert json.loads(kept) == report


def test_report_shows_the_duration_and_that_all_was_drawn(rehearsed):
    _, report = rehearsed
    (condition,) = report["conditions"]
    assert condition["completed"] >= 1
    assert condition["missed"] == []
    assert 0.3 < condition["expected_minutes"] < 5.0
    assert report["expected_minutes"] > condition["expected_minutes"]
    assert {"table-1", "table-5", "figure-7", "figure-8a"} <= set(report["drawn"])


def test_rehearsal_leaves_no_bot_on_the_site(rehearsed):
    site, _ = rehearsed
    assert site.rows("SELECT count(*) FROM experiments_participant") == [(0,)]
    assert site.rows("SELECT count(*) FROM telepresence_sessions_session") == [(0,)]
