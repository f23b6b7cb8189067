"""Video and sound from the page of the robot's own screen, instead of the agent's own devices.

The robot's computer then runs a browser anyway, and the browser has access to the camera. Media
arrive encoded and are forwarded unchanged, in one layer. The page sends no capture times: they are
computed from the arrival of the fastest frame.
"""

import threading
import time
from collections.abc import Callable

import av
from av.video.reformatter import VideoReformatter

from robots.agent.devices.camera import picture_of
from robots.agent.media.capture.capture import LIMITS, CaptureState
from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.codecs.key_frames import KeyFrames, Reason
from robots.agent.media.rtp import ROUND, STEP, VIDEO_RATE, JoinedTicks, Kind, vp8_payloads
from robots.agent.robot_interface import Frame

# s, and how often a key frame is asked for in that time
SNAPSHOT_TIMEOUT, SNAPSHOT_ASKS = 3.0, 6
DRIFT = 0.001  # of two clocks at most; the fastest frame is forgotten at this rate
MISSING_VIDEO = "no page on the robot's screen provides video"
MISSING_SOUND = "no page on the robot's screen provides sound"
OPENING = 5.0  # s in which the page of the robot's screen should start to send


class _PageSource:
    def __init__(self, kind: Kind, missing: str) -> None:
        self._clock = JoinedTicks(STEP[kind])
        self._missing = missing
        self._users = 0
        self._last_received_at = self._wanted_since = float("-inf")

    @property
    def state(self) -> CaptureState:
        now = time.monotonic()
        if now - self._last_received_at < LIMITS.stall:
            return CaptureState("live")
        if self._users == 0:
            return CaptureState("idle")
        if now - self._wanted_since < OPENING:
            return CaptureState("starting")
        return CaptureState("failed", self._missing)

    def start(self) -> None:
        """Nothing to start: the page sends by itself."""

    def close(self) -> None:
        """Nothing to stop."""

    def want(self, number: int) -> None:
        if self._users == 0:
            self._wanted_since = time.monotonic()
        self._users += number


class PageCamera(_PageSource):
    """Replaces camera.CameraFeed. Belongs to the media loop, except `snapshot` and `state`. `ask`
    asks the page for a key frame, from any thread.
    """

    rates = (0,)

    def __init__(self, ask: Callable[[], None], deliver: Callable[[Picture], None]) -> None:
        super().__init__("video", MISSING_VIDEO)
        self._ask, self._deliver = ask, deliver
        self._keys = KeyFrames()
        # when the last frame arrived, and the Unix time of tick 0 by the fastest one
        self._ahead: tuple[float, float] | None = None
        self._source = ""
        self._key_frame: bytes | None = None
        self._key_frame_arrived = threading.Condition()

    def watch(self, number: int, layer: int = 0) -> None:
        self.want(number)

    def ask_key_frame(self, reason: Reason, layer: int = 0) -> None:
        """Ask the page for a key frame, not too often."""
        if self._keys.ask_now(reason, time.monotonic()):
            self._ask()

    def take(self, source: str, data: bytes, ticks: int) -> None:
        """Take an encoded picture of a connection; `ticks` are its own."""
        key = bool(data) and data[0] & 1 == 0  # RFC 6386, section 9.1
        if not data or (source != self._source and not key):
            self.ask_key_frame("lost")
            return
        self._source, self._last_received_at = source, time.monotonic()
        at = self._clock.tick(source, ticks)
        if key:
            with self._key_frame_arrived:
                self._key_frame = data
                self._key_frame_arrived.notify_all()
        self._deliver(Picture(vp8_payloads(data), key, at % ROUND, self._stamp(at / VIDEO_RATE)))

    def snapshot(self) -> Frame | None:
        """Return the next key frame; None after 3 s. Blocks."""
        with self._key_frame_arrived:
            self._key_frame = None
            for _ in range(SNAPSHOT_ASKS):
                # repeatedly: a browser that has just made a key frame ignores a request for another
                self._ask()
                if self._key_frame_arrived.wait_for(
                    lambda: self._key_frame is not None, timeout=SNAPSHOT_TIMEOUT / SNAPSHOT_ASKS
                ):
                    break
            else:
                return None
            data, stamp = self._key_frame, time.time()
        frames: list[av.VideoFrame] = av.CodecContext.create("libvpx", "r").decode(av.Packet(data))
        if not frames:
            return None
        return Frame(picture_of(frames[0], VideoReformatter()), stamp, "yuv420p")

    def _stamp(self, seconds: float) -> float:
        now = time.time()
        ahead = now - seconds
        if self._ahead is not None and 0.0 <= ahead - self._ahead[1] < LIMITS.stall:
            ahead = min(ahead, self._ahead[1] + DRIFT * max(0.0, now - self._ahead[0]))
        self._ahead = now, ahead
        return ahead + seconds


class PageMicrophone(_PageSource):
    """Replaces sound.MicrophoneFeed; `deliver` gets (payload, RTP ticks) every 20 ms."""

    def __init__(self, deliver: Callable[[bytes, int], None]) -> None:
        super().__init__("audio", MISSING_SOUND)
        self._deliver = deliver

    def listen(self, number: int, *, narrow: bool = False) -> None:
        self.want(number)

    def take(self, source: str, data: bytes, ticks: int) -> None:
        """Take an encoded sound of a connection; `ticks` are its own."""
        self._last_received_at = time.monotonic()
        self._deliver(data, self._clock.tick(source, ticks))
