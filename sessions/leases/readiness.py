"""What a robot does between two sessions: it returns to its dock, levels its head, and is ready
when it is fit for the next session.

Pure: `decide` takes the robot's condition and its last order, and returns its readiness and the
next order.

- A robot is ready when it is docked, localized, charged above its limit, looks straight ahead,
  takes a picture and answers in time.
- A robot that is not docked is ordered to dock, three times with a pause between. Then the queue is
  paused with the robot's reason, and the order is repeated every PAUSE seconds: a door that was
  closed may be open by then.
- A docked robot that is not localized gets the pose of its dock; one whose head is tilted is
  ordered to level it; one with a low battery charges. An unknown charge does not delay a session:
  waiting would not make it known, and a person at the robot sees its lamp.
- Finally it is ordered to take a picture, which is not saved: a camera runs only for a viewer, so
  nothing else shows that it works. A robot that answers too late to be driven waits for a better
  network, and pauses the queue when that takes long.
- An emergency stop pauses the queue at once, and so does a stop between sessions. After its release
  all attempts start again. A new driver may take a robot that was only stopped, which releases the
  stop (sessions/leases/store.py). A robot that sends no states gets no orders.

Times are seconds of a monotonic clock.
"""

from dataclasses import dataclass, replace
from typing import Literal

from robots.api.messages import ENDED

Phase = Literal["ready", "returning", "charging", "paused"]
Kind = Literal["dock", "level", "relocalize", "picture"]

# Prefix of the ids of orders between sessions, which belong into no session's record.
ORDERED = "home-"
ATTEMPTS = 3
AGAIN = 5.0
PAUSE = 120.0
STOPPED = "stopped"  # the reason of a pause: the robot was stopped between two sessions
LATE = 30.0  # seconds of a bad network after which the queue is paused
LONGEST = {"dock": 300.0, "level": 15.0, "relocalize": 60.0, "picture": 15.0}
LEVEL = 0.03  # rad


@dataclass(frozen=True)
class RobotCondition:
    """What the robot reports of itself."""

    is_current: bool = True  # its last state is recent enough to decide by
    driver_released: bool = True  # the lease of its last driver is over at the robot, too
    is_responsive: bool = True  # it answers quickly enough to be driven
    has_camera: bool = False
    estop: bool = False
    stopped: bool = False  # a stop keeps it where it is
    docked: bool = False
    localized: bool = True
    head_is_level: bool = True
    charge: float | None = None  # 0 to 1; None when unknown
    charge_limit: float = 0.0


@dataclass(frozen=True)
class Order:
    """An action sent at `at`; `status` and `reason` of its last ActionStatus, if any."""

    action_id: str
    kind: Kind
    at: float
    status: str = ""
    reason: str = ""

    def is_over(self, now: float) -> bool:
        """Tell whether it has ended, or has taken longer than it ever should."""
        return self.status in ENDED or now - self.at > LONGEST[self.kind]


@dataclass(frozen=True)
class Readiness:
    """How far the robot is. `reason` is what it waits for, `tried_at` when the last attempt ended,
    `seen` whether it has taken a picture since it docked, `late_since` since when it has answered
    too late.
    """

    phase: Phase = "returning"
    reason: str = ""
    order: Order | None = None
    attempts: int = 0
    tried_at: float | None = None
    seen: bool = False
    late_since: float | None = None


def decide(
    turnaround: Readiness, condition: RobotCondition, now: float
) -> tuple[Readiness, Kind | None]:
    """Return the readiness now, and the next order, if any."""
    if not condition.is_current:
        return replace(turnaround, reason="offline"), None
    if condition.estop:
        return Readiness("paused", "estop"), None
    if condition.stopped:
        return Readiness("paused", STOPPED), None
    turnaround = _note_picture(turnaround)
    if (
        turnaround.order is not None
        and not turnaround.order.is_over(now)
        and not _is_done(turnaround.order.kind, condition)
    ):
        return turnaround, None
    if condition.docked:
        return _when_docked(turnaround, condition, now)
    return _attempt(replace(turnaround, seen=False, late_since=None), "dock", now)


def _note_picture(turnaround: Readiness) -> Readiness:
    """Note that the robot took a picture, if only one that was too large to be sent."""
    order = turnaround.order
    if (
        order is None
        or order.kind != "picture"
        or not (order.status == "FINISHED" or order.reason == "too_large")
    ):
        return turnaround
    return replace(turnaround, order=None, attempts=0, tried_at=None, seen=True)


def _is_done(kind: Kind, condition: RobotCondition) -> bool:
    return {
        "dock": condition.docked,
        "level": condition.head_is_level,
        "relocalize": condition.localized,
        "picture": False,
    }[kind]


def _when_docked(
    turnaround: Readiness, condition: RobotCondition, now: float
) -> tuple[Readiness, Kind | None]:
    missing: Kind | None = (
        "relocalize"
        if not condition.localized
        else "level"
        if not condition.head_is_level
        else None
    )
    if missing is not None:
        return _attempt(turnaround, missing, now)
    if condition.charge is not None and condition.charge < condition.charge_limit:
        return Readiness("charging", "charging"), None
    if not condition.is_responsive:
        return _wait_for_network(turnaround, now), None
    turnaround = replace(turnaround, late_since=None)
    if condition.has_camera and not turnaround.seen:
        # A robot that still holds its last driver's lease would take the picture for the record of
        # that session.
        return (
            _attempt(turnaround, "picture", now)
            if condition.driver_released
            else (replace(turnaround, phase="returning", reason="picture"), None)
        )
    return Readiness("ready"), None


def _wait_for_network(turnaround: Readiness, now: float) -> Readiness:
    since = now if turnaround.late_since is None else turnaround.late_since
    phase: Phase = "paused" if now - since >= LATE else "returning"
    return replace(
        turnaround,
        phase=phase,
        reason="network",
        order=None,
        attempts=0,
        tried_at=None,
        late_since=since,
    )


def _attempt(turnaround: Readiness, kind: Kind, now: float) -> tuple[Readiness, Kind | None]:
    """Note how the last attempt ended, and begin another when it is due."""
    order = turnaround.order
    if order is not None and order.kind == kind:
        reason = order.reason or ("no_answer" if not order.status else "failed")
        turnaround = replace(
            turnaround, order=None, attempts=turnaround.attempts + 1, tried_at=now, reason=reason
        )
    elif order is not None:
        turnaround = replace(turnaround, order=None, attempts=0, tried_at=None)
    spent = turnaround.attempts >= ATTEMPTS
    phase: Phase = "paused" if spent else "returning"
    wait = PAUSE if spent else AGAIN
    if turnaround.tried_at is not None and now - turnaround.tried_at < wait:
        return replace(turnaround, phase=phase), None
    return replace(turnaround, phase=phase, reason=turnaround.reason if spent else kind), kind
