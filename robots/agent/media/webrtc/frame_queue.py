"""Frames and sounds for one viewer, between the shared encoders and aiortc's sender."""

import asyncio
import time
from collections import deque
from collections.abc import Callable

from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.codecs.key_frames import Reason
from robots.agent.media.webrtc.aiortc_hooks import Detour, OutgoingFrame
from robots.agent.media.webrtc.feedback import ArrivalReport
from robots.agent.media.webrtc.sender_queue import ViewerQueue

MAX_SOUNDS = 10  # packets: 0.2 s, on a narrow network 0.6 s
LONGEST_GAP = 0.1  # s between two pictures for which packets are sent again
# s; falling behind more rarely than this is a hold-up, not a narrow network
ONCE = 5.0


class SentRate:
    """The bit/s of the last second."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, int]] = deque()

    def add(self, now: float, octets: int) -> float:
        """Note what was sent; return the seconds since the last time, 0 for the first."""
        gap = now - self._sent[-1][0] if self._sent else 0.0
        self._sent.append((now, octets))
        return gap

    def of(self, now: float) -> float:
        while self._sent and now - self._sent[0][0] > 1.0:
            self._sent.popleft()
        return 8.0 * sum(octets for _, octets in self._sent)


class FrameQueue:
    """The frames for one viewer; belongs to the media loop.

    `before` is called with each frame before it is sent, so that its media clock arrives first,
    `delivered` with what the viewer reports about the arrival of packets.
    """

    def __init__(
        self,
        ask_key_frame: Callable[[Reason], None],
        before: Callable[[Picture], None],
        delivered: Callable[[ArrivalReport], None],
    ) -> None:
        self.queue = ViewerQueue()
        self.last_report = 0.0
        self.sent = 0
        self.more = 0.0  # bit/s to reach by sending packets again
        self._rate = SentRate()
        self.backlog: Callable[[], int] = int
        self.detour: Detour | None = None
        self._ask_key_frame = ask_key_frame
        self._before = before
        self.on_delivery = delivered
        self._behind_at = float("-inf")
        self._open = False
        self._filled = asyncio.Event()

    def put(self, picture: Picture) -> None:
        """Queue a picture; before the connection is up there is nothing to queue for."""
        if not self._open:
            return
        if self.queue.put(picture, self.backlog()):
            self._ask_key_frame(self._why(time.monotonic()))
        if len(self.queue):
            self._filled.set()

    def _why(self, now: float) -> Reason:
        """Return why a viewer needs a key frame: a rare restart is this process's fault."""
        since, self._behind_at = now - self._behind_at, now
        if not self.sent:
            return "joined"
        return "lost" if since > ONCE else "behind"

    async def take(self) -> OutgoingFrame:
        """Wait for the next frame; the first call, on connection, asks for a key frame."""
        if not self._open:
            self._open = True
            self._ask_key_frame("joined")
        while (picture := self.queue.take()) is None:
            self._filled.clear()
            await self._filled.wait()
        self.sent += 1
        self._before(picture)
        now = time.monotonic()
        gap = self._rate.add(now, picture.size)
        missing = max(0.0, self.more - self._rate.of(now)) if self.more else 0.0
        more = int(missing * min(gap, LONGEST_GAP) / 8)
        return OutgoingFrame(picture.payloads, picture.rtp, picture.key, more)

    def key_frame_wanted(self) -> None:
        self._ask_key_frame("lost")

    def on_report(self) -> None:
        self.last_report = time.monotonic()

    @property
    def rate(self) -> float:
        """Return bit/s of the last second."""
        return self._rate.of(time.monotonic())


class SoundQueue:
    """The sound for one listener; the oldest is dropped first. Belongs to the media loop."""

    def __init__(self, origin: int) -> None:
        self.last_report = 0.0
        self.backlog: Callable[[], int] = int
        self.detour: Detour | None = None
        self._origin = origin
        self._sounds: deque[OutgoingFrame] = deque(maxlen=MAX_SOUNDS)
        self._filled = asyncio.Event()

    def put(self, payload: bytes, ticks: int) -> None:
        """Queue a packet of sound that began `ticks` of 1/48000 s after the microphone's first."""
        self._sounds.append(OutgoingFrame((payload,), (self._origin + ticks) % (1 << 32)))
        self._filled.set()

    async def take(self) -> OutgoingFrame:
        while not self._sounds:
            self._filled.clear()
            await self._filled.wait()
        return self._sounds.popleft()

    def key_frame_wanted(self) -> None:
        """Sound has no key frames."""

    def on_report(self) -> None:
        self.last_report = time.monotonic()

    def on_delivery(self, delivery: ArrivalReport) -> None:
        """Sound has one quality."""
