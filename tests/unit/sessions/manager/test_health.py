"""What the session manager says that it lacks."""

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
def test_a_full_disk_is_told_from_a_database_that_is_away(error, full):
    assert is_disk_full(error) is full
    health = ManagerHealth()
    health.refused(error, 10.0)
    assert health.faults(10.1, "ok") == ("disk_full" if full else "database",)


def test_a_database_that_says_nothing_to_one_step_is_missed_though_it_answers_others():
    health = ManagerHealth()
    health.begun("beat", 10.0)
    health.begun("look", 10.2)
    health.ended("look", 10.3)
    assert health.faults(10.5, "ok") == ()
    assert health.faults(10.7, "ok") == ("database",)
    health.ended("beat", 10.8)
    assert health.faults(10.9, "ok") == ("database",), "it does not flicker"
    assert health.faults(12.9, "ok") == ()


def test_steps_that_only_read_do_not_hide_that_writing_is_refused():
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


def test_a_disk_is_said_to_be_full_or_nearly_full_and_not_both():
    health = ManagerHealth()
    assert [health.faults(10.1, state) for state in ("ok", "low", "full")] == [
        (),
        ("disk_low",),
        ("disk_full",),
    ]
    health.refused(FULL, 10.0)
    assert health.faults(10.1, "low") == ("disk_full",)
