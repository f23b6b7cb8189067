"""Whether a command is young enough to move the robot, and how fast: delay makes remote driving
dangerous.
"""

from dataclasses import dataclass

from robots.agent.safety.clock_sync import PeerClock
from robots.api.age_limits import COMMAND_AGE_BOUND, FRAME_AGE_BOUND, fading
from robots.api.messages import Lease, Limits, VelocityCommand

FUTURE_TOLERANCE = 0.05  # s of error of a clock's offset, besides half the round trip
FUTURE_TOLERANCE_CEILING = 0.25
# s; frames are stamped and judged by the same clock, but the page interpolates between two
FRAME_FUTURE_TOLERANCE = 0.1
LONGEST_FRAME_AGE = 10.0


@dataclass(frozen=True)
class Freshness:
    """A command's age in seconds, the `reason` to refuse it or None, and the share of the speed
    caps it keeps.
    """

    reason: str | None
    age: float = 0.0
    scale: float = 0.0


def judge(
    command: VelocityCommand,
    lease: Lease,
    limits: Limits,
    clock: PeerClock | None,
    *,
    now: float,
    unix: float,
) -> Freshness:
    """Judge a command by its own age and by that of the frame that the visitor saw.

    `clock` is the sender's, None while unknown; `now` is monotonic, `unix` this computer's Unix
    time, by which frames are stamped.
    """
    if clock is None:
        return Freshness("clock_unknown")
    age = clock.age(command.stamp, now)
    stated = lease.limits.command_age or limits.command_age
    limit = min(stated, limits.command_age_ceiling, COMMAND_AGE_BOUND)
    if age < -min(FUTURE_TOLERANCE + clock.round_trip / 2, FUTURE_TOLERANCE_CEILING):
        return Freshness("future", age)
    if age >= limit:
        return Freshness("stale", age)
    scale = fading(age, limit)
    if lease.video == "none":
        return Freshness(None, age, scale)
    reason, frame_scale = _frame(command, lease, limits, unix)
    return Freshness(reason, age, min(scale, frame_scale))


def frame_age(command: VelocityCommand, unix: float) -> float | None:
    """Return the age in seconds of the frame that the visitor saw; None when none, or not one of
    this robot, was named.
    """
    age = None if command.frame is None else unix - command.frame
    return age if age is not None and abs(age) <= LONGEST_FRAME_AGE else None


def _frame(
    command: VelocityCommand, lease: Lease, limits: Limits, unix: float
) -> tuple[str | None, float]:
    if command.frame is None:
        return "no_frame", 0.0
    age = unix - command.frame
    stated = lease.limits.frame_age or limits.frame_age
    limit = min(stated, limits.frame_age_ceiling, FRAME_AGE_BOUND)
    if age < -FRAME_FUTURE_TOLERANCE:
        return "frame_future", 0.0
    if age >= limit:
        return "frame_stale", 0.0
    return None, fading(age, limit)
