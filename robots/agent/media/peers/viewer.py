"""One connected page: its video, sound and telemetry, and its commands."""

import math
import random
import time
from collections.abc import Callable
from typing import Protocol

import structlog

from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.codecs.key_frames import Reason
from robots.agent.media.peers.bitrate import BitrateAdapter
from robots.agent.media.rtp import Kind, MediaClockSender
from robots.agent.media.webrtc.aiortc_hooks import Detour
from robots.agent.media.webrtc.feedback import ArrivalReport
from robots.agent.media.webrtc.frame_queue import FrameQueue, SoundQueue
from robots.agent.media.webrtc.packet_gate import ReceivedPacket
from robots.agent.media.webrtc.relays import Relays
from robots.agent.media.webrtc.signalling import PageConnection
from robots.agent.timing import Cadence
from robots.api.codec import encode_frame
from robots.api.messages import CommandHeartbeat, SdpOffer

# Below the best layer, for at most so many bit/s: s between two messages, which at their
# own pace need as much as the video.
SPARSE = (
    (90_000, {"scan": 1.9, "pose": 0.38, "state": 0.45}),
    (380_000, {"scan": 0.95, "pose": 0.19}),
)
NARROW_SOUND = 110_000  # bit/s, likewise

log = structlog.stdlib.get_logger(__name__)


class WatchedVideo(Protocol):
    """The source of a viewer's video: the camera, or for the robot's screen the visitor."""

    @property
    def rates(self) -> tuple[int, ...]:
        """Return the bit/s of the layers, the best first."""

    def watch(self, number: int, layer: int = 0) -> None:
        """Count `number` more (or fewer) viewers of a layer."""

    def ask_key_frame(self, reason: Reason, layer: int = 0) -> None:
        """Ask for a key frame of a layer."""


class Sounds(Protocol):
    """The sound of a viewer: the microphone's, or the visitor's."""

    def listen(self, number: int, *, narrow: bool = False) -> None:
        """Count `number` more (or fewer) listeners, on a narrow network or not."""


