"""Joins the two messages of a photo, which arrive in either order: JPEG and event."""

import hashlib
from dataclasses import dataclass

from robots.api.messages import Event

PAIR_TIMEOUT_S = 60.0
MAX_WAITING = 64


@dataclass(frozen=True)
class RecordedPhoto:
    """A photo with both of its messages."""

    robot: str
    event: Event
    jpeg: bytes
    sha256: str

    @property
    def intact(self) -> bool:
        """Tell whether the bytes are those that the robot hashed."""
        return self.event.sha256 == self.sha256


class Photos:
    """Messages that wait for their other half; keys are (robot, action id)."""

    def __init__(self) -> None:
        self._events: dict[tuple[str, str], tuple[float, Event]] = {}
        self._jpegs: dict[tuple[str, str], tuple[float, bytes]] = {}

    def event(self, robot: str, event: Event, now: float) -> RecordedPhoto | None:
        """Take the event of a photo."""
        key = (robot, event.action_id or "")
        self._events[key] = (now, event)
        return self._whole(key)

    def jpeg(self, robot: str, action_id: str, jpeg: bytes, now: float) -> RecordedPhoto | None:
        """Take the bytes of a photo."""
        key = (robot, action_id)
        self._jpegs[key] = (now, jpeg)
        return self._whole(key)

    def _whole(self, key: tuple[str, str]) -> RecordedPhoto | None:
        if key not in self._events or key not in self._jpegs:
            return None
        (_, event), (_, jpeg) = self._events.pop(key), self._jpegs.pop(key)
        return RecordedPhoto(key[0], event, jpeg, hashlib.sha256(jpeg).hexdigest())

    def forgotten(self, now: float) -> list[tuple[str, str]]:
        """Remove and return the keys of halves that waited too long, or are too many."""
        keys: list[tuple[str, str]] = []
        for halves in (self._events, self._jpegs):
            late = [key for key, (since, _) in halves.items() if now - since > PAIR_TIMEOUT_S]
            late += [key for key in halves if key not in late][
                : max(0, len(halves) - len(late) - MAX_WAITING)
            ]
            keys += late
            for key in late:
                del halves[key]
        return keys
