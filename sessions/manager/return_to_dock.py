"""Robots between two sessions: the decisions of sessions/leases/readiness.py, carried out in the
database and sent to the robots.

Runs in the session manager's scheduler thread. Orders are remembered in memory only: a session
manager that has just started repeats them, and a robot that is already returning continues.
"""

import datetime
import math
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import structlog

from robots.api import codec, messages, topics
from robots.models import Robot, RobotPresence
from sessions import signals, system_log
from sessions.leases.readiness import (
    LEVEL_RAD,
    ORDERED,
    Kind,
    Order,
    Readiness,
    RobotCondition,
    decide,
)
from sessions.leases.store import LIVE
from sessions.leases.transitions import STATE_SILENCE
from sessions.manager.robot_liveness import RobotLiveness
from sessions.manager.scheduler import ManagerMessage, send
from sessions.models import Lease
from sessions.shards.ownership import EVERYTHING, Ownership

logger = structlog.stdlib.get_logger(__name__)

USER = "session-manager"


@dataclass(frozen=True)
class _Known:
    """The properties of a robot that its states do not have, from its row."""

    tilt_home: float | None
    dock: tuple[float, float, float] | None
    has_camera: bool


class ReturnToDock:
    """The readiness of robots that are under way, remembered between two ticks."""

    def __init__(self, ownership: Ownership = EVERYTHING) -> None:
        self._ownership = ownership
        self._under_way: dict[str, Readiness] = {}

    def tick(
        self, liveness: Mapping[str, RobotLiveness], now: datetime.datetime, monotonic: float
    ) -> Iterator[ManagerMessage]:
        """Advance every robot that is not ready; yield the messages to publish. Both times are the
        present; durations are measured by `monotonic`, in seconds.
        """
        rows = Robot.objects.exclude(presence__turnaround=Robot.Turnaround.READY).select_related(
            "floor_plan"
        )
        away = [robot for robot in rows if self._ownership.owns(robot.name)]
        held = set(
            Lease.objects.filter(robot__in=away, session__state__in=LIVE).values_list(
                "robot_id", flat=True
            )
        )
        self._under_way = {
            name: self._under_way[name]
            for name in (robot.name for robot in away)
            if name in self._under_way
        }
        for robot in away:
            with self._ownership.about(robot.name):
                if robot.pk in held or not robot.can_go_home or not robot.enabled:
                    yield from self._cancel(robot, now, monotonic)
                else:
                    yield from self._advance(robot, liveness.get(robot.name), now, monotonic)

    def _cancel(
        self, robot: Robot, now: datetime.datetime, monotonic: float
    ) -> Iterator[ManagerMessage]:
        """End the return of a robot that a session holds, or that need not return any more."""
        order = self._under_way.pop(robot.name, Readiness()).order
        if order is not None and not order.is_over(monotonic):
            yield _outbound(robot, messages.Cancel(**_signature(now), target=order.action_id))
        self._save(robot, Readiness("ready"), now)

    def _advance(
        self,
        robot: Robot,
        liveness: RobotLiveness | None,
        now: datetime.datetime,
        monotonic: float,
    ) -> Iterator[ManagerMessage]:
        """Decide the next step of a robot's return, store it, and yield the order for it.

        The row is stored before the order is sent: if the database or the fence refuses it, the
        robot receives nothing, and the next tick decides again.
        """
        known = _known(robot)
        before = self._under_way.get(robot.name, Readiness(reason=robot.presence.turnaround_reason))
        readiness, kind = decide(
            _with_status(before, liveness),
            _condition(robot, known, liveness, monotonic),
            monotonic,
        )
        if kind is not None:
            action = _action(kind, known, now)
            readiness = replace(readiness, order=Order(action.action_id, kind, monotonic))
            logger.info("robot_sent_home", robot=robot.name, kind=kind, action=action.action_id)
        self._save(robot, readiness, now)
        self._under_way[robot.name] = readiness
        if readiness.phase == "ready":
            del self._under_way[robot.name]
        if kind is not None:
            yield _outbound(robot, action)

    def _save(self, robot: Robot, readiness: Readiness, now: datetime.datetime) -> None:
        before, reason = robot.presence.turnaround, readiness.reason[:300]
        if (before, robot.presence.turnaround_reason) == (readiness.phase, reason):
            return
        changed = RobotPresence.objects.filter(robot=robot, turnaround=before).update(
            turnaround=readiness.phase, turnaround_reason=reason, turnaround_at=now
        )
        if changed and readiness.phase == "paused" and before != "paused":
            system_log.log("queue_paused", "warning", robot=robot, at=now, reason=readiness.reason)
            send(signals.queue_paused, robot=robot, reason=readiness.reason, at=now)
        elif changed and readiness.phase == "ready":
            system_log.log("robot_ready", robot=robot, at=now, after=before)


def _with_status(readiness: Readiness, liveness: RobotLiveness | None) -> Readiness:
    """Add the robot's newest answer to its order."""
    order = readiness.order
    status = liveness.answers.get(order.action_id) if liveness and order else None
    if order is None or status is None:
        return readiness
    return replace(readiness, order=replace(order, status=status.status, reason=status.reason))


def _condition(
    robot: Robot, known: _Known, liveness: RobotLiveness | None, now: float
) -> RobotCondition:
    state = liveness.state if liveness is not None else None
    if (
        liveness is None
        or state is None
        or liveness.state_at is None
        or now - liveness.state_at > STATE_SILENCE
    ):
        return RobotCondition(is_current=False)
    level = (
        known.tilt_home is None
        or state.tilt is None
        or abs(state.tilt - known.tilt_home) <= LEVEL_RAD
    )
    return RobotCondition(
        driver_released=state.session is None,
        is_responsive=liveness.is_prompt(now),
        has_camera=known.has_camera,
        estop=state.safety.estop,
        stopped=state.session is None and state.safety.inhibited == "stopped",
        docked=state.docked,
        localized=state.pose.localized,
        head_is_level=level,
        charge=state.battery.charge,
        charge_limit=robot.charge_limit,
    )


def _known(robot: Robot) -> _Known:
    factsheet = robot.presence.factsheet or {}
    capabilities = factsheet.get("capabilities", ())
    tilt = factsheet.get("tilt") if "tilt" in capabilities else None
    docks = robot.floor_plan.plan.get("docks", ()) if robot.floor_plan else ()
    dock = next(
        (
            (d["x"], d["y"], d.get("theta", 0.0))
            for d in docks
            if d.get("type") == factsheet.get("series")
        ),
        None,
    )
    return _Known(tilt.get("home", 0.0) if tilt else None, dock, "photo" in capabilities)


def _action(kind: Kind, known: _Known, now: datetime.datetime) -> messages.Action:
    if kind == "dock":
        return messages.Dock(**_signature(now))
    if kind == "picture":
        return messages.Photo(**_signature(now))
    if kind == "level":
        return messages.Tilt(**_signature(now), angle=known.tilt_home or 0.0)
    x, y, theta = known.dock or (None, None, None)
    return messages.Relocalize(
        **_signature(now),
        x=x,
        y=y,
        theta=None if theta is None else math.remainder(theta, math.tau),
    )


def _signature(now: datetime.datetime) -> dict[str, Any]:
    return {
        "action_id": f"{ORDERED}{secrets.token_hex(8)}",
        "stamp": now.timestamp(),
        "role": "server",
        "user": USER,
    }


def _outbound(robot: Robot, action: messages.Action) -> ManagerMessage:
    return ManagerMessage(topics.of(robot.name, "command/action"), codec.encode(action))
