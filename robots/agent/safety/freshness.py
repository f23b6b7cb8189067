"""Whether a command is young enough to move a robot, and how fast it still may: delay is what makes
remote driving dangerous.
"""

from dataclasses import dataclass

from robots.agent.safety.clock_sync import PeerClock
from robots.api.age_limits import COMMAND_AGE_BOUND, FRAME_AGE_BOUND, fading
from robots.api.messages import Lease, Limits, VelocityCommand

# What the estimate of a clock may be wrong by, besides half the round trip, before a stamp counts
# as from the future.
FUTURE_TOLERANCE = 0.05
FUTURE_TOLERANCE_CEILING = 0.25
# Frames are stamped and judged by the same clock; the page interpolates between two frames.
FRAME_FUTURE_TOLERANCE = 0.1
LONGEST_FRAME_AGE = 10.0


@dataclass(frozen=True)
class Freshness:
    """What a command's age means: `reason` to refuse it or None, its `age` in seconds, and the
    share of the speed caps it keeps.
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
    """Judge a command by its own age and by that of the frame the visitor saw.

    Args:
        command: what the page sent.
        lease: its limits and whether it requires video.
        limits: the robot's own defaults and ceilings.
        clock: the sender's, None while unknown.
        now: monotonic time of this computer.
        unix: its Unix time, by which frames are stamped.
    """
    if clock is None:
        return Freshness("clock_unknown")
    age = clock.age(command.stamp, now)
    limit = min(
        lease.limits.command_age or limits.command_age,
        limits.command_age_ceiling,
        COMMAND_AGE_BOUND,
    )
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
    """Return how old the picture that the visitor saw is, in seconds; None when none was named, or
    one that cannot have been this robot's.
    """
    age = None if command.frame is None else unix - command.frame
    return age if age is not None and abs(age) <= LONGEST_FRAME_AGE else None


def _frame(
    command: VelocityCommand, lease: Lease, limits: Limits, unix: float
) -> tuple[str | None, float]:
    if command.frame is None:
        return "no_frame", 0.0
    age = unix - command.frame
    limit = min(
        lease.limits.frame_age or limits.frame_age, limits.frame_age_ceiling, FRAME_AGE_BOUND
    )
    if age < -FRAME_FUTURE_TOLERANCE:
        return "frame_future", 0.0
    if age >= limit:
        return "frame_stale", 0.0
    return None, fading(age, limit)
