"""The file for people who assess an installation."""

import io

import msgspec
import pytest
from django.core.management import CommandError, call_command

from accounts import audit
from robots.models import Robot
from tests.support import words
from tests.support.robots import create_robot

pytestmark = pytest.mark.django_db
FIGURES = {
    "silence_s": 0.472,
    "silence_m": 0.058,
    "silence_within_s": 0.737,
    "estop_s": 0.286,
    "estop_m": 0.031,
    "estop_within_s": 0.438,
    "estop_holds": True,
}


def written(tmp_path, **options) -> str:
    path = tmp_path / "safety.html"
    call_command("safety_file", str(path), stdout=io.StringIO(), **options)
    return path.read_text(encoding="utf-8")


def test_it_joins_hazards_tests_measurements_versions_and_interventions(tmp_path, settings):
    settings.VERSION = "0.9.7"

    sheet = msgspec.to_builtins(words.factsheet(agent_version="0.9.6"))
    create_robot(name="giraff", title="The <Giraff>", factsheet=sheet, max_linear=0.3)
    create_robot(name="rhodon", title="Rhodon")
    create_robot(name="practice-1", title="Practice", practice=True)
    versions = {"site": "0.9.7", "agent": "0.9.6"}
    data = {"outcome": "passed", "reason": "", "figures": FIGURES, "versions": versions}
    audit.note("safety_test", role="owner", robot="giraff", data=data)
    audit.note("estop", role="screen", robot="giraff")
    audit.note("limits_changed", role="owner", robot="giraff", data={"max_linear": [None, 0.3]})
    page = written(tmp_path)
    for text in (
        "not a declaration of conformity",
        "Version 0.9.7",
        "the network delivers late",
        "test_three_hundred_milliseconds_of_silence_brake_with_the_braking_limit",
        "The &lt;Giraff&gt; (giraff)",
        "agentVersion: 0.9.6",
        "0.47\u00a0s",
        "max_linear: – → 0.3",
        "The robot has never connected.",
        "have not been tested here",
        "django 5",
    ):
        assert text in page, text
    assert "practice-1" not in page
    assert "not run here" in page
    assert "passed (" not in page


def test_it_is_one_file_that_loads_nothing(tmp_path):
    create_robot(name="giraff", title="Giraff")
    page = written(tmp_path)
    assert not any(mark in page for mark in ("<script", "<img", "<link", "src=", "http://", "url("))


def test_it_says_which_tests_ran(tmp_path):
    results = tmp_path / "results.xml"
    name = "test_lost_agent_leaves_the_robot_at_rest"
    results.write_text(
        f'<testsuite tests="1" timestamp="T"><testcase classname="a.test_b" name="{name}"/>'
        "</testsuite>",
        encoding="utf-8",
    )
    page = written(tmp_path, results=[results])
    assert f'{name}</code>: <span class="passed">passed (1 of 1)' in page
    assert "results.xml: 1 tests, T" in page


def test_it_never_overwrites_a_file_and_names_a_wrong_one(tmp_path):
    written(tmp_path)
    with pytest.raises(CommandError, match="exists"):
        written(tmp_path)
    (tmp_path / "bad.xml").write_text("<a/>", encoding="utf-8")
    with pytest.raises(CommandError, match="is no JUnit file"):
        call_command("safety_file", str(tmp_path / "other.html"), results=[tmp_path / "bad.xml"])
    assert not (tmp_path / "other.html").exists()


def test_a_site_without_robots_has_a_file_too(tmp_path):
    assert not Robot.objects.exists()
    assert "The site has no robot." in written(tmp_path)
