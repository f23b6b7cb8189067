"""The media side of an agent: camera and microphone out, data channels both ways, in a thread and a
loop of its own.

The control loop must run when nothing else does, so nothing here shares its thread: it hands
signals and telemetry in, and hears frames and answers through callbacks that run on the media loop
and must return at once. Reading and encoding happen in capture threads, off this loop too, so that
a frame on a data channel never waits for a picture.
"""

import asyncio
import functools
import math
import random
import ssl
import threading
import time
from collections.abc import Callable

import structlog

from robots.agent.lab.timed import TimedLine
from robots.agent.loop_calls import MOST_FRAMES, LoopCalls
from robots.agent.media.capture.camera import CameraFeed
from robots.agent.media.capture.capture import CaptureState
from robots.agent.media.capture.outputs import OutputFeed
from robots.agent.media.capture.page_sources import PageCamera, PageMicrophone
from robots.agent.media.capture.sound import MicrophoneFeed
from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.jpeg_fallback.stills import JpegFallback
from robots.agent.media.peers.connections import Connections
from robots.agent.media.peers.viewer import Viewer
from robots.agent.media.peers.visitor import VisitorMedia
from robots.agent.media.rtp import Kind, RtpClock
from robots.agent.media.webrtc import aiortc_hooks
from robots.agent.media.webrtc.packet_gate import ReceivedPacket
from robots.agent.media.webrtc.relays import Relays
from robots.agent.media.webrtc.telemetry import for_page
from robots.agent.robot_interface import (
    FROM_PAGE,
    AudioSource,
    Frame,
    FromPage,
    Outputs,
    VideoSource,
)
from robots.api.codec import encode_frame
from robots.api.messages import (
    CameraStatus,
    Heartbeat,
    LabReport,
    Message,
    NetworkLab,
    PictureRequest,
    Pointer,
    Role,
    Signal,
    SignalReply,
)

log = structlog.stdlib.get_logger(__name__)

HOUSEKEEPING = 1.0  # s
CLOSE_TIMEOUT = 5.0  # s
REASON_LENGTH = 300  # characters: messages.Reason


