"""One page's WebRTC connection: its answer, its candidates and its data channel, by aiortc.

There is one `PageConnection` an offer and it is never renegotiated: recovery is a new offer and a
new connection. All of it runs on the media loop.
"""

import asyncio
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import structlog
from aiortc import (
    RTCBundlePolicy,
    RTCConfiguration,
    RTCDataChannel,
    RTCPeerConnection,
    RTCRtpReceiver,
    RTCRtpTransceiver,
    RTCSessionDescription,
)
from aiortc.exceptions import InternalError, InvalidAccessError, InvalidStateError, OperationError

from robots.agent.media.rtp import Kind
from robots.agent.media.webrtc import aiortc_hooks, sdp
from robots.agent.media.webrtc.frame_queue import FrameQueue, SoundQueue
from robots.agent.media.webrtc.packet_gate import PacketGate, ReceivedPacket
from robots.agent.media.webrtc.relays import Relays
from robots.api.messages import Candidate, SdpOffer
from robots.process.cancellation import cancel
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

# bytes; telemetry that a page cannot take at once is dropped, the next is newer
MAX_BUFFERED = 64 * 1024
MAX_CHANNELS = 4
MAX_CANDIDATES = 64
CONNECT_TIMEOUT = 15.0  # s from the offer
# s; aiortc waits 5 s for a silent server, which is as long as a page waits for an answer
LONG_GATHERING = 2.0
# s without a report or a frame from a page whose reports had come; ICE itself notices after 30 s
SILENCE = 10.0
_CODECS = {"video": "video/VP8", "audio": "audio/opus"}

# what aiortc raises about an offer that it cannot use
UNUSABLE = (
    *(*sdp.UNREADABLE, RuntimeError, OSError),
    *(InternalError, InvalidAccessError, InvalidStateError, OperationError),
)


