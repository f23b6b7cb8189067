"""Faults that the session manager reports."""

import pytest
from django.db import OperationalError

from sessions.disk_full import is_disk_full
from sessions.manager.health import ManagerHealth

FULL = OperationalError("database or disk is full")


def of_postgres(code):
    error = OperationalError("could not extend file")
    error.__cause__ = type("Cause", (Exception,), {"sqlstate": code})()
    return error


@pytest.mark.parametrize(
    ("error", "full"),
    [
        (FULL, True),
        (of_postgres("53100"), True),
        (of_postgres("57P01"), False),
        (OperationalError("database is locked"), False),
    ],
)
def test_a_full_disk_differs_from_an_unavailable_database(error, full):
    assert is_disk_full(error) is full
    health = ManagerHealth()
    health.refused(error, 10.0)
    assert health.faults(10.1, "ok") == ("disk_full" if full else "database",)


def test_a_step_without_an_answer_is_a_fault_although_others_are_answered():
    health = ManagerHealth()
    health.begun("beat", 10.0)
    health.begun("look", 10.2)
    health.ended("look", 10.3)
    assert health.faults(10.5, "ok") == ()
    assert health.faults(10.7, "ok") == ("database",)
    health.ended("beat", 10.8)
    assert health.faults(10.9, "ok") == ("database",), "it does not flicker"
    assert health.faults(12.9, "ok") == ()


def test_reading_steps_do_not_hide_refused_writes():
    health = ManagerHealth()
    for tenth in range(40):
        now = 10.0 + tenth * 0.5
        health.begun("beat", now - 0.1)
        health.refused(FULL, now)
        health.ended("beat", now)
        health.begun("look", now + 0.1)
        health.ended("look", now + 0.2)
        assert health.faults(now + 0.4, "ok") == ("disk_full",)
    assert health.faults(now + 0.9, "ok") == ("disk_full",)
    assert health.faults(now + 2.1, "ok") == ()


def test_a_disk_is_reported_as_full_or_low_and_not_both():
    health = ManagerHealth()
    found = [health.faults(10.1, state) for state in ("ok", "low", "full")]
    assert found == [(), ("disk_low",), ("disk_full",)]
    health.refused(FULL, 10.0)
    assert health.faults(10.1, "low") == ("disk_full",)
