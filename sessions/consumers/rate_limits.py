"""The rate limits of a page: token buckets; pure, `now` in monotonic seconds."""

from typing import Any, Literal

from robots.api.bucket import Bucket
from robots.api.messages import (
    EStop,
    Photo,
    PointCommand,
    RouteRequest,
    SdpOffer,
    Stop,
    VelocityCommand,
)
from sessions.protocol import PageEvent, PageNetwork, WantOffer

Kind = Literal["velocity", "stop", "other", "point", "route", "photo", "report", "offer"]
KINDS: dict[type, tuple[Kind, ...]] = {
    VelocityCommand: ("velocity",),
    Stop: ("stop",),
    EStop: ("stop",),
    PageEvent: ("report",),
    PageNetwork: ("report",),
    PointCommand: ("point",),
    RouteRequest: ("route",),
    SdpOffer: ("offer",),
    WantOffer: ("offer",),
    Photo: ("other", "photo"),
}


class Allowance:
    """The buckets of one page.

    Driving sends 20 commands a second and a heartbeat five times, a stop is repeated 20 times a
    second, and a WebRTC offer is followed by a burst of candidates: the limits leave room for each.
    `point` messages each pass through the broker and are worth little: their limit is the robot's
    own. A `route` request costs the robot a search, and has a bucket as on the data channel. Stops
    have a separate one, so that no other frames can exhaust it. Photos have one because each is
    stored, half a megabyte. So have reports for the record: the network once a second, signs of the
    visitor as often while the server requests one, and changes, many of them at the start of a
    drive. An offer makes the robot or the SFU open sockets and gather candidates; a page that
    reconnects pauses 0.5 s after the first one, and longer after each later one. Every refused
    frame counts towards the limit of a flood.
    """

    def __init__(self) -> None:
        self._buckets: dict[Kind, Bucket] = {
            "velocity": Bucket(rate=60.0, burst=60.0),
            "stop": Bucket(rate=60.0, burst=60.0),
            "other": Bucket(rate=30.0, burst=60.0),
            "point": Bucket(rate=20.0, burst=10.0),
            "route": Bucket(rate=10.0, burst=10.0),
            "photo": Bucket(rate=0.5, burst=10.0),
            "report": Bucket(rate=3.0, burst=60.0),
            "offer": Bucket(rate=0.5, burst=10.0),
        }
        self._refusals = Bucket(rate=50.0, burst=500.0)

    def passes(self, message: Any, now: float) -> bool:
        """Count a message, and tell whether it is within the limits."""
        kinds = KINDS.get(type(message), ("other",))
        return all(self._buckets[kind].spend(now) for kind in kinds)

    def floods(self, now: float) -> bool:
        """Count a refused frame, and tell whether the connection must end, after too many."""
        return not self._refusals.spend(now)
