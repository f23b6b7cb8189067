"""When a process that ended is started again: a decision on plain data, without processes or a
clock.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class RestartPolicy:
    """How a process is started again, in seconds and deaths.

    A process that has lived shorter than `settled` died quickly; each quick death in a row doubles
    the delay before the next start.
    """

    first_delay: float = 1.0
    longest_delay: float = 30.0
    settled: float = 20.0
    # in a row, after which an essential process is given up; any other is tried for ever
    quick_deaths: int = 5


@dataclass(frozen=True)
class Restart:
    """Start it again after so many seconds."""

    delay: float


@dataclass(frozen=True)
class GiveUp:
    """Nothing works without it, and it does not live."""


def deaths_in_a_row(policy: RestartPolicy, before: int, lived: float) -> int:
    """Return the number of quick deaths in a row, this one included; `before` is what it was,
    `lived` the seconds since the last start.
    """
    return 1 if lived >= policy.settled else before + 1


def after_death(policy: RestartPolicy, deaths: int, *, is_essential: bool) -> Restart | GiveUp:
    """Return what is to be done after so many quick deaths in a row (at least 1)."""
    if is_essential and deaths >= policy.quick_deaths:
        return GiveUp()
    return Restart(min(policy.longest_delay, policy.first_delay * 2.0 ** min(deaths - 1, 30)))
