"""The media side of an agent: camera and microphone out, data channels both ways, in a thread and a
loop of its own.

The control loop must never wait, so nothing here shares its thread: it posts signals and telemetry,
and gets frames and answers through callbacks that run on the media loop and must return at once.
Reading and encoding happen in capture threads, so that a message on a data channel never waits for
a picture.
"""

import asyncio
import math
import random
import ssl
import threading
import time
from collections.abc import Callable
from functools import partial

import msgspec
import structlog

from robots.agent.lab.timed import TimedLine
from robots.agent.loop_calls import MOST_FRAMES, LoopCalls
from robots.agent.media.capture.camera import CameraFeed
from robots.agent.media.capture.capture import CaptureState
from robots.agent.media.capture.outputs import OutputFeed
from robots.agent.media.capture.page_sources import PageCamera, PageMicrophone
from robots.agent.media.capture.sound import MicrophoneFeed
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
    CallState,
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
    """All media over WebRTC, and the JPEG fallback. All methods may be called from any thread.

    Args:
        video: the driving camera, FROM_PAGE where the page of the robot's own screen sends the
            video, or None.
        audio: the microphone, likewise.
        viewers: how many pages may be connected at once; the driver always finds room.
        on_command: called on the media loop with (peer, its role at this moment, command or why it
            could not be read) for every frame on a data channel that is within the limits of size
            and rate, also of observers: the control side refuses and counts them.
        reply: called on the media loop with (peer, message) for the page.
        on_picture: called in a thread of its own, or on the media loop, with each JPEG for pages
            that WebRTC does not reach, and with its peer, None for all that have asked. Without it
            there is no fallback.
        outputs: the robot's own loudspeaker and display.
        trust: the certificates for TLS relays, the system's when None.
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
        self._on_command, self._on_picture = on_command, on_picture
        self._calls = LoopCalls("media")
        self._pages = pages = Connections(viewers, self._viewer_for, reply, self._route)
        self._relays = Relays(trust=trust)
        self._camera: CameraFeed | PageCamera | None = None
        if video == FROM_PAGE:
            ask = partial(self._calls.post, pages.ask_key_frame, "screen")
            self._camera = PageCamera(ask, pages.show)
        elif video is not None:
            clock = RtpClock(origin=random.randrange(1 << 32))
            show = partial(self._calls.post, pages.show, most=MOST_FRAMES)
            self._camera = CameraFeed(video, clock, show)
        self._microphone: MicrophoneFeed | PageMicrophone | None = None
        if audio == FROM_PAGE:
            self._microphone = PageMicrophone(pages.sound)
        elif audio is not None:
            sound = partial(self._calls.post, pages.sound, most=MOST_FRAMES)
            self._microphone = MicrophoneFeed(audio, sound)
        self._line: TimedLine | None = None  # the lab's line for the driver's video and sound
        self._fallback = (
            JpegFallback(self._camera.snapshot, self._send_jpeg, pages.drives)
            if self._camera and on_picture
            else None
        )
        self._outputs = OutputFeed(*outputs) if any(outputs) else None
        feeds = (self._camera, self._microphone, self._outputs)
        self._feeds = [feed for feed in feeds if feed is not None]
        self.visitor = VisitorMedia(
            drives=pages.drives,
            ask=partial(pages.ask_key_frame, "driver"),
            show=pages.show_at_robot,
            sound=pages.sound_at_robot,
            outputs=self._outputs,
        )
        self._thread = threading.Thread(target=self._run, name="media", daemon=True)
        self.ended = False
        self._ready = threading.Event()
        self._closing = asyncio.Event()

    # --- for the control side, any thread ---------------------------------------------------------

    def start(self) -> None:
        """Start the media thread; returns when it takes signals."""
        self._thread.start()
        self._ready.wait()

    def close(self) -> None:
        """End all connections and the thread within seconds; idempotent."""
        self._calls.post(self._closing.set, most=math.inf)
        if self._fallback is not None:
            self._fallback.close()
        if self._thread.is_alive():
            self._thread.join(CLOSE_TIMEOUT)
            if self._thread.is_alive():
                log.error("media_thread_hung")

    def signal(self, peer: str, message: Signal) -> None:
        """Take an offer, candidate or bye of a page, or the server's word that it may stay."""
        self._calls.post(self._pages.take_signal, peer, message)

    def lease_changed(self, driver_peer: str | None) -> None:
        """Note which peer the lease names; None without a driver."""
        # At once and not through the loop: the next message of the old driver must already count as
        # an observer's.
        self._pages.lease_changed(driver_peer)
        self._calls.post(self._route, most=math.inf)

    def impair(self, lab: NetworkLab | None) -> None:
        """Impair the driver's video and sound from now on; None ends it."""
        self._calls.post(self._set_lab, lab, most=math.inf)

    def let_through(self, *, audio: bool, video: bool, volume: float = 1.0) -> None:
        """Forward the driver's voice and face, or not; `volume` is a share of the robot's."""
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
        """Send a pointer to the other side only; dropped for a page that is behind."""
        if not self._pages.is_empty:
            self._calls.post(self._pages.point, pointer.by, encode_frame("pointer", pointer))

    def picture_wanted(self, request: PictureRequest) -> None:
        """Send one more JPEG through the server, if there is a camera."""
        if self._fallback is not None:
            self._fallback.ask(request.peer, request)

    def snapshot(self) -> Frame | None:
        """Return a fresh frame, None without a camera; blocks as `CameraFeed.snapshot`."""
        return self._camera.snapshot() if self._camera else None

    @property
    def connected(self) -> int:
        """Return how many people watch: over WebRTC, the JPEG fallback and an SFU."""
        return self._pages.viewers(self._fallback.watching() if self._fallback else frozenset())

    @property
    def screens(self) -> int:
        return self._pages.screens

    def confirm(self, call: CallState | None) -> CallState | None:
        """Return the call with what the people at the robot get of it now."""
        if call is None:
            return None
        own, through = self._outputs if self.screens == 0 else None, call.status == "accepted"
        shown = self._pages.shows or (own is not None and own.works("video"))
        played = self._pages.plays or (own is not None and own.works("audio"))
        return msgspec.structs.replace(
            call,
            shown=through and call.video and shown,
            audible=through and call.audio and played,
        )

    @property
    def audible(self) -> bool:
        """Return whether a knock is audible: at a connected display, or a loudspeaker."""
        return self.screens > 0 or (self._outputs is not None and self._outputs.has_speaker)

    def ring(self) -> None:
        """Ring with the robot's own loudspeaker, unless a display is connected, which rings."""
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
        states = (self.camera, self.microphone)
        reasons = [state.reason for state in states if state is not None and state.reason]
        played = self._outputs.errors if self._outputs is not None else ()
        return tuple(reason[:REASON_LENGTH] for reason in (*reasons, *played))

    @property
    def microphone(self) -> CaptureState | None:
        return self._microphone.state if self._microphone else None

    @property
    def network(self) -> LabReport | None:
        """Return the lab's report on the driver's video and sound, None without a lab."""
        line = self._line  # another thread may replace it
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
        self._start_feeds()
        self._ready.set()
        while not self._closing.is_set():
            try:
                await asyncio.wait_for(self._closing.wait(), HOUSEKEEPING)
            except TimeoutError:
                self._start_feeds()
                self._pages.end_lost(time.monotonic())
        await self._pages.close()
        for feed in self._feeds:
            await asyncio.to_thread(feed.close)

    def _start_feeds(self) -> None:
        for feed in self._feeds:
            feed.start()

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
            on_command=lambda packet: self._on_command(peer, self._pages.role(peer), packet),
            on_end=on_end,
            on_media=self._media_taker(peer, source, role),
            relays=self._relays,
        )

    def _media_taker(
        self, peer: str, source: str, role: Role
    ) -> Callable[[Kind, bytes, int], None] | None:
        """Return what takes the media that a page sends, None when they are not wanted."""
        if role == "driver":
            return partial(self.visitor.take, peer, source)
        from_page = isinstance(self._camera, PageCamera) or isinstance(
            self._microphone, PageMicrophone
        )
        return partial(self._take_from_page, source) if role == "screen" and from_page else None

    def _take_from_page(self, source: str, kind: Kind, data: bytes, ticks: int) -> None:
        if source != self._pages.newest_screen:
            return
        if kind == "video" and isinstance(self._camera, PageCamera):
            self._camera.take(source, data, ticks)
        elif kind == "audio" and isinstance(self._microphone, PageMicrophone):
            self._microphone.take(source, data, ticks)

    # --- the network lab, on the media loop -------------------------------------------------------

    def _set_lab(self, lab: NetworkLab | None) -> None:
        if self._line is not None:
            self._line.close()
        self._line = TimedLine(lab) if lab is not None else None
        if self._fallback is not None:
            self._fallback.expect(lab.delay if lab is not None else 0.0)
        self._route()

    def _route(self) -> None:
        self._pages.route(self._line)

    def _send_jpeg(self, payload: bytes, peers: frozenset[str]) -> None:
        assert self._on_picture is not None
        if self._line is None:
            self._on_picture(payload, None)
            return
        # one copy for each, so that only the driver's is lost or late
        for peer in sorted(peers):
            if self._pages.drives(peer):
                self._calls.post(self._send_jpeg_to_driver, payload, peer, most=MOST_FRAMES)
            else:
                self._on_picture(payload, peer)

    def _send_jpeg_to_driver(self, payload: bytes, peer: str) -> None:
        assert self._on_picture is not None
        if self._line is None:
            self._on_picture(payload, peer)
        else:
            self._line.offer(len(payload), partial(self._on_picture, payload, peer))
