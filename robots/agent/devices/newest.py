"""What one thread gives and another takes, of which only the newest counts: a picture that nobody
fetched is old.
"""

import threading
from typing import Generic, TypeVar

Thing = TypeVar("Thing")


class Newest(Generic[Thing]):
    def __init__(self) -> None:
        self._news = threading.Condition()
        self._thing: Thing | None = None

    def put(self, thing: Thing | None) -> None:
        """Put it there, in the place of what was; None empties it."""
        with self._news:
            self._thing = thing
            self._news.notify_all()

    def take(self, timeout: float) -> Thing | None:
        """Take what is there, or comes within `timeout` seconds; None when nothing did."""
        with self._news:
            self._news.wait_for(lambda: self._thing is not None, timeout)
            thing, self._thing = self._thing, None
            return thing
