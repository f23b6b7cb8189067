"""Bots take part in a study on a whole site with real processes, in real time."""

import json

import pytest

from tests.support.sessions.site import running_site
from tests.support.studies.short_study import bots_command, store_in

pytestmark = [pytest.mark.broker, pytest.mark.long, pytest.mark.nightly]
ENDINGS = "completes,leaves_at_the_dock,refuses_consent"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with running_site(tmp_path_factory.mktemp("bots")) as site:
        site.start_robot("giraff", "--fps", "6")
        store_in(site)
        yield site


@pytest.fixture(scope="module")
def diaries(site):
    report = site.var / "bots.json"
    bots_command(
        *(site, "run_bots", "short", "--participants", "3", "--seed", "4", "--url", site.url),
        *("--endings", ENDINGS, "--report", str(report)),
    )
    return json.loads(report.read_text())


def test_bot_completes_the_study_and_gets_its_code(diaries):
    first = diaries[0]
    assert first["code"], first
    assert [leg["outcome"] for leg in first["legs"]] == ["completed"]
    assert first["legs"][0]["passed"] == [1]


def test_bot_that_leaves_at_the_dock_answers_without_a_drive(diaries):
    assert diaries[1]["stuck"] == ""
    assert [leg["passed"] for leg in diaries[1]["legs"]] == [[]]
    assert diaries[1]["code"] not in {"", diaries[0]["code"]}


def test_bot_that_refuses_gets_no_more_questions(diaries):
    assert diaries[2]["legs"] == []
    assert diaries[2]["answered"] == {}


def test_bots_are_marked_everywhere(site, diaries):
    assert set(site.rows("SELECT DISTINCT kind FROM experiments_participant")) == {("bot",)}
    links = "FROM experiments_personallink WHERE redeemed_at IS NOT NULL AND kind = 'bot'"
    willing = [one for one in diaries if one["ending"] != "refuses_consent"]
    assert site.rows(f"SELECT count(*) {links}") == [(len(willing),)]


def test_record_of_the_drive_matches_the_bots_diary(site, diaries):
    session = diaries[0]["legs"][0]["session"]
    drive = "SELECT moved, mismatches FROM experiments_drive WHERE session_id = ?"
    assert site.rows(drive, session.replace("-", "")) == [(1, "[]")]
    applied = [command for state in site.states(session) for command in state.get("applied", ())]
    methods = {command["method"] for command in applied}
    assert len(methods) == 1
    assert methods <= {"keyboard", "mouse", "touch"}
