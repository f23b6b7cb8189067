"""Whose fault the end of a session was, from what was recorded of it."""

import pytest

from sessions.leases.fault_side import (
    MANAGER,
    RETURN_SECONDS,
    WEB,
    FaultAttribution,
    ServerAbsence,
    SessionEnd,
    fault_of,
)
from sessions.models import Session

LOST, ENDED = 500.0, 620.0


def end(outcome="connection_lost", reason="visitor_silent", *absences, **known):
    about = {"begun_at": 100.0, "ended_at": ENDED, "lost_at": LOST} | known
    return SessionEnd(outcome, reason, absences=absences, **about)


@pytest.mark.parametrize(
    ("found", "side"),
    [
        (end("completed", "task", lost_at=None), ""),
        (end("completed", "left", lost_at=None), ""),
        (end("timed_out", "task", lost_at=None), ""),
        (end("timed_out", "turn_over", lost_at=None), ""),
        (end("timed_out", "idle", lost_at=None), "visitor"),
        (end("timed_out", "no_picture", lost_at=None), "network"),
        (end("cancelled", "left", lost_at=None), "visitor"),
        (end("stopped_by_operator", "robot_disabled", lost_at=None), "operator"),
        (end("robot_fault", "robot_offline", lost_at=None), "robot"),
        (end("connection_refused", "never_connected", lost_at=None), "network"),
        (end("connection_refused", "page_gone", lost_at=None, close_code=1001), "visitor"),
        (end(), "network"),
        (end(close_code=1006), "network"),
        (end(close_code=1001), "visitor"),
        (end(close_code=1000), "visitor"),
        (end("timed_out", "task"), "network"),
        (end("timed_out", "task", close_code=1001), "visitor"),
        (end(reason="lease_gone", lost_at=None), "platform"),
    ],
)
def test_an_end_without_an_absent_server_has_the_side_that_its_record_names(found, side):
    assert fault_of(found).side == side


@pytest.mark.parametrize("part", [WEB, MANAGER])
@pytest.mark.parametrize(
    ("since", "until", "is_platform"),
    [
        (490.0, None, True),
        (490.0, 530.0, True),
        (300.0, LOST - RETURN_SECONDS + 1.0, True),
        (300.0, LOST - RETURN_SECONDS - 1.0, False),
        (LOST + 5.0, ENDED - 5.0, False),
        (LOST + 5.0, None, True),
    ],
)
def test_a_loss_during_a_server_outage_is_the_platforms_fault(part, since, until, is_platform):
    absence = ServerAbsence(part, since, until)
    expected = FaultAttribution("platform", part) if is_platform else FaultAttribution("network")
    assert fault_of(end("connection_lost", "visitor_silent", absence)) == expected
    assert fault_of(end("timed_out", "task", absence)) == expected


def test_a_failed_connection_during_a_server_outage_is_the_platforms_fault():
    for since, until in ((50.0, 110.0), (110.0, 130.0), (90.0, None)):
        absence = ServerAbsence(WEB, since, until)
        refused = end("connection_refused", "never_connected", absence, lost_at=None)
        assert fault_of(refused) == FaultAttribution("platform", WEB)
    before = ServerAbsence(WEB, 10.0, 20.0)
    assert fault_of(
        end("connection_refused", "never_connected", before, lost_at=None)
    ) == FaultAttribution("network")


def test_an_outage_that_ended_does_not_excuse_visitors_who_left_or_finished():
    absence = ServerAbsence(WEB, 200.0, 230.0)
    for outcome, reason in (("cancelled", "left"), ("timed_out", "idle")):
        assert fault_of(end(outcome, reason, absence, lost_at=None)) == FaultAttribution("visitor")
    for outcome in ("completed", "timed_out"):
        assert fault_of(end(outcome, "task", absence, lost_at=None)) == FaultAttribution()


def test_a_task_that_ended_during_a_server_outage_is_the_platforms_fault():
    found = end("timed_out", "task", ServerAbsence(WEB, 300.0), lost_at=None)
    assert fault_of(found) == FaultAttribution("platform", WEB)


def test_every_outcome_but_completion_and_time_has_a_side():
    ends = {
        outcome: fault_of(end(outcome, "something", lost_at=None)) for outcome in Session.Outcome
    }
    assert {outcome for outcome, fault in ends.items() if not fault.side} == {
        Session.Outcome.COMPLETED,
        Session.Outcome.TIMED_OUT,
    }
