"""Something done every so often on a loop, and how late the loop was: a load generator that is late
itself must say so.
"""

import asyncio
from array import array
from collections.abc import Callable


class Timers:
    """Repeats things; `late` has the seconds by which each came too late since it
    was emptied last.
    """

    def __init__(self) -> None:
        self.late = array("d")

    def every(self, period: float, phase: float, act: Callable[[], None]) -> None:
        """Do something every `period` seconds, for the first time `phase` periods from now."""
        loop = asyncio.get_running_loop()

        def ring(due: float) -> None:
            now = loop.time()
            self.late.append(now - due)
            # One that was held up for longer is not made up for: neither a page nor a robot says
            # later what it did not say in time.
            following = max(due + period, now)
            loop.call_at(following, ring, following)
            act()

        first = loop.time() + period * phase
        loop.call_at(first, ring, first)
