"""Timeouts of tests. They are generous, since a busy computer is slow: speed is measured by the
benchmarks.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any

FACTOR = 4.0
PRESSED = 5.5  # s after a request to drive: later, an offered turn must be accepted
HELD = 8.0  # s until a key is pressed again: a page releases all keys when its link is replaced


def patient(seconds: float) -> float:
    """Return the timeout for what takes up to `seconds` on an idle computer."""
    return seconds * FACTOR


async def until(condition: Callable[[], Any], seconds: float = 15.0, what: str = "") -> Any:
    """Wait until a condition is true, and return its value."""
    deadline = time.monotonic() + patient(seconds)
    while not (found := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what or condition}"
        await asyncio.sleep(0.01)
    return found
