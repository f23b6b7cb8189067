"""Timeouts of tests. They are generous, since a busy computer is slow: speed is measured by the
benchmarks.
"""

FACTOR = 4.0
PRESSED = 5.5  # s after a request to drive: later, an offered turn must be accepted
HELD = 8.0  # s until a key is pressed again: a page releases all keys when its link is replaced


def patient(seconds: float) -> float:
    """Return the timeout for what takes up to `seconds` on an idle computer."""
    return seconds * FACTOR
