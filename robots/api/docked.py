"""When a robot is docked: one rule for the agent, for automatic docking, and for tasks of studies.

The charging contacts must meet, or the robot charge, for `seconds` without a break, while the robot
is at rest and receives no velocity other than zero: a robot that slides along its station makes
contact and loses it again, and is docked only if it stays after its driver has released the
controls. It is docked until the contacts have been apart for `release` seconds, because contacts
have springs and bounce.

Pure: readings arrive one at a time and in order, and a frozen state is returned.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class DockedRule:
    """`seconds`: for how long all conditions must be met. `linear` (m/s) and `angular` (rad/s) are
    the greatest speeds that count as rest, `release` is for how long (s) the contacts must be
    apart. A gap of more than `gap` seconds between two readings restarts `seconds`.
    """

    seconds: float = 2.0
    linear: float = 0.03
    angular: float = 0.06
    release: float = 0.5
    gap: float = 1.0

    def is_at_rest(self, linear: float, angular: float) -> bool:
        """Return whether a measured velocity (m/s, rad/s) counts as rest."""
        return abs(linear) <= self.linear and abs(angular) <= self.angular


DOCKED = DockedRule()
ROUNDING = 1e-6  # seconds that a sum of periods may miss


@dataclass(frozen=True, kw_only=True)
class DockReading:
    """In s, m/s, rad/s. `released`: no velocity other than zero is sent to the wheels."""

    at: float
    contact: bool
    linear: float = 0.0
    angular: float = 0.0
    released: bool = True


@dataclass(frozen=True, kw_only=True)
class DockState:
    """`touching`: the contacts meet, or met within the last `release` seconds. `resting_since`:
    since when there are contact, standstill and released controls together, `apart_since`: since
    when the contacts do not meet; or None.
    """

    docked: bool = False
    touching: bool = False
    resting_since: float | None = None
    apart_since: float | None = None
    at: float | None = None


APART = DockState()


def follow(rule: DockedRule, before: DockState, reading: DockReading) -> DockState:
    """Return the state after the next reading."""
    is_at_rest = rule.is_at_rest(reading.linear, reading.angular)
    rests = reading.contact and is_at_rest and reading.released
    continuous = before.at is not None and reading.at - before.at <= rule.gap
    since = before.resting_since if continuous and before.resting_since is not None else reading.at
    has_rested = rests and reading.at - since >= rule.seconds - ROUNDING
    apart_since: float | None = None
    if not reading.contact:
        apart_since = reading.at if before.apart_since is None else before.apart_since
    is_apart = apart_since is not None and reading.at - apart_since >= rule.release - ROUNDING
    return DockState(
        docked=has_rested or (before.docked and not is_apart),
        touching=reading.contact or (before.touching and not is_apart),
        resting_since=since if rests else None,
        apart_since=apart_since,
        at=reading.at,
    )
