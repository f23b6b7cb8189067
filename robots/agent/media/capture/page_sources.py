"""Video and sound from the page of the robot's own screen, instead of the agent's own devices.

The robot's computer then runs a browser anyway, and the browser knows its camera. Media arrive
encoded and are forwarded unchanged, in one quality. The page sends no capture times: a frame's time
is that of the fastest frame's arrival.
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
from robots.agent.media.rtp import ROUND, STEP, VIDEO_RATE, Continuous, Kind, vp8_payloads
from robots.agent.robot_interface import Frame

# s, and how often a whole picture is asked for in that time
SNAPSHOT_TIMEOUT, SNAPSHOT_ASKS = 3.0, 6
# by which two clocks may differ; the fastest picture of long ago is forgotten as fast
DRIFT = 0.001
MISSING_VIDEO = "no page on the robot's screen provides video"
MISSING_SOUND = "no page on the robot's screen provides sound"
OPENING = 5.0  # s in which the page of the robot's screen begins to send


class _PageSource:
    def __init__(self, kind: Kind, missing: str) -> None:
        self._clock = Continuous(STEP[kind])
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
        """Nothing to begin: the page gives what it gives."""

    def close(self) -> None:
        """Nothing to end."""

    def want(self, number: int) -> None:
        if self._users == 0:
            self._wanted_since = time.monotonic()
        self._users += number


class PageCamera(_PageSource):
    """Takes the place of camera.CameraFeed. On the media loop, but for `snapshot` and `state`.
    `ask` asks the page for a key frame, from any thread.
    """

    rates = (0,)

    def __init__(self, ask: Callable[[], None], deliver: Callable[[Picture], None]) -> None:
        super().__init__("video", MISSING_VIDEO)
        self._ask, self._deliver = ask, deliver
        self._keys = KeyFrames()
        # when, and the Unix time of the clock's tick 0, by the fastest picture
        self._ahead: tuple[float, float] | None = None
        self._source = ""
        self._whole: bytes | None = None
        self._whole_came = threading.Condition()

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
            with self._whole_came:
                self._whole = data
                self._whole_came.notify_all()
        self._deliver(Picture(vp8_payloads(data), key, at % ROUND, self._stamp(at / VIDEO_RATE)))

    def snapshot(self) -> Frame | None:
        """Return the next key frame; None after 3 s. Blocks."""
        with self._whole_came:
            self._whole = None
            for _ in range(SNAPSHOT_ASKS):
                # again and again: a browser that has just made a whole picture passes over who asks
                # for another
                self._ask()
                if self._whole_came.wait_for(
                    lambda: self._whole is not None, timeout=SNAPSHOT_TIMEOUT / SNAPSHOT_ASKS
                ):
                    break
            else:
                return None
            data, stamp = self._whole, time.time()
        frames: list[av.VideoFrame] = av.CodecContext.create("libvpx", "r").decode(av.Packet(data))
        return (
            Frame(picture_of(frames[0], VideoReformatter()), stamp, "yuv420p") if frames else None
        )

    def _stamp(self, seconds: float) -> float:
        now = time.time()
        ahead = now - seconds
        if self._ahead is not None and 0.0 <= ahead - self._ahead[1] < LIMITS.stall:
            ahead = min(ahead, self._ahead[1] + DRIFT * max(0.0, now - self._ahead[0]))
        self._ahead = now, ahead
        return ahead + seconds


class PageMicrophone(_PageSource):
    """Takes the place of sound.MicrophoneFeed; `deliver` gets (payload, RTP ticks) each 20 ms."""

    def __init__(self, deliver: Callable[[bytes, int], None]) -> None:
        super().__init__("audio", MISSING_SOUND)
        self._deliver = deliver

    listen = _PageSource.want

    def take(self, source: str, data: bytes, ticks: int) -> None:
        """Take an encoded sound of a connection; `ticks` are its own."""
        self._last_received_at = time.monotonic()
        self._deliver(data, self._clock.tick(source, ticks))
