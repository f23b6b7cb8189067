"""The robot's camera as the media side uses it: encoded pictures for viewers, and single frames for photos."""

import math
import threading
import time
from collections.abc import Callable, Sequence

from robots.agent.media.capture.capture import Capture, CaptureState
from robots.agent.media.codecs.encoder import LADDER, Picture, PictureEncoder, Tier, is_due
from robots.agent.media.peers.key_frames import KeyFrames, Reason
from robots.agent.media.webrtc.rtp import RtpClock
from robots.agent.robot_interface import Frame, VideoSource

SNAPSHOT_TIMEOUT = 3.0  # s
SNAPSHOT_STARTING = 12.0  # s, from a camera that must be started first: within what sessions/leases/readiness.py waits for a photo
SNAPSHOT_LOOK = 0.25  # s between two looks whether it still starts


class _Rung:
    """One quality: its encoder, who watches it, and when it needs a key frame."""

    def __init__(self, encoder: PictureEncoder) -> None:
        self.encoder = encoder
        self.viewers = 0
        self.last_stamp: float | None = None
        self._keys = KeyFrames()
        self._lock = threading.Lock()

    def ask(self, reason: Reason) -> None:
        with self._lock:
            self._keys.ask(reason)

    def needs_key(self, now: float) -> bool:
        with self._lock:
            return self._keys.is_due(now)

    def made_key(self, now: float) -> None:
        with self._lock:
            self._keys.made(now)

    def restart(self) -> None:
        self.encoder.restart()
        self.last_stamp = None


class CameraFeed:
    """Reads, encodes and delivers pictures while there are viewers: once for all who watch the same rung of the ladder.

    Args:
        source: the camera.
        clock: gives pictures their RTP timestamps, the same on every rung.
        deliver: called in the camera's thread with every encoded picture.
        ladder: the qualities, the best first.
    """

    def __init__(self, source: VideoSource, clock: RtpClock, deliver: Callable[[Picture], None], ladder: Sequence[Tier] = LADDER) -> None:
        self._source = source
        self._clock = clock
        self._deliver = deliver
        self._rungs = [_Rung(PictureEncoder(tier, number)) for number, tier in enumerate(ladder)]
        self._frame: Frame | None = None
        self._frame_came = threading.Condition()
        self._capture = Capture("camera", source, self._begin, self._step)

    @property
    def rates(self) -> tuple[int, ...]:
        """Return the bit/s of the rungs, the best first."""
        return tuple(rung.encoder.tier.bitrate for rung in self._rungs)

    @property
    def state(self) -> CaptureState:
        """Return how the camera is."""
        return self._capture.state

    def start(self) -> None:
        """Start the camera's thread; the camera itself starts with the first viewer."""
        self._capture.start()

    def close(self) -> None:
        """Stop the camera and its thread."""
        self._capture.close()

    def watch(self, number: int, rung: int = 0) -> None:
        """Say that `number` more viewers watch a rung, fewer when negative."""
        self._rungs[rung].viewers += number
        self._capture.want(number)

    def ask_key_frame(self, reason: Reason, rung: int = 0) -> None:
        """Ask for a key frame."""
        self._rungs[rung].ask(reason)

    def snapshot(self) -> Frame | None:
        """Return the next frame of the camera, started for it if need be; None when none came in 3 s, 12 while it starts. Blocks meanwhile."""
        with self._frame_came:
            before = self._frame
            self._capture.want(1)
            began = time.monotonic()
            try:
                while not (came := self._frame_came.wait_for(lambda: self._frame is not before, timeout=SNAPSHOT_LOOK)):
                    if time.monotonic() - began > (SNAPSHOT_STARTING if self.state.status == "starting" else SNAPSHOT_TIMEOUT):
                        break
            finally:
                self._capture.want(-1)
            return self._frame if came else None

    def _begin(self) -> None:
        for rung in self._rungs:
            rung.restart()

    def _step(self, timeout: float) -> bool:
        frame = self._source.read(timeout)
        if frame is None:
            return False
        with self._frame_came:
            self._frame = frame
            self._frame_came.notify_all()
        if not math.isfinite(frame.stamp):
            raise ValueError(f"stamp {frame.stamp} is not a time")
        ticks = self._clock.tick(frame.stamp)
        now = time.monotonic()
        # Who waits for a key frame to change over is given it before the same picture of the old rung, which has the same time.
        for rung in sorted(self._rungs, key=lambda rung: not rung.needs_key(now)):
            if rung.viewers > 0:
                self._encode(rung, frame, ticks, now)
            elif rung.last_stamp is not None:
                rung.restart()
        return True

    def _encode(self, rung: _Rung, frame: Frame, ticks: int, now: float) -> None:
        if not is_due(frame.stamp, rung.last_stamp, rung.encoder.tier.fps):
            return
        rung.last_stamp = frame.stamp
        picture = rung.encoder.encode(frame, ticks, self._clock.timestamp(ticks), key=rung.needs_key(now))
        if picture is None:
            return
        if picture.key:
            rung.made_key(now)
        self._deliver(picture)
