"""Between two sessions, a robot returns to its dock, levels its head, and is ready when it is fit
for the next session.

Pure: `decide` takes the robot's condition and its last order, and returns its readiness and the
next order.

- A robot is ready when it is docked, localized, charged above its limit, looks straight ahead,
  takes a picture and answers in time.
- A robot that is not docked is ordered to dock, three times with a pause between. Then the queue is
  paused with the robot's reason, and the order is repeated every PAUSED_RETRY_S: a door that was
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
RETRY_S = 5.0  # between two attempts
PAUSED_RETRY_S = 120.0  # between two attempts while the queue is paused
STOPPED = "stopped"  # the reason of a pause: the robot was stopped between two sessions
NETWORK_PAUSE_S = 30.0  # of a bad network, after which the queue is paused
TIMEOUTS_S = {"dock": 300.0, "level": 15.0, "relocalize": 60.0, "picture": 15.0}
LEVEL_RAD = 0.03  # largest tilt of a head that counts as level


@dataclass(frozen=True)
class RobotCondition:
    """The robot's condition by its own report."""

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
        return self.status in ENDED or now - self.at > TIMEOUTS_S[self.kind]


@dataclass(frozen=True)
class Readiness:
    """The robot's progress. `reason` is what it waits for, `tried_at` when the last attempt ended,
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
    readiness: Readiness, condition: RobotCondition, now: float
) -> tuple[Readiness, Kind | None]:
    """Return the readiness now, and the next order, if any."""
    if not condition.is_current:
        return replace(readiness, reason="offline"), None
    if condition.estop:
        return Readiness("paused", "estop"), None
    if condition.stopped:
        return Readiness("paused", STOPPED), None
    readiness = _note_picture(readiness)
    if (
        readiness.order is not None
        and not readiness.order.is_over(now)
        and not _is_done(readiness.order.kind, condition)
    ):
        return readiness, None
    if condition.docked:
        return _when_docked(readiness, condition, now)
    return _attempt(replace(readiness, seen=False, late_since=None), "dock", now)


def _note_picture(readiness: Readiness) -> Readiness:
    """Note that the robot took a picture, if only one that was too large to be sent."""
    order = readiness.order
    if order is None or order.kind != "picture":
        return readiness
    if order.status != "FINISHED" and order.reason != "too_large":
        return readiness
    return replace(readiness, order=None, attempts=0, tried_at=None, seen=True)


def _is_done(kind: Kind, condition: RobotCondition) -> bool:
    return {
        "dock": condition.docked,
        "level": condition.head_is_level,
        "relocalize": condition.localized,
        "picture": False,
    }[kind]


def _when_docked(
    readiness: Readiness, condition: RobotCondition, now: float
) -> tuple[Readiness, Kind | None]:
    if not condition.localized:
        return _attempt(readiness, "relocalize", now)
    if not condition.head_is_level:
        return _attempt(readiness, "level", now)
    if condition.charge is not None and condition.charge < condition.charge_limit:
        return Readiness("charging", "charging"), None
    if not condition.is_responsive:
        return _wait_for_network(readiness, now), None
    readiness = replace(readiness, late_since=None)
    if condition.has_camera and not readiness.seen:
        if condition.driver_released:
            return _attempt(readiness, "picture", now)
        # With its last driver's lease, the robot would take the picture for that session's record.
        return replace(readiness, phase="returning", reason="picture"), None
    return Readiness("ready"), None


def _wait_for_network(readiness: Readiness, now: float) -> Readiness:
    since = now if readiness.late_since is None else readiness.late_since
    phase: Phase = "paused" if now - since >= NETWORK_PAUSE_S else "returning"
    return replace(
        readiness,
        phase=phase,
        reason="network",
        order=None,
        attempts=0,
        tried_at=None,
        late_since=since,
    )


def _attempt(readiness: Readiness, kind: Kind, now: float) -> tuple[Readiness, Kind | None]:
    """Note how the last attempt ended, and begin another when it is due."""
    order = readiness.order
    if order is not None and order.kind == kind:
        reason = order.reason or ("no_answer" if not order.status else "failed")
        readiness = replace(
            readiness, order=None, attempts=readiness.attempts + 1, tried_at=now, reason=reason
        )
    elif order is not None:
        readiness = replace(readiness, order=None, attempts=0, tried_at=None)
    spent = readiness.attempts >= ATTEMPTS
    phase: Phase = "paused" if spent else "returning"
    wait = PAUSED_RETRY_S if spent else RETRY_S
    if readiness.tried_at is not None and now - readiness.tried_at < wait:
        return replace(readiness, phase=phase), None
    return replace(readiness, phase=phase, reason=readiness.reason if spent else kind), kind
