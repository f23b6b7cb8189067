"""A log that nobody can fill: of each event a few lines a minute, fewer about one user or address,
and a count of those left out.
"""

import time
from collections import Counter
from collections.abc import Callable
from typing import Any

PERIOD_S = 60.0
LINES_OF_SUBJECT = 5  # of one event about one user or address in a period
LINES_OF_EVENT = 50


class BoundedLog:
    """Writes to `logger`; the subject of an event is who it is about."""

    def __init__(self, logger: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._clock = logger, clock
        self._began = clock()
        self._lines: Counter[tuple[str, str | None]] = Counter()
        self._left_out: Counter[str] = Counter()

    def write(self, level: int, subject: str, event: str, **fields: object) -> None:
        """Write an event about a subject, or count it as left out."""
        self.flush()
        if (
            self._lines[event, None] >= LINES_OF_EVENT
            or self._lines[event, subject] >= LINES_OF_SUBJECT
        ):
            self._left_out[event] += 1
            return
        self._lines[event, None] += 1
        self._lines[event, subject] += 1
        self._logger.log(level, event, **fields)

    def flush(self) -> None:
        """When a period is over, say how many lines were left out in it, and begin anew."""
        now = self._clock()
        if now - self._began < PERIOD_S:
            return
        for event, count in self._left_out.items():
            self._logger.warning(
                "broker_log_left_out", what=event, lines=count, seconds=round(now - self._began)
            )
        self._began = now
        self._lines.clear()
        self._left_out.clear()
