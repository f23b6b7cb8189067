from dataclasses import replace

import pytest

from sessions.leases.readiness import (
    ATTEMPTS,
    NETWORK_PAUSE_S,
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


def answered(turnaround, kind, at, status="", reason=""):
    return replace(turnaround, order=Order("a1", kind, at, status, reason))


def test_a_robot_that_is_docked_localized_charged_and_level_is_ready():
    assert decide(Readiness(), HOME, 0.0) == (Readiness("ready"), None)


def test_a_robot_that_is_away_is_told_to_dock_once():
    first, order = decide(Readiness(), AWAY, 0.0)
    assert (first.phase, order) == ("returning", "dock")
    assert decide(answered(first, "dock", 0.0, "RUNNING"), AWAY, 100.0)[1] is None


@pytest.mark.parametrize(
    ("condition", "order"),
    [(replace(HOME, localized=False), "relocalize"), (replace(HOME, head_is_level=False), "level")],
)
def test_a_docked_robot_is_told_what_it_lacks(condition, order):
    turnaround, kind = decide(Readiness(), condition, 0.0)
    assert (turnaround.phase, kind) == ("returning", order)


def test_a_docked_robot_that_is_empty_charges_until_it_is_above_its_limit():
    empty = replace(HOME, charge=0.1)
    assert decide(Readiness(), empty, 0.0)[0] == Readiness("charging", "charging")
    assert (
        decide(Readiness("charging", "charging"), replace(empty, charge=0.21), 1.0)[0].phase
        == "ready"
    )


def test_docking_that_fails_is_tried_again_and_then_pauses_with_the_robots_reason():
    turnaround, now, orders = Readiness(), 0.0, 0
    for _ in range(200):
        turnaround, kind = decide(turnaround, AWAY, now)
        if kind is not None:
            orders += 1
            turnaround = answered(turnaround, kind, now, "FAILED", "the laboratory door is closed")
        now += 1.0
        if turnaround.phase == "paused":
            break
    assert (orders, turnaround.reason) == (ATTEMPTS, "the laboratory door is closed")
    assert now >= (ATTEMPTS - 1) * RETRY_S
    assert decide(turnaround, AWAY, now)[1] is None
    again, kind = decide(turnaround, AWAY, now + PAUSED_RETRY_S)
    assert (again.phase, kind) == ("paused", "dock"), "a door may have been opened meanwhile"
    assert (
        decide(
            answered(again, "dock", now + PAUSED_RETRY_S, "FINISHED"),
            HOME,
            now + PAUSED_RETRY_S + 60,
        )[0].phase
        == "ready"
    )


def test_a_robot_that_never_answers_is_told_again():
    turnaround = answered(Readiness(), "dock", 0.0)
    assert decide(turnaround, AWAY, TIMEOUTS_S["dock"])[1] is None
    waiting, kind = decide(turnaround, AWAY, TIMEOUTS_S["dock"] + 1)
    assert (waiting.reason, kind) == ("no_answer", None)
    assert decide(waiting, AWAY, TIMEOUTS_S["dock"] + 1 + RETRY_S)[1] == "dock"


def test_pushing_the_robot_into_its_dock_ends_the_attempt():
    assert decide(answered(Readiness(), "dock", 0.0, "RUNNING"), HOME, 5.0)[0].phase == "ready"


def test_after_docking_the_head_has_attempts_of_its_own():
    docked = answered(replace(Readiness(), attempts=2, tried_at=0.0), "dock", 1.0, "FINISHED")
    turnaround, kind = decide(docked, replace(HOME, head_is_level=False), 2.0)
    assert (turnaround.attempts, kind) == (0, "level")


def test_an_emergency_stop_pauses_at_once_and_lets_go_of_the_order():
    turnaround, kind = decide(
        answered(Readiness(), "dock", 0.0, "RUNNING"), replace(AWAY, estop=True), 1.0
    )
    assert (turnaround.phase, turnaround.reason, turnaround.order, kind) == (
        "paused",
        "estop",
        None,
        None,
    )
    assert decide(turnaround, AWAY, 2.0)[1] == "dock"


def test_a_released_stop_is_the_begin_of_new_attempts_whatever_was_tried_before():
    spent = Readiness("paused", "wheels", None, ATTEMPTS, 10.0)
    stopped, _ = decide(spent, replace(AWAY, estop=True), 11.0)
    released, kind = decide(stopped, AWAY, 12.0)
    assert (released.phase, released.reason, kind) == ("returning", "dock", "dock")


def test_a_silent_robot_gets_no_orders():
    turnaround, kind = decide(Readiness(), replace(AWAY, is_current=False), 0.0)
    assert (turnaround.phase, turnaround.reason, kind) == ("returning", "offline", None)


def test_a_robot_with_a_camera_is_ready_once_it_gave_a_picture_at_home():
    seeing = replace(HOME, has_camera=True)
    turnaround, kind = decide(Readiness(), seeing, 0.0)
    assert (turnaround.phase, turnaround.reason, kind) == ("returning", "picture", "picture")
    assert (
        decide(answered(turnaround, "picture", 0.0, "RUNNING"), seeing, 1.0)[0].phase == "returning"
    )
    assert decide(answered(turnaround, "picture", 0.0, "FINISHED"), seeing, 2.0) == (
        Readiness("ready"),
        None,
    )
    assert (
        decide(answered(turnaround, "picture", 0.0, "FAILED", "too_large"), seeing, 2.0)[0].phase
        == "ready"
    ), "a large picture is one, too"


def test_a_camera_without_pictures_pauses_the_queue_and_is_tried_again():
    turnaround, now, orders = Readiness(), 0.0, 0
    for _ in range(100):
        turnaround, kind = decide(turnaround, replace(HOME, has_camera=True), now)
        if kind is not None:
            orders += 1
            turnaround = answered(turnaround, kind, now, "FAILED", "no_picture")
        now += 1.0
    assert (turnaround.phase, turnaround.reason, orders) == ("paused", "no_picture", ATTEMPTS)
    again, kind = decide(turnaround, replace(HOME, has_camera=True), now + PAUSED_RETRY_S)
    assert (again.phase, kind) == ("paused", "picture")
    assert (
        decide(
            answered(again, "picture", now + PAUSED_RETRY_S, "FINISHED"),
            replace(HOME, has_camera=True),
            now + PAUSED_RETRY_S + 1,
        )[0].phase
        == "ready"
    )


def test_no_picture_is_asked_for_while_the_robot_still_has_its_last_driver():
    held = replace(HOME, has_camera=True, driver_released=False)
    turnaround, kind = decide(Readiness(), held, 0.0)
    assert (turnaround.phase, kind) == ("returning", None)
    assert decide(turnaround, replace(held, driver_released=True), 1.0)[1] == "picture"


def test_a_picture_from_before_it_was_pushed_out_of_its_station_does_not_count():
    seeing = replace(HOME, has_camera=True)
    turnaround, _ = decide(
        answered(Readiness(), "picture", 0.0, "FINISHED"), replace(seeing, is_responsive=False), 1.0
    )
    assert decide(turnaround, seeing, 2.0)[0].phase == "ready"
    away, kind = decide(turnaround, replace(seeing, docked=False), 2.0)
    assert kind == "dock"
    assert decide(answered(away, "dock", 2.0, "FINISHED"), seeing, 9.0)[1] == "picture"


def test_a_robot_that_answers_too_late_is_waited_for_and_pauses_the_queue_in_the_end():
    late = replace(HOME, has_camera=True, is_responsive=False)
    turnaround, kind = decide(Readiness(), late, 100.0)
    assert (turnaround.phase, turnaround.reason, kind) == ("returning", "network", None)
    turnaround, _ = decide(turnaround, late, 100.0 + NETWORK_PAUSE_S)
    assert (turnaround.phase, turnaround.reason) == ("paused", "network")
    assert decide(turnaround, replace(late, is_responsive=True), 200.0)[1] == "picture"
    assert decide(turnaround, replace(late, has_camera=False, is_responsive=True), 200.0)[
        0
    ] == Readiness("ready")


@pytest.mark.parametrize("condition", [AWAY, HOME, replace(HOME, head_is_level=False)])
def test_a_stop_between_visits_pauses_until_it_is_released(condition):
    running = answered(Readiness(), "dock", 0.0, "CANCELLED")
    stopped, order = decide(running, replace(condition, stopped=True), 1.0)
    assert (stopped, order) == (Readiness("paused", "stopped"), None)
    again = decide(stopped, replace(condition, stopped=True), 10_000.0)
    assert again == (stopped, None)
    assert decide(stopped, AWAY, 10_001.0)[1] == "dock"
