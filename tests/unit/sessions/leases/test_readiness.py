from dataclasses import replace

import pytest

from sessions.leases.readiness import (
    ATTEMPTS,
    PAUSED_RETRY_S,
    RETRY_S,
    TIMEOUTS_S,
    Order,
    Readiness,
    RobotCondition,
    decide,
)

AWAY = RobotCondition(docked=False, charge=0.8, charge_limit=0.2)
HOME = replace(AWAY, docked=True)


def answered(readiness, kind, at, status="", reason=""):
    return replace(readiness, order=Order("a1", kind, at, status, reason))


def test_a_robot_that_is_docked_localized_charged_and_level_is_ready():
    assert decide(Readiness(), HOME, 0.0) == (Readiness("ready"), None)


@pytest.mark.parametrize(
    ("condition", "order"),
    [(replace(HOME, localized=False), "relocalize"), (replace(HOME, head_is_level=False), "level")],
)
def test_a_docked_robot_gets_an_order_for_its_missing_state(condition, order):
    readiness, kind = decide(Readiness(), condition, 0.0)
    assert (readiness.phase, kind) == ("returning", order)


def test_a_docked_robot_that_is_empty_charges_until_it_is_above_its_limit():
    empty, charging = replace(HOME, charge=0.1), Readiness("charging", "charging")
    assert decide(Readiness(), empty, 0.0)[0] == charging
    assert decide(charging, replace(HOME, charge=0.21), 1.0)[0].phase == "ready"


SEEING = replace(HOME, has_camera=True)


@pytest.mark.parametrize(
    ("condition", "order", "reason"),
    [(AWAY, "dock", "the laboratory door is closed"), (SEEING, "picture", "no_picture")],
)
def test_failing_orders_are_repeated_and_then_pause_with_the_robots_reason(
    condition, order, reason
):
    readiness, now, orders = Readiness(), 0.0, 0
    while readiness.phase != "paused":
        readiness, kind = decide(readiness, condition, now)
        if kind is not None:
            orders += 1
            readiness = answered(readiness, kind, now, "FAILED", reason)
        now += 1.0
    assert (orders, readiness.reason) == (ATTEMPTS, reason)
    assert (ATTEMPTS - 1) * RETRY_S <= now < 200.0
    assert decide(readiness, condition, now)[1] is None
    now += PAUSED_RETRY_S
    again, kind = decide(readiness, condition, now)
    assert (again.phase, kind) == ("paused", order)
    finished = answered(again, order, now, "FINISHED")
    assert decide(finished, HOME, now + 60.0)[0].phase == "ready"


def test_a_robot_that_never_answers_gets_the_order_again():
    readiness = answered(Readiness(), "dock", 0.0)
    assert decide(readiness, AWAY, TIMEOUTS_S["dock"])[1] is None
    waiting, kind = decide(readiness, AWAY, TIMEOUTS_S["dock"] + 1)
    assert (waiting.reason, kind) == ("no_answer", None)
    assert decide(waiting, AWAY, TIMEOUTS_S["dock"] + 1 + RETRY_S)[1] == "dock"


def test_pushing_the_robot_into_its_dock_ends_the_attempt():
    assert decide(answered(Readiness(), "dock", 0.0, "RUNNING"), HOME, 5.0)[0].phase == "ready"


def test_after_docking_the_head_has_attempts_of_its_own():
    docked = answered(replace(Readiness(), attempts=2, tried_at=0.0), "dock", 1.0, "FINISHED")
    readiness, kind = decide(docked, replace(HOME, head_is_level=False), 2.0)
    assert (readiness.attempts, kind) == (0, "level")


def test_an_emergency_stop_pauses_at_once_and_drops_the_order():
    running = answered(Readiness(), "dock", 0.0, "RUNNING")
    readiness, kind = decide(running, replace(AWAY, estop=True), 1.0)
    assert (readiness.phase, readiness.reason) == ("paused", "estop")
    assert (readiness.order, kind) == (None, None)
    assert decide(readiness, AWAY, 2.0)[1] == "dock"


def test_attempts_are_counted_from_zero_after_a_stop_is_released():
    spent = Readiness("paused", "the wheels do not turn", None, ATTEMPTS, 10.0)
    stopped, _ = decide(spent, replace(AWAY, estop=True), 11.0)
    released, kind = decide(stopped, AWAY, 12.0)
    assert (released.phase, released.reason, kind) == ("returning", "dock", "dock")


def test_a_silent_robot_gets_no_orders():
    readiness, kind = decide(Readiness(), replace(AWAY, is_current=False), 0.0)
    assert (readiness.phase, readiness.reason, kind) == ("returning", "offline", None)


def test_a_robot_with_a_camera_is_ready_after_a_picture_in_its_station():
    readiness, kind = decide(Readiness(), SEEING, 0.0)
    assert (readiness.phase, readiness.reason, kind) == ("returning", "picture", "picture")
    for status, reason, phase in (
        ("RUNNING", "", "returning"),
        ("FINISHED", "", "ready"),
        ("FAILED", "too_large", "ready"),
    ):
        answer = answered(readiness, "picture", 0.0, status, reason)
        assert decide(answer, SEEING, 2.0)[0].phase == phase


def test_a_picture_does_not_count_after_the_robot_was_pushed_out_of_its_station():
    finished = answered(Readiness(), "picture", 0.0, "FINISHED")
    readiness, _ = decide(finished, replace(SEEING, is_responsive=False), 1.0)
    assert decide(readiness, SEEING, 2.0)[0].phase == "ready"
    away, kind = decide(readiness, replace(SEEING, docked=False), 2.0)
    assert kind == "dock"
    assert decide(answered(away, "dock", 2.0, "FINISHED"), SEEING, 9.0)[1] == "picture"


@pytest.mark.parametrize("condition", [AWAY, HOME, replace(HOME, head_is_level=False)])
def test_a_stop_between_visits_pauses_until_it_is_released(condition):
    running = answered(Readiness(), "dock", 0.0, "CANCELLED")
    stopped, order = decide(running, replace(condition, stopped=True), 1.0)
    assert (stopped, order) == (Readiness("paused", "stopped"), None)
    again = decide(stopped, replace(condition, stopped=True), 10_000.0)
    assert again == (stopped, None)
    assert decide(stopped, AWAY, 10_001.0)[1] == "dock"
