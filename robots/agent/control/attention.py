"""Whether somebody needs the robot now, as robots/api/idle.py has it: pure, `now` is monotonic
seconds.
"""

from collections.abc import Callable
from dataclasses import dataclass

from robots.api.idle import INTEREST_SECONDS


@dataclass(frozen=True)
class Needs:
    """What the robot sees of those who need it, besides their messages.

    `has_lease` tells whether the server has named a driver, `moves` whether it moves or an action
    drives it, `pages` how many are connected.
    """

    has_lease: Callable[[], bool]
    moves: Callable[[], bool]
    pages: Callable[[], int]


class Attention:
    """Remembers when somebody last sent the robot anything. A robot that has just started counts
    as needed, so that whoever started it sees how it settles.
    """

    def __init__(self, needs: Needs, now: float) -> None:
        self._needs = needs
        self._until = now + INTEREST_SECONDS

    def attract(self, now: float) -> bool:
        """Note a message of somebody who needs the robot; tell whether it was idle before."""
        was_idle = not self.is_needed(now)
        self._until = now + INTEREST_SECONDS
        return was_idle

    def is_needed(self, now: float) -> bool:
        """Tell whether the robot speaks at its full rate: also for INTEREST_SECONDS after the last
        need, so that how a drive ends is seen.
        """
        needs = self._needs
        if needs.has_lease() or needs.pages() > 0 or needs.moves():
            self._until = now + INTEREST_SECONDS
        return now < self._until
