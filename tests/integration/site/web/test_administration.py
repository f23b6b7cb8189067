"""Only processes that show or check the administration load it."""

import os
import sys

import pytest
from django.contrib import admin
from django.core.checks import run_checks

from robots.models import FloorPlan
from tests.support.programs.finished import run

PARTS = {"accounts.admin", "robots.admin", "sessions.admin", "surveys.admin", "experiments.admin"}
LOADED = """
import os, sys
os.environ["DJANGO_SETTINGS_MODULE"] = "telepresence_site.settings"
import django
django.setup()
{then}
print(*sys.modules)
"""


def loaded(then: str) -> set[str]:
    """Return the modules of a process that ran this."""
    done = run(sys.executable, "-c", LOADED.format(then=then), check=True)
    return set(done.stdout.split())


@pytest.mark.nightly
def test_broker_and_session_manager_start_without_the_administration():
    there = loaded(
        "import robots.management.commands.run_broker,"
        " sessions.management.commands.run_session_manager"
    )
    assert not there & (PARTS | {"scipy.ndimage", "scipy.sparse"})


@pytest.mark.nightly
@pytest.mark.parametrize(
    "then",
    [
        "import telepresence_site.urls",
        "from django.core.checks import run_checks; run_checks(tags=['admin'])",
    ],
)
def test_every_part_of_the_administration_is_shown_and_checked(then):
    assert loaded(then) >= PARTS


def test_mistake_in_the_administration_is_found_by_the_checks(monkeypatch):
    admin.autodiscover()
    kind = type(admin.site.get_model_admin(FloorPlan))
    monkeypatch.setattr(kind, "list_display", ["no_such_thing"])
    assert [found.id for found in run_checks(tags=["admin"])] == ["admin.E108"]


def test_wrong_setting_ends_the_session_manager_before_it_starts(tmp_path):
    environment = {**os.environ, "MQTT_URL": "nowhere", "VAR_DIR": str(tmp_path)}
    done = run(sys.executable, "manage.py", "run_session_manager", env=environment)
    assert done.returncode != 0
    assert "telepresence.E001" in done.stderr
