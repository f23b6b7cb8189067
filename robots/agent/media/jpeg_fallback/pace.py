"""When the next JPEG is sent through the server, and how large it may be: decisions only.

A page that no WebRTC path reaches requests each picture, and the next one when it has it: a request
is an acknowledgement too. So at most one picture is in flight, whatever the network does, and none
is queued. A picture is sent once for all pages that wait; a driver sets the pace, and another
page's slow network costs the driver nothing. `now` is monotonic time in seconds.
"""

from collections.abc import Callable
from dataclasses import dataclass

from robots.agent.media.codecs.encoder import Tier

FPS = 10
PRESENT = 3.0  # s after its last request in which a page counts as watching
MOST_PAGES = 64
# s that a picture may take longer than a small message; below FAST a larger one can be tried
SLOW, FAST = 0.25, 0.08
PATIENCE, MOST_PATIENCE = 10, 320  # fast pictures in a row before a larger one is tried
MOST_ROUND_TRIP = 2.0
RETRY = 1.0  # s after a camera gave nothing


@dataclass(frozen=True)
class Layer:
    """A step of quality: the size, and JPEG's quantizer (2 is the best, 31 the smallest)."""

    tier: Tier
    quantizer: int


def _layer(width: int, height: int, quantizer: int) -> Layer:
    return Layer(Tier(width, height, FPS, 0), quantizer)


# About 16, 10, 6.5, 4.5, 3.2 and 2 kB for a furnished room.
LAYERS = (
    _layer(480, 360, 4),
    _layer(480, 360, 10),
    _layer(320, 240, 7),
    _layer(320, 240, 14),
    _layer(240, 180, 14),
    _layer(160, 120, 14),
)
FIRST = 2


class StillQuality:
    """The layer, chosen by how long pictures take."""

    def __init__(self) -> None:
        self.layer = FIRST
        self._fast = 0
        self._patience = PATIENCE
        self._tried = False  # the last step was up

    def took(self, seconds: float) -> None:
        """Take how much longer a picture took than a small message."""
        if seconds > SLOW:
            self.too_large()
        elif seconds < FAST:
            self._fast += 1
            if self._fast >= self._patience and self.layer > 0:
                self.layer, self._fast, self._tried = self.layer - 1, 0, True
        else:
            self._fast = 0

    def too_large(self) -> None:
        """Step down; after a failed step up, the next trial waits longer."""
        self._patience = min(MOST_PATIENCE, 2 * self._patience) if self._tried else PATIENCE
        self.layer, self._fast, self._tried = min(len(LAYERS) - 1, self.layer + 1), 0, False


class StillPace:
    """Which pages ask, and when the next picture is sent to whom."""

    def __init__(self, is_driver: Callable[[str], bool]) -> None:
        self.quality = StillQuality()
        self.delay = 0.0  # s that the driver's pictures are held on purpose
        self._is_driver = is_driver
        self._asked: dict[str, float] = {}
        self._waiting: set[str] = set()
        self._stamp: float | None = None
        self._sent = float("-inf")
        self._not_before = float("-inf")

    def ask(self, peer: str, seen: float | None, round_trip: float | None, now: float) -> None:
        if peer not in self._asked and len(self._asked) >= MOST_PAGES:
            return
        self._asked[peer] = now
        self._waiting.add(peer)
        if self._stamp is not None and self._driver(now) in {peer, None}:
            self._acknowledge(seen, round_trip, now)

    def wait(self, now: float) -> float | None:
        """Return seconds until a picture is due, 0 for now; None without a request."""
        driver = self._driver(now)
        if not self._waiting:
            return None
        if driver is not None and driver not in self._waiting:
            return max(0.0, self._asked[driver] + PRESENT - now)
        return max(0.0, self._not_before - now)

    def layer(self) -> Layer:
        return LAYERS[self.quality.layer]

    def sent(self, stamp: float, now: float) -> frozenset[str]:
        """Note that the picture of this stamp was sent to all who waited; return them."""
        waited = frozenset(self._waiting)
        self._waiting.clear()
        self._stamp, self._sent, self._not_before = stamp, now, now + 1.0 / FPS
        return waited

    def failed(self, now: float) -> None:
        self._not_before = now + RETRY

    def watching(self, now: float) -> frozenset[str]:
        """Return the pages that asked within the last seconds, and forget the others."""
        for peer in [peer for peer, asked in self._asked.items() if now - asked >= PRESENT]:
            del self._asked[peer]
            self._waiting.discard(peer)
        return frozenset(self._asked)

    def _driver(self, now: float) -> str | None:
        return next((peer for peer in self.watching(now) if self._is_driver(peer)), None)

    def _acknowledge(self, seen: float | None, round_trip: float | None, now: float) -> None:
        elapsed = now - self._sent - self.delay
        if seen == self._stamp:
            self._stamp = None
            if round_trip is not None:
                self.quality.took(elapsed - min(round_trip, MOST_ROUND_TRIP))
        elif elapsed > PRESENT / 3:
            # it asks again without having seen the last one, which is lost or too large
            self._stamp = None
            self.quality.too_large()
