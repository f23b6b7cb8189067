"""A sandbox: its content, and what happens when one of its parts ends."""

from itertools import cycle
from pathlib import Path

import msgspec
import pytest
from django.core.management import CommandError, call_command
from django.utils import timezone

from accounts.models import User
from experiments import publishing
from experiments.definition.shipped import shipped
from experiments.models import Rehearsal, Study
from experiments.rehearsal import plan
from robots.api.topics import ROBOT_NAME
from robots.models import FloorPlan, Robot
from surveys.models import Questionnaire
from telepresence_site.demo.supervision import DemoPart, PartLostError
from telepresence_site.rehearsal import sandbox
from tests.support.studies.wizard_study import wizard_study


@pytest.mark.django_db(transaction=True)
def test_published_study_runs_on_a_site_without_its_publisher(tmp_path, settings):
    settings.VAR_DIR, settings.CREDENTIALS_DIR = tmp_path, tmp_path / "credentials"
    row = publishing.store(shipped()["exploration"], timezone.now())
    Study.objects.update(
        status=Study.Status.PUBLISHED, published_by=User.objects.create(username="researcher")
    )
    published = Study.objects.get()
    sandbox.pack(published, tmp_path)
    assert published.published_by is not None
    for model in (Study, Questionnaire, FloorPlan, User):
        model.objects.all().delete()
    unpacked = sandbox.unpack()
    assert (unpacked.pk, unpacked.sha256) == (row.pk, row.sha256)
    assert unpacked.status == Study.Status.DRAFT
    assert {robot.name for robot in Robot.objects.all()} == {"giraff", "rhodon"}


def another(study, **renamed):
    """Return the study with other names of robots and sites."""
    written = msgspec.to_builtins(study)
    for part in (*written["conditions"], *written["courses"]):
        part |= {
            field: renamed[part[field]] for field in ("robot", "site") if part[field] in renamed
        }
    return msgspec.convert({**written, "slug": "another"}, type(study))


def test_robots_of_a_sandbox_have_valid_names():
    study = shipped()["exploration"]
    there = another(study, rhodon="giraff")
    moved = [
        msgspec.structs.replace(one, site=site)
        for one, site in zip(there.conditions, cycle(["Old_Wing", "x" * 50]), strict=False)
    ]
    robots = sandbox._robots(msgspec.structs.replace(there, conditions=tuple(moved)))
    assert sorted(robots.values()) == [("giraff", "Old_Wing"), ("giraff", "x" * 50)]
    assert all(ROBOT_NAME.match(name) for name in robots)
    assert sandbox._robots(study) == {name: (name, "office") for name in ("giraff", "rhodon")}


@pytest.mark.django_db(transaction=True)
def test_study_with_a_robot_without_a_simulator_is_refused_before_the_start(tmp_path, settings):
    settings.VAR_DIR = tmp_path
    publishing.store(another(shipped()["exploration"], rhodon="rosie"), timezone.now())
    sentence = "There is no simulation of rosie: bots can rehearse only with giraff, rhodon."
    for command in (["rehearse_study", "another"], ["run_bots", "another", "--speed", "5"]):
        with pytest.raises(CommandError, match=sentence):
            call_command(*command)
    assert not list((tmp_path / "sandboxes").rglob("*.json"))
    assert sentence in str(Rehearsal.objects.get().report)


def test_study_with_a_hidden_operator_is_refused_with_the_reason():
    found = plan.problems(wizard_study())
    assert [text for text in found if "hidden operator" in text] == [plan.WITH_OPERATOR]


def test_settings_of_the_computers_own_agent_do_not_reach_simulated_ones(tmp_path):
    outside = {"PATH": "/bin", "TELEPRESENCE_SERVER": "https://x", "TELEPRESENCE_VAR": "/var"}
    inside = sandbox.environment(tmp_path, outside)
    assert inside["PATH"] == "/bin"
    assert not [name for name in inside if name.startswith("TELEPRESENCE_")]


def test_part_that_ends_during_the_run_fails_it_with_its_last_lines(
    tmp_path, settings, monkeypatch
):
    settings.VAR_DIR = tmp_path
    ends = ["-c", "print('no memory left'); raise SystemExit(3)"]
    part = DemoPart("web server", ends, lambda child: child.process.wait() == 3, is_essential=True)
    monkeypatch.setattr(sandbox, "_parts", lambda *_: ("http://127.0.0.1:1", [part]))
    with (
        pytest.raises(PartLostError, match=r"The web server ended: no memory left"),
        sandbox.running(shipped()["exploration"], Path()),
    ):
        pass
