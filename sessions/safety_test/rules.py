"""Why a robot cannot have a safety test now. Pure."""

from dataclasses import dataclass
from typing import Any, Literal

from robots.presence.report import safety_of, standstill_of
from sessions.leases.policy import Scene

CAPABILITY, UNDOCK = "safety_test", "undock"
WhyNot = Literal[
    "",
    "offline",
    "unsupported",
    "driven",
    "queue",
    "estop",
    "not_connected",
    "fault",
    "stopped",
    "docked",
    "navigating",
]


@dataclass(frozen=True)
class TestConditions:
    """What the decision needs of a robot: its capabilities, its last state, and whether it is on
    the way to its dock or was stopped after the last visit.
    """

    capabilities: tuple[str, ...]
    report: dict[str, Any]
    is_returning: bool
    was_stopped: bool


def why_not(scene: Scene, robot: TestConditions, now: float) -> WhyNot:
    """Return the first reason against a test, "" when it can begin. `now` is Unix time."""
    if not scene.enabled or not scene.online:
        return "offline"
    if CAPABILITY not in robot.capabilities:
        return "unsupported"
    if scene.holder is not None:
        return "driven"
    if any(session.page_open(now) for session in scene.queue):
        return "queue"
    return standstill_of(robot.report) or _why_not_moved(robot)


def _why_not_moved(robot: TestConditions) -> WhyNot:
    report = robot.report
    if robot.was_stopped or safety_of(report).get("inhibited") == "stopped":
        return "stopped"
    is_charging = report.get("docked") or (report.get("battery") or {}).get("charging")
    if is_charging and UNDOCK not in robot.capabilities:
        return "docked"
    is_busy = report.get("mode") in {"goto", "docking"}
    return "navigating" if is_busy or robot.is_returning else ""
