"""A robot's presence and credentials move to tables of their own, and back."""

import json
import os
import shutil

import pytest

from tests.support.django_shell import DjangoShell
from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres
from tests.support.sessions.site import DATABASE, empty_database

MOVE = """
import datetime, json
from django.core.management import call_command
from django.db import connection
from django.db.migrations.executor import MigrationExecutor
from robots.models import Robot, RobotCredentials, RobotPresence

AT = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
robot = Robot.objects.create(name="giraff", title="Giraff", held="repair")
RobotPresence.objects.update(
    connection="ONLINE", boot="b1", last_seen_at=AT, report={"seq": 3}, turnaround="charging"
)
RobotCredentials.objects.update(credential_hash="h", former_until=AT, screen_hash="s")
rows = [list(model.objects.values()) for model in (Robot, RobotPresence, RobotCredentials)]
call_command("migrate", "robots", "0016", verbosity=0)
old = MigrationExecutor(connection).loader.project_state(("robots", "0016_experienced_help_text"))
print(json.dumps(old.apps.get_model("robots", "Robot").objects.values().get(), default=str))
call_command("migrate", verbosity=0)
print(rows == [list(model.objects.values()) for model in (Robot, RobotPresence, RobotCredentials)])
"""


@pytest.mark.parametrize(
    "database", ["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)]
)
def test_what_a_robot_has_reported_and_its_keys_survive_both_migrations(database, tmp_path):
    environment = {**os.environ, "VAR_DIR": str(tmp_path)}
    environment.pop("DATABASE_URL", None)
    if database == "sqlite":
        shutil.copyfile(empty_database(), tmp_path / DATABASE)
        said = migrated(environment)
    else:
        with running_postgres() as server:
            said = migrated({**environment, "DATABASE_URL": server.url})
    before = json.loads(said[0])
    assert (before["held"], before["connection"], before["boot"]) == ("repair", "ONLINE", "b1")
    assert (before["report"], before["factsheet"]) == ({"seq": 3}, None)
    assert (before["turnaround"], before["last_seen_at"]) == (
        "charging",
        "2026-01-01 00:00:00+00:00",
    )
    assert (before["credential_hash"], before["screen_hash"]) == ("h", "s")
    assert said[1] == "True"


def migrated(environment: dict[str, str]) -> list[str]:
    shell = DjangoShell(ROOT, environment)
    try:
        return shell.ask(MOVE).splitlines()
    finally:
        shell.close()
