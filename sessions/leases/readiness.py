"""What happens to a robot between two sessions: it goes home, docks, levels its head, and is free
when it is fit for the next one.

Pure: `decide` looks at what the robot says and at what it was told, and returns how things stand
now and what to tell it next.

- A robot that is docked, localized, charged above its limit, looks straight ahead, gives a picture
  and answers in time is ready.
- One that is not docked is told to dock, three times with a pause between; then the queue is paused
  with the robot's reason, and it is tried again every PAUSE seconds, for a door that was closed may
  be open by then.
- A docked robot that has lost its place is told where it is; one whose head is tilted is told to
  level it; an empty one charges. A charge
  that the robot does not know holds nobody back: waiting would not make it known, and a person at
      the robot sees its lamp.
- Last of all it is asked for a picture, which nobody keeps: a camera runs only while somebody
  looks, so nothing else tells whether it works. A robot that answers later than its driver could
  steer it waits for a better network, and pauses the queue when that takes long.
- An emergency stop pauses at once, and so does a stop between visits; whoever releases it has seen
  to the robot, so all attempts begin anew. A new driver may take a robot that was only stopped
  (sessions/leases/store.py), which releases it. Nothing is ordered of a robot that is not heard of.

Times are seconds of a monotonic clock.
"""

from dataclasses import dataclass, replace
from typing import Literal

from robots.api.messages import ENDED

Phase = Literal["ready", "returning", "charging", "paused"]
Kind = Literal["dock", "level", "relocalize", "picture"]

# how the ids of what is ordered between sessions begin: none of it belongs into anybody's record
ORDERED = "home-"
ATTEMPTS = 3
AGAIN = 5.0
PAUSE = 120.0
STOPPED = "stopped"  # the reason of a pause: somebody stopped the robot between two visits
LATE = 30.0  # seconds of a bad network after which the queue is paused
LONGEST = {"dock": 300.0, "level": 15.0, "relocalize": 60.0, "picture": 15.0}
LEVEL = 0.03  # rad


@dataclass(frozen=True)
class RobotCondition:
    """What the robot reports of itself."""

    heard: bool = True  # its last state is recent enough to decide by
    let_go: bool = True  # the lease of its last driver is over at the robot, too
    prompt: bool = True  # it answers quickly enough to be driven
    sees: bool = False  # it has a camera
    estop: bool = False
    stopped: bool = False  # a stop keeps it where it is
    docked: bool = False
    localized: bool = True
    level: bool = True  # its head looks straight ahead
    charge: float | None = None  # 0 to 1; None when unknown
    charge_limit: float = 0.0


@dataclass(frozen=True)
class Order:
    """What the robot was told at `at`, and how far that is: `status` and `reason` as in
    ActionStatus, empty before any answer.
    """

    action_id: str
    kind: Kind
    at: float
    status: str = ""
    reason: str = ""

    def is_over(self, now: float) -> bool:
        """Tell whether it has ended, or will never."""
        return self.status in ENDED or now - self.at > LONGEST[self.kind]


@dataclass(frozen=True)
class Readiness:
    """How things stand. `reason` says in one word or sentence what is waited for, `tried_at` when
    the last attempt ended.

    `seen` tells whether a picture came since it is home, `late_since` since when it has answered
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
    """Return how things stand now, and what the robot is to be told, if anything."""
    if not condition.heard:
        return replace(turnaround, reason="offline"), None
    if condition.estop:
        return Readiness("paused", "estop"), None
    if condition.stopped:
        return Readiness("paused", STOPPED), None
    turnaround = _looked_at(turnaround)
    if (
        turnaround.order is not None
        and not turnaround.order.is_over(now)
        and not _is_done(turnaround.order.kind, condition)
    ):
        return turnaround, None
    if condition.docked:
        return _at_home(turnaround, condition, now)
    return _try(replace(turnaround, seen=False, late_since=None), "dock", now)


def _looked_at(turnaround: Readiness) -> Readiness:
    """Note that a picture came; one that is too large to be sent is a picture, too."""
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
        "level": condition.level,
        "relocalize": condition.localized,
        "picture": False,
    }[kind]


def _at_home(
    turnaround: Readiness, condition: RobotCondition, now: float
) -> tuple[Readiness, Kind | None]:
    missing: Kind | None = (
        "relocalize" if not condition.localized else "level" if not condition.level else None
    )
    if missing is not None:
        return _try(turnaround, missing, now)
    if condition.charge is not None and condition.charge < condition.charge_limit:
        return Readiness("charging", "charging"), None
    if not condition.prompt:
        return _wait_for_network(turnaround, now), None
    turnaround = replace(turnaround, late_since=None)
    if condition.sees and not turnaround.seen:
        # A robot that still believes in its last driver would take the picture for that driver's
        # record.
        return (
            _try(turnaround, "picture", now)
            if condition.let_go
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


def _try(turnaround: Readiness, kind: Kind, now: float) -> tuple[Readiness, Kind | None]:
    """Note how the last attempt ended, and begin another when it is time."""
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
