"""Notices that apps above this one have for pages, queued until the session manager's next tick.

Only receivers of the session manager's signals may call `publish`: the queue exists in its process
alone.
"""

from collections import deque

from sessions.protocol import Notice

MAX_NOTICES = 10_000
_waiting: deque[Notice] = deque(maxlen=MAX_NOTICES)


def publish(notice: Notice) -> None:
    """Queue a notice for the page of its session."""
    _waiting.append(notice)


def are_waiting() -> bool:
    """Tell whether a notice is queued."""
    return bool(_waiting)


def drain() -> list[Notice]:
    """Return and remove the queued notices."""
    return [_waiting.popleft() for _ in range(len(_waiting))]
