"""Notices that apps above this one have for pages, waiting for the session manager's next tick.

Receivers of the session manager's signals call `publish`, in its own process; nobody else listens
here.
"""

from collections import deque

from sessions.protocol import Notice

MOST = 10_000
_waiting: deque[Notice] = deque(maxlen=MOST)


def publish(notice: Notice) -> None:
    """Have a notice brought to the page of its session."""
    _waiting.append(notice)


def are_waiting() -> bool:
    """Tell whether there is anything to publish."""
    return bool(_waiting)


def drain() -> list[Notice]:
    """Return what waits, and forget it."""
    return [_waiting.popleft() for _ in range(len(_waiting))]