class MediaSide:
    """Everything that travels over WebRTC, and its substitute. All methods may be called from any
    thread.

    Args:
        video: the driving camera, FROM_PAGE where the page of the robot's own screen gives the
            picture, or None.
        audio: the microphone, likewise.
        viewers: how many pages may be connected at once; the driver always finds room.
        on_command: called on the media loop with (peer, its role at this moment, command or why it
            could not be read) for every frame on a data channel that is not oversized and not one
            too many; what an observer sends comes too, for the control side to refuse and count.
        reply: called on the media loop with (peer, message) for the page.
        on_picture: called in a thread of its own, or on the media loop, with each picture for pages
            that WebRTC does not reach and the one peer that it is for, None for all who have asked;
            without it they get none.
        outputs: the robot's own loudspeaker and display.
        trust: whose certificates are believed of a relay, those that the system believes when None.
    """

    def __init__(
        self,
        *,
        video: VideoSource | FromPage | None,
        audio: AudioSource | FromPage | None,
        viewers: int,
        on_command: Callable[[str, Role, ReceivedPacket], None],
        reply: Callable[[str, SignalReply], None],
        on_picture: Callable[[bytes, str | None], None] | None = None,
        outputs: Outputs = (None, None),
        trust: ssl.SSLContext | None = None,
    ) -> None:
        aiortc_hooks.install()
        self._on_command = on_command
        self._pages = Connections(viewers, self._viewer_for, reply, self._lead)
        self._relays = Relays(trust=trust)
        clock = RtpClock(origin=random.randrange(1 << 32))
        self._camera: CameraFeed | PageCamera | None = None
        if video == FROM_PAGE:
            self._camera = PageCamera(
                lambda: self._calls.post(self._pages.ask_screens), self._pages.show
            )
        elif video is not None:
            self._camera = CameraFeed(video, clock, self._picture_from_camera)
        self._microphone: MicrophoneFeed | PageMicrophone | None = None
        if audio == FROM_PAGE:
            self._microphone = PageMicrophone(self._pages.sound)
        elif audio is not None:
            self._microphone = MicrophoneFeed(audio, self._sound_from_microphone)
        self._on_picture = on_picture
        self._line: TimedLine | None = None  # the lab's line for the driver's video and sound
        self._slow = (
            JpegFallback(self._camera.snapshot, self._send_slow, self._pages.drives)
            if self._camera and on_picture
            else None
        )
        self._outputs = OutputFeed(*outputs) if any(outputs) else None
        pages = self._pages
        self.visitor = VisitorMedia(
            drives=pages.drives,
            ask=pages.ask_driver,
            show=pages.show_at_robot,
            sound=pages.sound_at_robot,
            outputs=self._outputs,
        )
        self._thread = threading.Thread(target=self._run, name="media", daemon=True)
        self._calls = LoopCalls("media")
        self.ended = False
        self._ready = threading.Event()
        self._closing: asyncio.Event | None = None

    # --- for the control side, any thread ---------------------------------------------------------

    def start(self) -> None:
        """Start the media thread; returns when it takes signals."""
        self._thread.start()
        self._ready.wait()

    def close(self) -> None:
        """Say goodbye to every page and end the thread within seconds; idempotent."""
        self._calls.post(self._set_closing, most=math.inf)
        if self._slow is not None:
            self._slow.close()
        if self._thread.is_alive():
            self._thread.join(CLOSE_TIMEOUT)
            if self._thread.is_alive():
                log.error("media_thread_hung")

    def signal(self, peer: str, message: Signal) -> None:
        """Take an offer, candidate or bye of a page, or the server's word that it may stay."""
        self._calls.post(self._pages.take_signal, peer, message)

    def lease_changed(self, driver_peer: str | None) -> None:
        """Note which peer the lease names; None without a driver."""
        # At once and not through the loop: the next frame of the old driver must already come as an
        # observer's.
        self._pages.lease_changed(driver_peer)
        self._calls.post(self._lead, most=math.inf)

    def impair(self, lab: NetworkLab | None) -> None:
        """Put this on the driver's video and sound from now on, None for nothing."""
        self._calls.post(self._put_on, lab, most=math.inf)

    def let_through(self, *, audio: bool, video: bool, volume: float = 1.0) -> None:
        """Let the driver's voice and face through, or not; `volume` is a share of the robot's."""
        self.visitor.let_through(audio=audio, video=video, volume=volume)

    def telemetry(self, suffix: str, message: Message) -> None:
        """Send a message to every page that is connected; dropped for a page that is behind."""
        if self._pages.is_empty:
            return
        if isinstance(message, Heartbeat):
            self._calls.post(self._pages.send_heartbeat, suffix, message)
        else:
            self._calls.post(self._pages.send, suffix, encode_frame(suffix, for_page(message)))

    def point(self, pointer: Pointer) -> None:
        """Send a pointer to the other side alone; dropped for a page that is behind."""
        if not self._pages.is_empty:
            self._calls.post(self._pages.point, pointer.by, encode_frame("pointer", pointer))

    def picture_wanted(self, request: PictureRequest) -> None:
        """Send one more JPEG through the server; nothing happens without a camera."""
        if self._slow is not None:
            self._slow.ask(request.peer, request)

    def snapshot(self) -> Frame | None:
        """Return a fresh frame, None without a camera; blocks as `CameraFeed.snapshot`."""
        return self._camera.snapshot() if self._camera else None

    @property
    def connected(self) -> int:
        """Return how many people watch: over WebRTC, the JPEG fallback and an SFU."""
        return self._pages.viewers(self._slow.watching() if self._slow is not None else frozenset())

    @property
    def screens(self) -> int:
        return self._pages.screens

    @property
    def audible(self) -> bool:
        """Return whether a knock is audible: at a connected display, or a loudspeaker."""
        return self.screens > 0 or (self._outputs is not None and self._outputs.has_speaker)

    def ring(self) -> None:
        """Ring with the robot's own loudspeaker; where a display is connected, that does it."""
        if self._outputs is not None and self.screens == 0:
            self._outputs.ring()

    @property
    def camera(self) -> CaptureState | None:
        return self._camera.state if self._camera else None

    @property
    def camera_status(self) -> CameraStatus | None:
        """Return the camera's status for pages, None while it works or is not in use."""
        state = self.camera
        if state is None or state.status not in {"starting", "failed"}:
            return None
        return CameraStatus(
            status="failed" if state.status == "failed" else "starting",
            reason=state.reason[:REASON_LENGTH],
        )

    @property
    def errors(self) -> tuple[str, ...]:
        """Return why camera, microphone, loudspeaker and display do not work, a sentence each."""
        captured = tuple(
            state.reason
            for state in (self.camera, self.microphone)
            if state is not None and state.reason
        )
        return tuple(
            reason[:REASON_LENGTH]
            for reason in (*captured, *(self._outputs.errors if self._outputs is not None else ()))
        )

    @property
    def microphone(self) -> CaptureState | None:
        return self._microphone.state if self._microphone else None

    @property
    def network(self) -> LabReport | None:
        """Return the lab's report on the driver's video and sound, None without a lab."""
        line = self._line
        return line.report() if line is not None else None

    def statistics(self) -> dict[str, dict[str, int | None]]:
        return self._pages.statistics()

    # --- the thread -------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            asyncio.run(self._main())
        finally:
            self.ended, self._calls.loop = True, None
            self._ready.set()

    async def _main(self) -> None:
        self._calls.loop = asyncio.get_running_loop()
        self._closing = asyncio.Event()
        self._start_feeds()
        self._ready.set()
        while not self._closing.is_set():
            await self._housekeeping()
        await self._pages.close()
        for feed in (self._camera, self._microphone, self._outputs):
            if feed is not None:
                await asyncio.to_thread(feed.close)

    def _set_closing(self) -> None:
        assert self._closing is not None
        self._closing.set()

    def _start_feeds(self) -> None:
        for feed in (self._camera, self._microphone, self._outputs):
            if feed is not None:
                feed.start()

    async def _housekeeping(self) -> None:
        assert self._closing is not None
        try:
            await asyncio.wait_for(self._closing.wait(), HOUSEKEEPING)
        except TimeoutError:
            self._start_feeds()
            self._pages.end_lost(time.monotonic())

    # --- pages, on the media loop -----------------------------------------------------------------

    def _viewer_for(
        self, peer: str, role: Role, source: str, on_end: Callable[[str], None]
    ) -> Viewer:
        """Return a page's connection: displays get the visitor's media, others the robot's."""
        is_screen = role == "screen"
        return Viewer(
            peer,
            camera=self.visitor if is_screen else self._camera,
            microphone=self.visitor if is_screen else self._microphone,
            on_command=lambda heard: self._on_command(peer, self._pages.role(peer), heard),
            on_end=on_end,
            on_media=self._listener_to(peer, source, role),
            relays=self._relays,
        )

    def _listener_to(
        self, peer: str, source: str, role: Role
    ) -> Callable[[Kind, bytes, int], None] | None:
        if role == "driver":
            return functools.partial(self.visitor.take, peer, source)
        gives = isinstance(self._camera, PageCamera) or isinstance(self._microphone, PageMicrophone)
        return (
            functools.partial(self._take_from_page, source) if role == "screen" and gives else None
        )

    def _take_from_page(self, source: str, kind: Kind, data: bytes, ticks: int) -> None:
        if source != self._pages.newest_screen:
            return
        if kind == "video" and isinstance(self._camera, PageCamera):
            self._camera.take(source, data, ticks)
        elif kind == "audio" and isinstance(self._microphone, PageMicrophone):
            self._microphone.take(source, data, ticks)

    def _picture_from_camera(self, picture: Picture) -> None:
        self._calls.post(self._pages.show, picture, most=MOST_FRAMES)

    def _sound_from_microphone(self, payload: bytes, ticks: int) -> None:
        self._calls.post(self._pages.sound, payload, ticks, most=MOST_FRAMES)

    # --- the network lab, on the media loop -------------------------------------------------------

    def _put_on(self, lab: NetworkLab | None) -> None:
        if self._line is not None:
            self._line.close()
        self._line = TimedLine(lab) if lab is not None else None
        if self._slow is not None:
            self._slow.expect(lab.delay if lab is not None else 0.0)
        self._lead()

    def _lead(self) -> None:
        self._pages.lead(self._line)

    def _send_slow(self, payload: bytes, peers: frozenset[str]) -> None:
        assert self._on_picture is not None
        if self._line is None:
            self._on_picture(payload, None)
            return
        # Each gets a copy of their own, so that only the driver's is lost or late.
        for peer in sorted(peers):
            if self._pages.drives(peer):
                self._calls.post(self._send_slow_to_driver, payload, peer, most=MOST_FRAMES)
            else:
                self._on_picture(payload, peer)

    def _send_slow_to_driver(self, payload: bytes, peer: str) -> None:
        assert self._on_picture is not None
        if self._line is None:
            self._on_picture(payload, peer)
        else:
            self._line.offer(len(payload), functools.partial(self._on_picture, payload, peer))