class Viewer:
    """A page's connection together with its share of camera and microphone. Belongs to the media
    loop.

    Args:
        peer: the peer id that the server made.
        camera: started at the offer, so that the first frame is ready when the page connects.
        on_command: called with every message of the page that passed the gate.
        on_end: called with the reason when the connection failed, was closed by the page, or the
            page floods.
        on_media, relays: see `PageConnection`.

    `page` is the connection itself.
    """

    def __init__(
        self,
        peer: str,
        *,
        camera: WatchedVideo | None,
        microphone: Sounds | None,
        on_command: Callable[[ReceivedPacket], None],
        on_end: Callable[[str], None],
        on_media: Callable[[Kind, bytes, int], None] | None = None,
        relays: Relays | None = None,
    ) -> None:
        self.peer = peer
        self._camera = camera
        self._microphone = microphone
        self._on_command = on_command
        self._clock = MediaClockSender()
        self._pictures = None
        rates: tuple[int, ...] = (0,)
        if camera is not None:
            self._pictures = FrameQueue(self._ask_camera, self._send_clock, self._delivered)
            rates = camera.rates
        self._adapter = BitrateAdapter(rates, time.monotonic())
        self._layer = 0  # that is shown
        self._next_layer = 0  # that is shown from its next key frame on
        self._sparse: dict[str, Cadence] = {}
        self._narrow_sound = False
        self._sounds = SoundQueue(random.randrange(1 << 32)) if microphone is not None else None
        self.page = PageConnection(
            peer,
            self._pictures,
            self._sounds,
            self._take,
            self._clock.forget,
            on_end,
            on_media,
            relays or Relays(),
        )
        self._shown = -1  # the RTP timestamp of the newest picture
        self._skipped = False  # frames were left out: the next one must be a key frame
        self._key_frame_requested = False  # for that
        self._watching = False
        self.takes_candidates = False
        self.shows = self.plays = False  # a display shows the visitor, and may play sound

    async def answer(self, offer: SdpOffer) -> str:
        """Answer the offer; return the SDP. Raises BadOfferError."""
        self._watch(watching=True)
        sdp = await self.page.answer(offer)
        self.takes_candidates = True
        return sdp

    def resume(self, layer: int) -> None:
        """Begin with the layer of the page's last connection; call before `answer`."""
        if self._camera is not None and 0 < layer < len(self._camera.rates):
            self._adapter.layer = self._layer = self._next_layer = layer
            self._leave_room_for(self._camera.rates[layer])

    def route(self, detour: Detour | None) -> None:
        """Send video and sound through a detour from now on, or directly."""
        for frames in (self._pictures, self._sounds):
            if frames is not None:
                frames.detour = detour

    def show(self, picture: Picture) -> None:
        """Queue a picture of the layer that this viewer's network takes; ignore other layers."""
        if self._pictures is None:
            return
        if self._adapter.pauses(time.monotonic()):
            self._skipped, self._key_frame_requested = True, False
            return
        if self._skipped and not self._resumes_with(picture):
            return
        if picture.layer == self._next_layer != self._layer and picture.key:
            self._take_over(picture)
        if picture.layer == self._layer:
            self._shown = picture.rtp
            self._pictures.more = self._adapter.look(time.monotonic())
            self._pictures.put(picture)
            self._move()

    def sound(self, payload: bytes, ticks: int, narrow: bool | None = None) -> None:
        """Queue sound for narrow networks, for others, or for all (None)."""
        if self._sounds is not None and narrow in (None, self._narrow_sound):
            self._sounds.put(payload, ticks)

    def send(self, suffix: str, frame: str) -> None:
        """Send a frame on the data channel or drop it; a narrow network gets fewer."""
        cadence = self._sparse.get(suffix)
        if cadence is None or cadence.due(time.monotonic()):
            self.page.send(frame)

    @property
    def layer(self) -> int:
        return self._adapter.layer

    def statistics(self) -> dict[str, int | None]:
        """Return counts of frames, restarts, refused and dropped messages, and the layer."""
        pictures = self._pictures
        return {
            "pictures": pictures.sent if pictures else 0,
            "restarts": pictures.queue.restarts if pictures else 0,
            "layer": self._layer,
            "oversized": self.page.gate.counts["oversized"],
            "too_fast": self.page.gate.counts["too_fast"],
            "telemetry_dropped": self.page.dropped_telemetry,
        }

    async def close(self) -> None:
        """Close the connection and release camera and microphone; idempotent."""
        self._watch(watching=False)
        await self.page.close()

    def _watch(self, *, watching: bool) -> None:
        if watching == self._watching:
            return
        self._watching = watching
        number = 1 if watching else -1
        if self._camera is not None:
            for layer in {self._layer, self._next_layer}:
                self._camera.watch(number, layer)
        if self._microphone is not None:
            self._microphone.listen(number, narrow=self._narrow_sound)

    # --- layers of quality ------------------------------------------------------------------------

    def _ask_camera(self, reason: Reason) -> None:
        if self._camera is not None:
            self._camera.ask_key_frame(reason, self._layer)

    def _take(self, packet: ReceivedPacket) -> None:
        if isinstance(packet, CommandHeartbeat):
            self.shows, self.plays = packet.shows, packet.plays
        self._on_command(packet)

    def _delivered(self, delivery: ArrivalReport) -> None:
        assert self._pictures is not None
        self._adapter.delivered(time.monotonic(), delivery, self._pictures.rate)
        self._move()

    def _move(self) -> None:
        """Ask for the adapter's layer; the current one is shown until its first key frame."""
        wanted = self._adapter.layer
        if self._camera is None or not self._watching or wanted == self._next_layer:
            return
        if self._next_layer != self._layer:
            self._camera.watch(-1, self._next_layer)
        self._next_layer = wanted
        self._leave_room_for(self._camera.rates[wanted] if wanted else math.inf)
        if wanted != self._layer:
            self._camera.ask_key_frame("joined", wanted)
            self._camera.watch(1, wanted)

    def _resumes_with(self, picture: Picture) -> bool:
        """Tell whether frames can resume after a gap; if not, ask for a key frame, once."""
        self._skipped = not (picture.key and picture.layer == self._next_layer)
        if self._skipped and not self._key_frame_requested and self._camera is not None:
            self._key_frame_requested = True
            self._camera.ask_key_frame("joined", self._next_layer)
        return not self._skipped

    def _take_over(self, picture: Picture) -> None:
        assert self._camera is not None
        # a page takes two pictures with one timestamp for a single, broken one
        if picture.rtp == self._shown:
            self._camera.ask_key_frame("joined", self._next_layer)
            return
        if self._watching:
            self._camera.watch(-1, self._layer)
        self._layer = self._next_layer
        log.info("picture_quality", peer=self.peer, layer=self._layer)

    def _leave_room_for(self, rate: float) -> None:
        """Send less beside a video of `rate` bit/s."""
        periods = next((periods for limit, periods in SPARSE if rate <= limit), {})
        self._sparse = {suffix: Cadence(period) for suffix, period in periods.items()}
        before, self._narrow_sound = self._narrow_sound, rate <= NARROW_SOUND
        if self._microphone is not None and self._watching:
            self._microphone.listen(1, narrow=self._narrow_sound)
            self._microphone.listen(-1, narrow=before)

    def _send_clock(self, picture: Picture) -> None:
        clock = self._clock.before(picture.rtp, picture.stamp, time.monotonic())
        if clock is not None:
            self.page.send(encode_frame("media", clock))
