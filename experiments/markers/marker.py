"""What is said on a stream, and what was heard on one. Pure."""

from dataclasses import dataclass
from typing import Any

import msgspec


class Marker(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a sample of the stream says, as JSON. `t` is in seconds since the grant of the robot,
    absent without a session; `data` depends on the type as in the events of a dataset.
    """

    type: str
    source: str
    session: str = ""
    participant: str = ""
    t: float | None = None
    data: dict[str, Any] = {}

    def text(self) -> str:
        """Return the sample."""
        return msgspec.json.encode(self).decode()


@dataclass(frozen=True)
class TimedMarker:
    """A marker at `at`, Unix seconds by the server's clock; `key` tells it from all others."""

    key: tuple[Any, ...]
    at: float
    marker: Marker


@dataclass(frozen=True)
class ForeignMarker:
    """What a stream told at `at`, Unix seconds by the server's clock."""

    stream: str
    text: str
    at: float
