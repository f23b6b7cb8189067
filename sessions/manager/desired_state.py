"""What the server has set on each robot, said to it retained: assistance, doors and networks
(`config`) and its map (`floorplan`).

The session manager says it when it begins and whenever it was changed in the administration, so
that a robot knows its site before anybody visits it. While a session holds the robot, its terms go
before what is set there; afterwards what they changed is undone: a door that only the terms spoke
of stands again as the plan has it.
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
from sessions.shards.ownership import EVERYTHING, Ownership

# Between two looks at what the administration sets: ten thousand robots take a tenth of a second to
# look at, and a hundred plans half of that.
LOOK_SECONDS = 2.0
READ = ("id", "name", "assist", "doors", "floor_plan_id", "calls")


@dataclass
class _Published:
    """What a robot was told last; `doors` are those that terms have ever set."""

    doors: set[str] = field(default_factory=set)
    config: Config | None = None
    floor_plan: str = ""
    # the robot's row and its plan when they were looked at last while nobody had the robot
    seen: object = None


class DesiredState:
    """Remembers what each robot was told."""

    def __init__(self, ownership: Ownership = EVERYTHING) -> None:
        self._ownership = ownership
        self._published: dict[str, _Published] = {}
        self._version = ownership.version
        # what tells one state of a plan from another, and the plan, by its key
        self._plans: dict[Any, tuple[str, dict[str, Any]]] = {}
        self._looked_at = -math.inf
        self._held: set[Any] = set()  # the robots that somebody had at the last look
        # robots that had a session, when this began or was given others' robots
        self._driven: set[Any] | None = None

    def tick(self, now: datetime.datetime) -> Iterator[ManagerMessage]:
        """Yield what has changed since the last look; everything at the first one. Each counts as
        said from then on, also when an error of the database ends the look.
        """
        if self._version != self._ownership.version:
            self._version, self._driven = self._ownership.version, None
            self._looked_at = -math.inf
        held = {
            lease.robot_id: lease.session
            for lease in Lease.objects.filter(session__state__in=LIVE).select_related("session")
            if lease.session
        }
        rows = Robot.objects.order_by()
        everybody = now.timestamp() - self._looked_at >= LOOK_SECONDS
        if everybody:
            plans = FloorPlan.objects.values_list("pk", "sha256", "plan")
            self._plans = {
                key: (f"{sha256} {plan}" if sha256 else "", plan) for key, sha256, plan in plans
            }
        else:  # what a visit changes, its robot is told at once
            rows = rows.filter(pk__in=held.keys() | self._held)
        self._held = set(held)
        updates: dict[Any, bytes] = {}
        # Most robots are as they were: they are compared as rows, for an object of each takes ten
        # times as long.
        for row in rows.values_list(*READ):
            values = dict(zip(READ, row, strict=True))
            name = values["name"]
            if not self._ownership.owns(name):
                self._published.pop(name, None)  # said again when it is ours
                continue
            published = self._published.get(name)
            session = held.get(values["id"])
            content, plan = self._plans.get(values["floor_plan_id"], ("", {}))
            seen = (row, content) if session is None else None
            if published is not None and seen is not None and published.seen == seen:
                continue
            robot = Robot(**values)
            published = published or self._begin(robot)
            fixed = terms.of(session) if session is not None else FREE
            config = _config(
                robot, session, fixed, _untouched(published.doors | set(fixed.doors), plan)
            )
            published.doors |= set(fixed.doors)
            if published.config != config:
                published.config = config
                yield _retained(robot.name, "config", codec.encode(_stamped(config, now)))
            if content and published.floor_plan != content:
                key = robot.floor_plan_id
                updates[key] = updates.get(key) or _update(key)
                published.floor_plan = content
                yield _retained(robot.name, "floorplan", updates[key])
            published.seen = seen
        if everybody:
            self._looked_at = now.timestamp()

    def _begin(self, robot: Robot) -> _Published:
        """Return what a robot was told before this session manager began, as far as it matters."""
        if self._driven is None:
            granted = Session.objects.filter(granted_at__isnull=False).order_by()
            self._driven = set(granted.values_list("robot_id", flat=True).distinct())
        doors = _doors_before(robot) if robot.pk in self._driven else set()
        published = self._published[robot.name] = _Published(doors)
        return published


def _update(plan: Any) -> bytes:
    return codec.encode(FloorPlan.objects.get(pk=plan).as_message())


def _doors_before(robot: Robot) -> set[str]:
    """Return the doors that the terms of the robot's last session spoke of, for a session manager
    that was not there to see it end.
    """
    last = (
        Session.objects.filter(robot=robot, granted_at__isnull=False)
        .order_by("-granted_at")
        .only("terms")
        .first()
    )
    return set(terms.of(last).doors) if last is not None else set()


def _untouched(doors: set[str], plan: dict[str, Any]) -> dict[str, DoorState]:
    """Return how doors stand that nobody has set."""
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


def _stamped(config: Config, now: datetime.datetime) -> Config:
    return msgspec.structs.replace(config, stamp=now.timestamp())


def _retained(robot: str, suffix: str, payload: bytes) -> ManagerMessage:
    return ManagerMessage(topics.of(robot, suffix), payload, retain=True)
