"""A value from one thread to another, of which only the newest counts, such as a camera's frame."""

import threading
from typing import Generic, TypeVar

Thing = TypeVar("Thing")


class LatestValue(Generic[Thing]):
    def __init__(self) -> None:
        self._news = threading.Condition()
        self._thing: Thing | None = None

    def put(self, thing: Thing | None) -> None:
        """Replace the value; None empties it."""
        with self._news:
            self._thing = thing
            self._news.notify_all()

    def take(self, timeout: float) -> Thing | None:
        """Take the value, waiting `timeout` seconds at most; None without one."""
        with self._news:
            self._news.wait_for(lambda: self._thing is not None, timeout)
            thing, self._thing = self._thing, None
            return thing
