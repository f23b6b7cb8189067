"""The meaning of a robot's last state for its drivers. Pure."""

import datetime
from typing import Any, Literal

from robots.api.reasons import ReasonCode, parts_of
from robots.models import Robot
from robots.readiness_text import in_words

# The errors of an agent that does not reach its robot.
AWAY = {ReasonCode.ADAPTER_LOST, ReasonCode.ADAPTER_STARTING}

# Why a connected robot cannot be driven: its emergency stop is on, its agent does not reach it, or
# it has another fault, such as not stopping. A paused queue has the same reasons. None of them ends
# or pauses a drive in progress.
Standstill = Literal["", "estop", "not_connected", "fault"]


def trouble_of(report: Any) -> str:
    """Return why an agent does not reach its robot, by its last state; empty if it does."""
    return in_words(next((error for error in _errors(report) if parts_of(error)[0] in AWAY), ""))


def standstill_of(report: Any) -> Standstill:
    """Return why a robot cannot be driven, by its last state; empty if it can."""
    safety = safety_of(report)
    if safety.get("estop") is True:
        return "estop"
    if trouble_of(report):
        return "not_connected"
    return "fault" if safety.get("inhibited") == "fault" or runs_on(report) else ""


def runs_on(report: Any) -> bool:
    """Tell whether a robot moves although it should be at rest, by its last state."""
    return any(_is_running_on(error) for error in _errors(report))


def safety_of(report: Any) -> dict[str, Any]:
    """Return `safety` of a robot's last state, {} when it has none."""
    safety = report.get("safety") if isinstance(report, dict) else None
    return safety if isinstance(safety, dict) else {}


def is_stopped_there(report: Any) -> bool:
    """Tell whether the emergency stop was pressed at the robot, on its screen or its button
    (robots.agent.safety.estop_latch).
    """
    source = safety_of(report).get("estopSource")
    return isinstance(source, str) and source.partition(":")[0] in {"screen", "button"}


def fault_of(report: Any) -> str:
    """Return the first reported fault, or empty. That the robot does not stop precedes others."""
    return in_words(next(iter(sorted(_errors(report), key=_is_running_on, reverse=True)), ""))


def _is_running_on(error: str) -> bool:
    return parts_of(error)[0] is ReasonCode.RUNS_ON


def _errors(report: Any) -> list[str]:
    errors = report.get("errors") if isinstance(report, dict) else None
    listed = errors if isinstance(errors, list | tuple) else ()
    return [error for error in listed if isinstance(error, str)]


def has_problem(robot: Robot, now: datetime.datetime) -> bool:
    """Tell whether a robot is online and needs a person's help: it cannot be driven, or could not
    get ready for the next visit.
    """
    is_stuck = robot.presence.turnaround == Robot.Turnaround.PAUSED
    return robot.is_online(now) and bool(standstill_of(robot.presence.report) or is_stuck)
