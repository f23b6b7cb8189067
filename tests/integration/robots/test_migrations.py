"""The first migrations of robots and sessions replace those of earlier versions."""

import pytest
from django.core.management import call_command
from django.core.management.base import SystemCheckError
from django.db import connection
from django.db.migrations.loader import MigrationLoader
from django.db.migrations.recorder import MigrationRecorder

from robots.models import Robot
from telepresence_site.checks import LAST_BEFORE_SQUASH, check_squashed_migrations

pytestmark = pytest.mark.django_db
SQUASHED = [
    migration
    for migration in MigrationLoader(None, ignore_no_migrations=True).disk_migrations.values()
    if migration.replaces
]


def forget(app, name):
    deleted, _ = MigrationRecorder.Migration.objects.filter(app=app, name=name).delete()
    assert deleted == 1


def migrate():
    call_command("migrate", verbosity=0, skip_checks=False)


def test_robots_and_sessions_have_one_migration_that_replaces_the_older_ones():
    assert {migration.app_label for migration in SQUASHED} == {"robots", "telepresence_sessions"}


def test_database_with_every_replaced_migration_keeps_its_rows():
    Robot.objects.create(name="giraff", title="Giraff")
    for migration in SQUASHED:
        forget(migration.app_label, migration.name)
    migrate()
    assert Robot.objects.get().title == "Giraff"
    applied = MigrationRecorder(connection).applied_migrations()
    assert {(migration.app_label, migration.name) for migration in SQUASHED} <= set(applied)


def test_new_database_and_one_with_every_replaced_migration_pass_the_check():
    assert not list(check_squashed_migrations(databases=["default"]))
    MigrationRecorder.Migration.objects.all().delete()
    assert not list(check_squashed_migrations(databases=["default"]))


@pytest.mark.parametrize("keeps_new", [False, True], ids=["", "new one is recorded"])
@pytest.mark.parametrize("migration", SQUASHED, ids=str)
def test_database_with_only_some_of_the_replaced_migrations_is_refused(migration, keeps_new):
    if not keeps_new:
        forget(migration.app_label, migration.name)
    forget(*migration.replaces[-1])
    assert [error.id for error in check_squashed_migrations(databases=["default"])] == [
        "telepresence.E010"
    ]
    with pytest.raises(SystemCheckError) as refusal:
        migrate()
    assert f"only some of the migrations that {migration} replaces" in str(refusal.value)
    assert f"Check out commit {LAST_BEFORE_SQUASH}, run manage.py migrate" in str(refusal.value)
