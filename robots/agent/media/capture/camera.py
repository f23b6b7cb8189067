"""The robot's camera: encoded pictures for viewers, and single frames for photos."""

import math
import threading
import time
from collections.abc import Callable, Sequence

from robots.agent.media.capture.capture import Capture
from robots.agent.media.codecs.encoder import LAYERS, Picture, PictureEncoder, Tier, is_due
from robots.agent.media.codecs.key_frames import KeyFrames, Reason
from robots.agent.media.rtp import RtpClock
from robots.agent.robot_interface import Frame, VideoSource

SNAPSHOT_TIMEOUT = 3.0  # s
SNAPSHOT_STARTING = (
    12.0  # s, of a camera that is starting; sessions/leases/readiness.py waits longer
)
SNAPSHOT_POLL = 0.25  # s between two checks whether it is still starting


class _Layer:
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


class CameraFeed(Capture):
    """Reads and encodes frames while there are viewers, once for all of a layer, the best first.

    `clock` makes the frames' RTP timestamps, the same in every layer; `deliver` is called in the
    camera's thread with every encoded frame.
    """

    def __init__(
        self,
        source: VideoSource,
        clock: RtpClock,
        deliver: Callable[[Picture], None],
        layers: Sequence[Tier] = LAYERS,
    ) -> None:
        super().__init__("camera", source, self._restart, self._read_frame)
        self._camera = source
        self._clock = clock
        self._deliver = deliver
        self._layers = [_Layer(PictureEncoder(tier, number)) for number, tier in enumerate(layers)]
        self._frame: Frame | None = None
        self._frame_arrived = threading.Condition()

    @property
    def rates(self) -> tuple[int, ...]:
        """Return the bit/s of the layers, the best first."""
        return tuple(layer.encoder.tier.bitrate for layer in self._layers)

    def watch(self, number: int, layer: int = 0) -> None:
        self._layers[layer].viewers += number
        self.want(number)

    def ask_key_frame(self, reason: Reason, layer: int = 0) -> None:
        self._layers[layer].ask(reason)

    def snapshot(self) -> Frame | None:
        """Return the next frame; None after 3 s, or 12 s for a camera that starts. Blocks."""
        with self._frame_arrived:
            before = self._frame
            self.want(1)
            began = time.monotonic()
            try:
                while self._frame is before:
                    starting = self.state.status == "starting"
                    limit = SNAPSHOT_STARTING if starting else SNAPSHOT_TIMEOUT
                    if time.monotonic() - began > limit:
                        return None
                    self._frame_arrived.wait(SNAPSHOT_POLL)
                return self._frame
            finally:
                self.want(-1)

    def _restart(self) -> None:
        for layer in self._layers:
            layer.restart()

    def _read_frame(self, timeout: float) -> bool:
        frame = self._camera.read(timeout)
        if frame is None:
            return False
        with self._frame_arrived:
            self._frame = frame
            self._frame_arrived.notify_all()
        if not math.isfinite(frame.stamp):
            raise ValueError(f"stamp {frame.stamp} is not a time")
        ticks = self._clock.tick(frame.stamp)
        now = time.monotonic()
        # a viewer that waits for a key frame to change layers must get it before the same frame of
        # the old layer, which has the same timestamp
        for layer in sorted(self._layers, key=lambda layer: not layer.needs_key(now)):
            if layer.viewers > 0:
                self._encode(layer, frame, ticks, now)
            elif layer.last_stamp is not None:
                layer.restart()
        return True

    def _encode(self, layer: _Layer, frame: Frame, ticks: int, now: float) -> None:
        if not is_due(frame.stamp, layer.last_stamp, layer.encoder.tier.fps):
            return
        layer.last_stamp = frame.stamp
        timestamp = self._clock.timestamp(ticks)
        picture = layer.encoder.encode(frame, ticks, timestamp, key=layer.needs_key(now))
        if picture is not None:
            if picture.key:
                layer.made_key(now)
            self._deliver(picture)
