"""The samples of marker streams. Pure."""

from dataclasses import dataclass
from typing import Any

import msgspec


class Marker(msgspec.Struct, frozen=True, omit_defaults=True):
    """A sample of our stream, sent as JSON. `t` is in seconds since the grant of the robot, absent
    without a session; `data` depends on the type as in the events of a dataset.
    """

    type: str
    source: str
    session: str = ""
    participant: str = ""
    t: float | None = None
    data: dict[str, Any] = {}

    def text(self) -> str:
        return msgspec.json.encode(self).decode()


@dataclass(frozen=True)
class TimedMarker:
    """A marker at `at`, Unix seconds by the server's clock; `key` identifies it."""

    key: tuple[Any, ...]
    at: float
    marker: Marker


@dataclass(frozen=True)
class ForeignMarker:
    """A sample of another stream at `at`, Unix seconds by the server's clock."""

    stream: str
    text: str
    at: float
