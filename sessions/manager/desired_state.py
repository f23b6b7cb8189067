"""The settings of each robot, published retained: assistance, doors and networks (`config`) and its
map (`floorplan`).

The session manager publishes them when it starts and whenever they are changed in the
administration, so that a robot knows its site before its first session. While a session holds the
robot, the session's terms override the settings; afterwards their changes are undone: a door that
only the terms mention returns to its state in the plan.
"""

import datetime
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec

from robots.api import codec, topics
from robots.api.floorplan import DoorState
from robots.api.messages import Config
from robots.models import FloorPlan, Robot
from sessions.leases import terms
from sessions.leases.store import LIVE
from sessions.leases.terms import FREE, Terms
from sessions.manager.scheduler import ManagerMessage
from sessions.models import Lease, Session
from sessions.shards.ownership import EVERYTHING, Ownership, ShardChanges

# Between two readings of all robots: ten thousand of them take a tenth of a second to read, and a
# hundred plans half of that.
READ_ALL_SECONDS = 2.0
READ = ("id", "name", "assist", "doors", "floor_plan_id", "calls")


@dataclass
class _Published:
    """The last messages to a robot; `doors` are those that terms have ever set."""

    doors: set[str] = field(default_factory=set)
    config: Config | None = None
    floor_plan: str = ""
    # the robot's row and its plan when they were last read without a session
    seen: object = None


class DesiredState:
    """Remembers the last messages to each robot."""

    def __init__(self, ownership: Ownership = EVERYTHING) -> None:
        self._ownership, self._shard_changes = ownership, ShardChanges(ownership)
        self._published: dict[str, _Published] = {}
        # what tells one state of a plan from another, and the plan, by its key
        self._plans: dict[Any, tuple[str, dict[str, Any]]] = {}
        self._read_at = -math.inf
        self._held: set[Any] = set()  # the robots that a session held at the last tick
        # robots that had a session before this started or got more robots
        self._had_session: set[Any] | None = None

    def tick(self, now: datetime.datetime) -> Iterator[ManagerMessage]:
        """Yield the messages that have changed since the last tick; at the first one, all. Each
        counts as published even if a database error ends the tick.
        """
        if self._shard_changes:
            self._shard_changes.take()
            self._had_session, self._read_at = None, -math.inf
        held = {
            lease.robot_id: lease.session
            for lease in Lease.objects.filter(session__state__in=LIVE).select_related("session")
            if lease.session
        }
        rows = Robot.objects.order_by()
        reads_all = now.timestamp() - self._read_at >= READ_ALL_SECONDS
        if reads_all:
            plans = FloorPlan.objects.values_list("pk", "sha256", "plan")
            self._plans = {
                key: (f"{sha256} {plan}" if sha256 else "", plan) for key, sha256, plan in plans
            }
        else:  # changes by a session are published at once
            rows = rows.filter(pk__in=held.keys() | self._held)
        self._held = set(held)
        updates: dict[Any, bytes] = {}  # messages of plans, which several robots may share
        for row in rows.values_list(*READ):
            values = dict(zip(READ, row, strict=True))
            if self._ownership.owns(values["name"]):
                yield from self._changes(values, held.get(values["id"]), updates, now)
            else:
                self._published.pop(values["name"], None)  # published again when it is ours
        if reads_all:
            self._read_at = now.timestamp()

    def _changes(
        self,
        values: dict[str, Any],
        session: Session | None,
        updates: dict[Any, bytes],
        now: datetime.datetime,
    ) -> Iterator[ManagerMessage]:
        published = self._published.get(values["name"])
        content, plan = self._plans.get(values["floor_plan_id"], ("", {}))
        # Most robots have not changed. Comparing their rows takes a tenth of the time that creating
        # their objects would.
        seen = (values, content) if session is None else None
        if published is not None and seen is not None and published.seen == seen:
            return
        robot = Robot(**values)
        published = published or self._begin(robot)
        fixed = terms.of(session) if session is not None else FREE
        published.doors |= set(fixed.doors)
        config = _config(robot, session, fixed, _untouched(published.doors, plan))
        if published.config != config:
            published.config = config
            stamped = msgspec.structs.replace(config, stamp=now.timestamp())
            yield _retained(robot.name, "config", codec.encode(stamped))
        if content and published.floor_plan != content:
            key = robot.floor_plan_id
            updates[key] = updates.get(key) or _update(key)
            published.floor_plan = content
            yield _retained(robot.name, "floorplan", updates[key])
        published.seen = seen

    def _begin(self, robot: Robot) -> _Published:
        """Return what matters of the messages that a robot got before this process started."""
        if self._had_session is None:
            granted = Session.objects.filter(granted_at__isnull=False).order_by()
            self._had_session = set(granted.values_list("robot_id", flat=True).distinct())
        doors = _doors_before(robot) if robot.pk in self._had_session else set()
        published = self._published[robot.name] = _Published(doors)
        return published


def _update(plan: Any) -> bytes:
    return codec.encode(FloorPlan.objects.get(pk=plan).as_message())


def _doors_before(robot: Robot) -> set[str]:
    """Return the doors of the last session's terms; its end may have been missed."""
    last = (
        Session.objects.filter(robot=robot, granted_at__isnull=False)
        .order_by("-granted_at")
        .only("terms")
        .first()
    )
    return set(terms.of(last).doors) if last is not None else set()


def _untouched(doors: set[str], plan: dict[str, Any]) -> dict[str, DoorState]:
    """Return the states of doors by the plan; a door that it does not have is open."""
    planned: dict[str, DoorState] = {
        door["name"]: door.get("state", "open") for door in plan.get("doors", ())
    }
    return {name: planned.get(name, "open") for name in sorted(doors)}


def _config(
    robot: Robot, session: Session | None, fixed: Terms, untouched: dict[str, DoorState]
) -> Config:
    impaired = fixed.control_network is not None or fixed.video_network is not None
    return Config(
        stamp=0.0,
        assist=fixed.assist or robot.assist,
        doors={**untouched, **robot.doors, **fixed.doors},
        control_network=fixed.control_network,
        video_network=fixed.video_network,
        calls=robot.calls,
        network_session=str(session.pk) if session is not None and impaired else None,
    )


def _retained(robot: str, suffix: str, payload: bytes) -> ManagerMessage:
    return ManagerMessage(topics.of(robot, suffix), payload, retain=True)
