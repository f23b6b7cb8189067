"""The two clocks of a computer, as one thing that a test can turn."""

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class TimeSource:
    """`now` never jumps and judges durations (s, monotonic); `unix` is what stamps say (s, Unix
    time).
    """

    now: Callable[[], float] = time.monotonic
    unix: Callable[[], float] = time.time
