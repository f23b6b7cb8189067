"""The visitor's voice and face, for the people at the robot.

They arrive encoded on the driver's connection and are forwarded unchanged: a screen that shows the
visitor is one more viewer, with the visitor's packets instead of the camera's. While no screen is
connected they are decoded for the robot's own loudspeaker and display, if it has them. Only media
of the lease's peer are forwarded, as far as the call allows; the rest is counted and dropped.
"""

import time
from collections import Counter
from collections.abc import Callable

import structlog

from robots.agent.media.capture.outputs import OutputFeed
from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.codecs.key_frames import KeyFrames, Reason
from robots.agent.media.rtp import ROUND, STEP, JoinedTicks, Kind, vp8_payloads

log = structlog.stdlib.get_logger(__name__)


class VisitorMedia:
    """Belongs to the media loop, except `let_through`. `drives` tells whether a peer has the lease;
    `ask` asks its page for a key frame; `show` and `sound` send to the screens.
    """

    def __init__(
        self,
        *,
        drives: Callable[[str], bool],
        ask: Callable[[], None],
        show: Callable[[Picture], None],
        sound: Callable[[bytes, int], None],
        outputs: OutputFeed | None,
    ) -> None:
        self._drives = drives
        self._ask = ask
        self._show = show
        self._sound = sound
        self._outputs = outputs
        self._keys = KeyFrames()
        self._clocks = {kind: JoinedTicks(step) for kind, step in STEP.items()}
        self._passing = {"audio": False, "video": False}
        self._broken = True  # pictures were left out: the next one must be a key frame
        self._screens = 0
        self.counts: Counter[str] = Counter()

    def let_through(self, *, audio: bool, video: bool, volume: float) -> None:
        """Forward sound and pictures of the driver, or not; from any thread."""
        self._passing = {"audio": audio, "video": video}
        if self._outputs is not None:
            self._outputs.volume = volume

    def take(self, peer: str, source: str, kind: Kind, data: bytes, ticks: int) -> None:
        """Take an encoded frame or sound of a peer's connection `source`, at its `ticks`."""
        if not self._drives(peer):
            self.counts["not_driver"] += 1
            return
        if not data or not self._passing[kind]:
            self.counts["not_let_through"] += 1
            self._broken |= kind == "video"
            return
        self.counts[kind] += 1
        at = self._clocks[kind].tick(source, ticks)
        if kind == "video":
            self._take_picture(data, at)
        elif self._screens:
            self._sound(data, at)
        elif self._outputs is not None:
            self._outputs.hear(data)

    # --- for a screen, as viewer.WatchedVideo and viewer.Sounds -----------------------------------

    @property
    def rates(self) -> tuple[int, ...]:
        """A single layer, whose rate is unknown."""
        return (0,)

    def watch(self, number: int, layer: int = 0) -> None:
        self._screens += number

    def listen(self, number: int, *, narrow: bool = False) -> None:
        """Nothing to start: the visitor's sound arrives anyway."""

    def ask_key_frame(self, reason: Reason, layer: int = 0) -> None:
        """Ask the visitor's page for a key frame, not too often."""
        if self._keys.ask_now(reason, time.monotonic()):
            self._ask()

    # --- inside -----------------------------------------------------------------------------------

    def _take_picture(self, data: bytes, ticks: int) -> None:
        key = data[0] & 1 == 0  # RFC 6386, section 9.1
        if self._broken and not key:
            self.ask_key_frame("lost")
            return
        self._broken = False
        if self._screens:
            self._show(Picture(vp8_payloads(data), key, ticks % ROUND, time.time()))
        elif self._outputs is not None and not self._outputs.see(data, key=key):
            self.ask_key_frame("behind")
