"""How much a page may say: token buckets, pure, `now` in monotonic seconds."""

from typing import Any, Literal

from robots.api.bucket import Bucket
from robots.api.messages import EStop, Photo, PointCommand, SdpOffer, Stop, VelocityCommand
from sessions.protocol import PageEvent, PageNetwork, WantOffer

Kind = Literal["velocity", "stop", "other", "point", "photo", "report", "offer"]


class Allowance:
    """The buckets of one page.

    Driving sends 20 commands a second and a heartbeat five times, a stop is repeated 20 times a
    second, and a WebRTC offer is followed by a burst of candidates: the limits leave room for each.
    Dots on a shared picture are worth little and cost a way through the broker each, so they have
    the tightest, and as many as the robot takes. Stops have a bucket of their own, so that nothing
    else a page says can use it up. Photos are kept for good, half a megabyte each, so they have one
    too, and so has what the page says for the record: its network once a second, signs of the
    visitor as often while the server asks for one, and what changes, much of it at once when a
    drive begins. An offer makes the robot or the SFU open sockets and gather candidates; a page
    that looks for its robot pauses 0.5 s after the first one, and longer after each that follows.
    Every refused frame counts towards the limit of a flood.
    """

    def __init__(self) -> None:
        self._buckets: dict[Kind, Bucket] = {
            "velocity": Bucket(rate=60.0, burst=60.0),
            "stop": Bucket(rate=60.0, burst=60.0),
            "other": Bucket(rate=30.0, burst=60.0),
            "point": Bucket(rate=20.0, burst=10.0),
            "photo": Bucket(rate=0.5, burst=10.0),
            "report": Bucket(rate=3.0, burst=60.0),
            "offer": Bucket(rate=0.5, burst=10.0),
        }
        self._refusals = Bucket(rate=50.0, burst=500.0)

    def passes(self, message: Any, now: float) -> bool:
        """Count a message, and tell whether it may pass."""
        return all(self._buckets[kind].spend(now) for kind in _kinds(message))

    def floods(self, now: float) -> bool:
        """Count one refused frame, and tell whether there are so many that the
        connection must end.
        """
        return not self._refusals.spend(now)


def _kinds(message: Any) -> tuple[Kind, ...]:
    match message:
        case VelocityCommand():
            return ("velocity",)
        case Stop() | EStop():
            return ("stop",)
        case PageEvent() | PageNetwork():
            return ("report",)
        case PointCommand():
            return ("point",)
        case SdpOffer() | WantOffer():
            return ("offer",)
        case Photo():
            return ("other", "photo")
    return ("other",)
