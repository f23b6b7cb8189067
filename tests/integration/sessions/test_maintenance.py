"""`manage.py maintenance`."""

import io

import pytest
from django.core.management import CommandError, call_command

from accounts.models import AuditEntry, User
from sessions.leases import store
from sessions.models import Maintenance
from sessions.protocol import Queued
from tests.support.robots import online_robot
from tests.support.sessions.rows import NOW

pytestmark = pytest.mark.django_db


def maintenance(*arguments: str) -> str:
    out = io.StringIO()
    call_command("maintenance", *arguments, stdout=out)
    return out.getvalue()


def test_visitor_who_asks_during_maintenance_waits_and_is_told_why():
    giraff, ana = online_robot(), User.objects.create(username="ana")
    maintenance("begin")
    queued = store.take(giraff, ana, "p1", now=NOW)
    assert isinstance(queued, Queued)
    assert queued.reason == "maintenance"
    assert maintenance("end") == "Visitors can drive again.\n"
    assert isinstance(store.take(giraff, ana, "p1", now=NOW), store.TakeGranted)


def test_second_announcement_replaces_the_first():
    maintenance("begin", "--in", "600")
    first = Maintenance.objects.get().starts_at
    maintenance("begin", "--in", "60")
    assert Maintenance.objects.get().starts_at < first


def test_status_counts_the_drives_and_waiting_returns_when_none_is_left(monkeypatch):
    giraff, ana = online_robot(), User.objects.create(username="ana")
    session = store.take(giraff, ana, "p1", now=NOW).session
    assert maintenance("status") == "No maintenance is announced. Drives: 1.\n"
    ended = lambda _: store.end(session, "stopped_by_operator", "maintenance", NOW)
    monkeypatch.setattr("sessions.management.commands.maintenance.time.sleep", ended)
    assert maintenance("begin", "--in", "0", "--wait").endswith("No drive is left.\n")


def test_waiting_without_a_session_manager_ends_with_the_reason(monkeypatch):
    giraff, ana = online_robot(), User.objects.create(username="ana")
    store.take(giraff, ana, "p1", now=NOW)
    monkeypatch.setattr("sessions.management.commands.maintenance.ENDING_SECONDS", 0.0)
    with pytest.raises(CommandError, match="Is a session manager running"):
        maintenance("begin", "--in", "0", "--wait")


def test_time_in_the_past_is_refused():
    with pytest.raises(CommandError, match="0 or more"):
        maintenance("begin", "--in", "-1")


def test_announcement_and_end_are_in_the_audit_log():
    maintenance("begin")
    maintenance("end")
    assert maintenance("end") == "None was announced.\n"
    acts = AuditEntry.objects.values_list("act", flat=True)
    assert sorted(acts) == ["maintenance_announced", "maintenance_ended"]
