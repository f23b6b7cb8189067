"""A photo comes in two messages in either order: the JPEG, and the event that names its session and
its SHA-256.
"""

import hashlib
from dataclasses import dataclass

from robots.api.messages import Event

PATIENCE = 60.0
MOST = 64


@dataclass(frozen=True)
class RecordedPhoto:
    """A whole photo; `intact` says whether the bytes are those that the robot hashed."""

    robot: str
    event: Event
    jpeg: bytes
    sha256: str

    @property
    def intact(self) -> bool:
        """Tell whether nothing happened to it on the way."""
        return self.event.sha256 == self.sha256


class Photos:
    """Halves of photos that wait for their other half; keys are (robot, action id)."""

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
        """Return and drop what has waited too long, or is too much; oldest first."""
        keys: list[tuple[str, str]] = []
        for halves in (self._events, self._jpegs):
            late = [key for key, (since, _) in halves.items() if now - since > PATIENCE]
            late += [key for key in halves if key not in late][
                : max(0, len(halves) - len(late) - MOST)
            ]
            keys += late
            for key in late:
                del halves[key]
        return keys