@dataclass
class PageConnection:
    """The connection of one page.

    Args:
        peer: the peer id that the server made.
        on_command: called with every message of the page that passed the gate.
        on_open: called when the page has opened a data channel.
        on_end: called with the reason when the connection failed, was closed by the page, or the
            page floods.
        on_media: called with (kind, encoded data, RTP ticks from 0) for the visitor's voice and
            face; None drops them unread.
        relays: shared by all connections of a robot. Without any, none is used; aiortc's default
            would be a public server.
    """

    peer: str
    pictures: FrameQueue | None
    sounds: SoundQueue | None
    on_command: Callable[[ReceivedPacket], None]
    on_open: Callable[[], None]
    on_end: Callable[[str], None]
    on_media: Callable[[Kind, bytes, int], None] | None = None
    relays: Relays = field(default_factory=Relays)
    gate: PacketGate = field(default_factory=PacketGate)
    channels: list[RTCDataChannel] = field(default_factory=list)
    dropped_telemetry: int = 0
    _connection: RTCPeerConnection | None = None
    _face: RTCRtpReceiver | None = None
    _candidates: int = 0
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)
    _began: float = field(default_factory=time.monotonic)
    _last_frame: float = 0.0
    # held while an offer is answered: aiortc opens sockets until then, which a close() that came
    # before would leave open
    _opening: asyncio.Lock = field(default_factory=asyncio.Lock)
    _closed: bool = False
    _sent_away: bool = False

    @property
    def is_connected(self) -> bool:
        return self._connection is not None and self._connection.connectionState == "connected"

    def is_lost(self, now: float) -> bool:
        """Tell whether this never connected, or its page is silent; `now` is monotonic."""
        if not self.is_connected:
            return now - self._began > CONNECT_TIMEOUT
        reports = max(
            (frames.last_report for frames in (self.pictures, self.sounds) if frames is not None),
            default=0.0,
        )
        return reports > 0.0 and now - max(reports, self._last_frame) > SILENCE

    async def answer(self, offer: SdpOffer) -> str:
        """Answer an offer with all candidates; BadOfferError when unusable, or closed by then."""
        async with self._opening:
            return await self._answer(offer)

    async def _answer(self, offer: SdpOffer) -> str:
        plain, candidates = sdp.without_candidates(offer.sdp)
        lines = sdp.media_lines(plain)
        servers = await self.relays.usable(offer.ice_servers)
        if self._closed:
            raise sdp.BadOfferError("the page has left, or has made another offer")
        # By default aiortc gives the lines of each kind a transport of their own before the offer
        # joins them all, and leaks the second one.
        self._connection = connection = RTCPeerConnection(
            RTCConfiguration(iceServers=servers, bundlePolicy=RTCBundlePolicy.MAX_BUNDLE)
        )
        connection.on("connectionstatechange", self._on_state)
        connection.on("datachannel", self._on_channel)
        visitor = self._add_lines(connection, lines)
        try:
            await connection.setRemoteDescription(RTCSessionDescription(plain, "offer"))
            aiortc_hooks.number_own_packets(connection)
            await self._gather(connection)
        except UNUSABLE as error:
            raise sdp.BadOfferError(f"{type(error).__name__}: {error}") from error
        for index, transceiver in enumerate(connection.getTransceivers()):
            if index not in visitor:
                aiortc_hooks.discard(transceiver.receiver)
        for index, text in candidates:
            self._add_candidate(text, None, index)
        return str(connection.localDescription.sdp)

    async def _gather(self, connection: RTCPeerConnection) -> None:
        """Gather our own addresses; a server that has become silent delays that only once."""
        if self.relays.trust is not None:
            aiortc_hooks.set_turn_tls_context(connection, self.relays.trust)
        began = time.monotonic()
        await connection.setLocalDescription(await connection.createAnswer())
        if time.monotonic() - began > LONG_GATHERING:
            self.relays.doubt()

    def add_candidate(self, candidate: Candidate) -> None:
        """Add a trickled candidate.

        The end of candidates is not passed on: a page without any (no camera permission, no mDNS)
        still reaches the robot, and aioice would have given up by then. CONNECT_TIMEOUT ends a
        hopeless connection.
        """
        self._add_candidate(candidate.candidate, candidate.sdp_mid, candidate.sdp_m_line_index)

    def send(self, frame: str) -> None:
        """Send a frame on the data channel; drop it when that is closed or behind."""
        channel = next((channel for channel in self.channels if channel.readyState == "open"), None)
        if channel is None:
            return
        if channel.bufferedAmount > MAX_BUFFERED:
            self.dropped_telemetry += 1
            return
        channel.send(frame)

    async def close(self) -> None:
        """Close the connection, after an offer that is being answered; idempotent."""
        if self._closed:
            return
        self._closed = True
        await cancel(*self._tasks)
        async with self._opening:
            if self._connection is not None:
                try:
                    await self._connection.close()
                except UNUSABLE as error:
                    log.warning("connection_close_failed", peer=self.peer, reason=reason_of(error))
                    await aiortc_hooks.close_sockets(self._connection)

    async def ask_key_frame(self) -> None:
        if self._face is not None and self.is_connected:
            await aiortc_hooks.ask_key_frame(self._face)

    def _add_lines(
        self, connection: RTCPeerConnection, lines: tuple[sdp.MediaLine, ...]
    ) -> frozenset[int]:
        """Add a transceiver for each line, in order; return the lines of the visitor."""
        queues: dict[Kind, FrameQueue | SoundQueue | None] = {
            "video": self.pictures,
            "audio": self.sounds,
        }
        has = frozenset(kind for kind, frames in queues.items() if frames is not None)
        carries = sdp.robot_lines(lines, has)
        for index, line in enumerate(lines):
            frames = queues[line.kind] if index in carries else None
            if frames is not None:
                aiortc_hooks.add_sender(
                    connection,
                    line.kind,
                    frames,
                    _CODECS[line.kind],
                    listens=self.on_media is not None,
                    on_failure=functools.partial(self.on_end, "failed"),
                )
            else:
                # the direction tells a page that could send whether it should
                connection.addTransceiver(
                    line.kind, direction="recvonly" if self.on_media is not None else "inactive"
                )
        if self.on_media is None:
            return frozenset()
        visitor = sdp.visitor_lines(lines, carries)
        for index, kind in visitor.items():
            self._listen_to(connection.getTransceivers()[index], kind)
        return frozenset(visitor)

    def _listen_to(self, transceiver: RTCRtpTransceiver, kind: Kind) -> None:
        assert self.on_media is not None
        aiortc_hooks.on_encoded_frame(transceiver.receiver, functools.partial(self.on_media, kind))
        if kind == "video":
            aiortc_hooks.restrict_codec(transceiver, _CODECS[kind])
            self._face = transceiver.receiver

    def _add_candidate(self, text: str, mid: str | None, index: int | None) -> None:
        candidate = sdp.parsed_candidate(text, mid, index)
        if (
            candidate is None
            or self._closed
            or self._connection is None
            or self._candidates >= MAX_CANDIDATES
        ):
            return
        self._candidates += 1
        task = asyncio.ensure_future(self._connection.addIceCandidate(candidate))
        self._tasks.add(task)
        task.add_done_callback(self._candidate_added)

    def _candidate_added(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.info("candidate_unusable", peer=self.peer, reason=reason_of(error))

    def _on_state(self) -> None:
        assert self._connection is not None
        state = self._connection.connectionState
        log.info("peer_connection", peer=self.peer, state=state)
        if state in ("failed", "closed") and not self._closed:
            self.on_end("failed")

    def _on_channel(self, channel: RTCDataChannel) -> None:
        if len(self.channels) >= MAX_CHANNELS:
            channel.close()
            return
        self.channels.append(channel)
        if len(self.channels) == 1:  # they share one transport
            aiortc_hooks.limit_forward_tsn(channel.transport)
            aiortc_hooks.limit_sacks(channel.transport)
        channel.on("message", self._on_message)
        self.on_open()

    def _on_message(self, frame: str | bytes) -> None:
        self._last_frame = time.monotonic()
        packet = self.gate.take(frame, self._last_frame)
        if packet is not None:
            self.on_command(packet)
        elif self.gate.floods and not self._sent_away:
            self._sent_away = True
            log.warning("page_floods", peer=self.peer, counts=dict(self.gate.counts))
            self.on_end("flooded")
