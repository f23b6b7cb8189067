"""Messages about robots of other session managers, kept for some seconds.

While several session managers share the robots, each receives everything of its own robots, and the
rare messages of all: events, actions, photos and page reports. If another process dies and this one
gets its robots, the rare messages that it had not written are here, and its states are requested
again by their numbers.
"""

from collections import deque
from typing import Generic, TypeVar

from sessions.shards.ownership import Ownership, ShardChanges

EARLY_SECONDS = 5.0
MAX_MESSAGES = 5000
MAX_BYTES = 32 * 1024 * 1024

Item = TypeVar("Item")


class ForeignMessages(Generic[Item]):
    """Items in the order of their receipt. All times are Unix seconds."""

    def __init__(self, ownership: Ownership) -> None:
        self._changes = ShardChanges(ownership)
        self._kept: deque[tuple[float, str, int, Item]] = deque()
        self._bytes = 0

    def keep(self, robot: str, item: Item, at: float, size: int = 0) -> None:
        """Keep an item of `size` bytes about a robot, received at `at`."""
        self._kept.append((at, robot, size, item))
        self._bytes += size
        while (
            self._kept[0][0] < at - EARLY_SECONDS
            or len(self._kept) > MAX_MESSAGES
            or self._bytes > MAX_BYTES
        ):
            self._bytes -= self._kept.popleft()[2]

    def claim(self, now: float) -> list[Item]:
        """Return the recent items about robots that have become ours since the last call."""
        if not self._changes:
            return []
        _, foreign = self._changes.take({robot for _, robot, _, _ in self._kept})
        recent = [kept for kept in self._kept if kept[0] >= now - EARLY_SECONDS]
        self._kept = deque(kept for kept in recent if kept[1] in foreign)
        self._bytes = sum(size for _, _, size, _ in self._kept)
        return [item for _, robot, _, item in recent if robot not in foreign]
