"""What aiortc 1.16 does not offer: shared packets, playout-delay, transport-wide feedback, requests
for key frames, an RTP clock, fewer FORWARD TSN, and a robot without network.

`PacketSender` replaces aiortc's RTCRtpSender. The original asks a track for frames, encodes them
for its one viewer and draws a random RTP origin that cannot be read; ours gets payloads that were
encoded once for all viewers, with their RTP timestamps. DTLS, SRTP, ICE, RTCP reports and SDP stay
aiortc's. The project pins 1.16.x, `check()` refuses anything that lacks a name used here, and a
test runs all of it against a real connection.
"""

import asyncio
import functools
import queue
import random
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import aioice.ice
import aioice.turn
import aiortc
import aiortc.codecs
import structlog
from aiortc import (
    RTCDtlsTransport,
    RTCIceGatherer,
    RTCIceTransport,
    RTCPeerConnection,
    RTCRtpReceiver,
    RTCRtpSender,
    RTCRtpTransceiver,
    RTCSctpTransport,
)
from aiortc.rtcrtpparameters import (
    RTCRtcpFeedback,
    RTCRtpCodecCapability,
    RTCRtpCodecParameters,
    RTCRtpHeaderExtensionParameters,
    RTCRtpSendParameters,
)
from aiortc.rtp import AnyRtcpPacket

from robots.agent.media.rtp import (
    LARGEST_ID,
    ExtensionIds,
    RtpStream,
    extension_block,
    ntp_time,
)
from robots.agent.media.webrtc.feedback import NUMBERS, ArrivalReport, SentPackets
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

PLAYOUT_DELAY = "http://www.webrtc.org/experiments/rtp-hdrext/playout-delay"
ABS_SEND_TIME = "http://www.webrtc.org/experiments/rtp-hdrext/abs-send-time"
TRANSPORT_NUMBER = "http://www.ietf.org/id/draft-holmer-rmcat-transport-wide-cc-extensions-01"
MID = "urn:ietf:params:rtp-hdrext:sdes:mid"
# aiortc itself takes 1 to 3 in the offers it makes
_FREE_EXTENSION_IDS = {PLAYOUT_DELAY: 4, TRANSPORT_NUMBER: 5}
_TRANSPORT_CC = RTCRtcpFeedback(type="transport-cc")
LOOPBACK = "127.0.0.1"
_NOTE_EVERY = 0.25  # s; a sender report is sent about once a second
SACK_PERIOD = 0.1  # s
FORWARD_TSN_PERIOD = 0.25  # s; unordered messages are delivered at once, so nothing waits for it

# Every private name of aiortc and aioice that this folder uses, by its class: `check` looks for
# each, and a test searches the folder for others.
PRIVATE_NAMES: dict[Any, tuple[str, ...]] = {
    RTCRtpSender: (
        "_RTCRtpSender__rtp_started",
        "_RTCRtpSender__rtp_exited",
        "_RTCRtpSender__ntp_timestamp",
        "_RTCRtpSender__rtp_timestamp",
        "_RTCRtpSender__octet_count",
        "_RTCRtpSender__packet_count",
        "_ssrc",
        "_rtx_ssrc",
        "_stream_id",
        "_run_rtp",
        "_retransmit",
        "_send_keyframe",
        "_handle_rtcp_packet",
    ),
    RTCRtpTransceiver: ("_RTCRtpTransceiver__sender", "_headerExtensions"),
    RTCRtpReceiver: (
        "_RTCRtpReceiver__decoder_queue",
        "_RTCRtpReceiver__remote_streams",
        "_RTCRtpReceiver__rtx_ssrc",
        "_send_rtcp_pli",
        "_set_rtcp_ssrc",
        "receive",
    ),
    RTCPeerConnection: ("_RTCPeerConnection__iceTransports",),
    RTCDtlsTransport: ("_tx_srtp", "_handle_rtcp_data"),
    RTCIceTransport: ("_connection",),
    RTCIceGatherer: ("_connection",),
    RTCSctpTransport: (
        "_forward_tsn_chunk",
        "_update_advanced_peer_ack_point",
        "_sack_needed",
        "_send_sack",
    ),
    aioice.ice.Connection: ("_nominated", "turn_ssl"),
    aioice.turn.TurnTransport: ("_TurnTransport__inner_protocol",),
}


class UnsupportedAiortcError(RuntimeError):
    """These hooks do not fit the installed aiortc."""


@dataclass(frozen=True)
class OutgoingFrame:
    """Payloads that leave together, and their 32-bit RTP timestamp."""

    payloads: tuple[bytes, ...]
    timestamp: int
    key: bool = False  # whether it needs nothing from before it
    more: int = 0  # bytes to send again on top, to see what the network takes


class Detour(Protocol):
    """A worse network that packets take before they are sent (lab.timed.TimedLine)."""

    def offer(self, size: int, deliver: Callable[[], None]) -> None:
        """Put a packet of `size` bytes in; `deliver` is called when it comes out, if it does."""


class FrameSource(Protocol):
    """The queue that a sender sends from, and which receives the viewer's RTCP.

    `backlog` is set by the sender: it returns the bytes that wait in the socket. `detour` is the
    worse network that packets take, or None.
    """

    backlog: Callable[[], int]
    detour: Detour | None

    async def take(self) -> OutgoingFrame:
        """Wait for the next frame."""

    def key_frame_wanted(self) -> None:
        """The viewer lost a frame (PLI, FIR)."""

    def on_report(self) -> None:
        """RTCP has arrived from the viewer."""

    def on_delivery(self, delivery: ArrivalReport) -> None:
        """The viewer has reported which packets arrived, and when."""


class PacketSender(RTCRtpSender):
    """Sends the frames of a queue to one viewer, instead of encoding a track."""

    def __init__(
        self, kind: str, transport: Any, frames: FrameSource, on_failure: Callable[[], None]
    ) -> None:
        super().__init__(kind, transport)
        self._frames, self._on_failure = frames, on_failure
        frames.backlog = self.backlog
        self._stream: RtpStream | None = None
        self._noted = 0.0
        self._sent = SentPackets()

    async def send(self, parameters: RTCRtpSendParameters) -> None:
        """Begin to send with these parameters; aiortc calls this once the connection is up."""
        if self._stream is None:
            self._stream = _stream_for(parameters, self._ssrc, self._rtx_ssrc)
            if self._stream.numbered:
                _tap_rtcp(self.transport, self._take_rtcp)
        await super().send(parameters)

    def backlog(self) -> int:
        """Return the bytes that wait in the socket (of a relay, if any) for the network."""
        pair = self.transport.transport._connection._nominated.get(1)
        if pair is None:
            return 0
        transport: Any = pair.protocol.transport
        inner = getattr(transport, "_TurnTransport__inner_protocol", None)
        if inner is not None:
            transport = inner.transport
        return int(transport.get_write_buffer_size())

    async def _run_rtp(self, codec: RTCRtpCodecParameters) -> None:
        getattr(self, "_RTCRtpSender__rtp_started").set()
        assert self._stream is not None
        try:
            while True:
                out = await self._frames.take()
                now = time.time()
                self._send(self._stream.packets(out.payloads, out.timestamp, now, key=out.key))
                if out.more:
                    self._send(self._stream.again(out.more, now))
                if now - self._noted >= _NOTE_EVERY:
                    self._noted = now
                    self._note_for_reports(out.timestamp, now)
        except ConnectionError as error:  # the connection's own state tells
            log.info("sender_ended", kind=self.kind, reason=reason_of(error))
        except Exception:
            log.exception("sender_failed", kind=self.kind)
            self._on_failure()
            raise
        finally:
            getattr(self, "_RTCRtpSender__rtp_exited").set()

    def _send(self, packets: list[bytes]) -> None:
        """Encrypt and send; aiortc itself awaits five times a packet, which never waits.

        Raises:
            ConnectionError: there is no connection, or no longer one.
        """
        dtls: Any = self.transport
        pair = dtls.transport._connection._nominated.get(1)
        if pair is None or dtls.state != "connected":
            raise ConnectionError("not connected")
        assert self._stream is not None
        if self._stream.numbered:
            now = time.monotonic()
            for back in range(len(packets), 0, -1):
                self._sent.add((self._stream.transport_number - back) % NUMBERS, now)
        protect = dtls._tx_srtp.protect
        send = pair.protocol.transport.sendto
        address = pair.remote_addr
        detour = self._frames.detour
        for packet in packets:
            if detour is None:
                send(protect(packet), address)
            else:
                # encrypted in order, as SRTP requires; only then delayed or lost
                protected = protect(packet)
                detour.offer(len(protected), functools.partial(self._send_late, protected))

    def _send_late(self, protected: bytes) -> None:
        """Send an encrypted packet after a detour, to the page's current address."""
        dtls: Any = self.transport
        pair = dtls.transport._connection._nominated.get(1)
        if pair is not None and dtls.state == "connected":
            pair.protocol.transport.sendto(protected, pair.remote_addr)

    def _note_for_reports(self, timestamp: int, now: float) -> None:
        assert self._stream is not None
        setattr(self, "_RTCRtpSender__ntp_timestamp", ntp_time(now))
        setattr(self, "_RTCRtpSender__rtp_timestamp", timestamp)
        setattr(self, "_RTCRtpSender__octet_count", self._stream.octets_sent)
        setattr(self, "_RTCRtpSender__packet_count", self._stream.packets_sent)

    async def _retransmit(self, sequence_number: int) -> None:
        packet = self._stream and self._stream.retransmission(sequence_number, time.time())
        if packet:
            self._send([packet])

    def _send_keyframe(self) -> None:
        self._frames.key_frame_wanted()

    async def _handle_rtcp_packet(self, packet: AnyRtcpPacket) -> None:
        self._frames.on_report()
        await super()._handle_rtcp_packet(packet)

    def _take_rtcp(self, data: bytes) -> None:
        for delivery in self._sent.deliveries(data):
            self._frames.on_delivery(delivery)


def _tap_rtcp(transport: Any, take: Callable[[bytes], None]) -> None:
    """Have `take` called with all RTCP of a transport: aiortc reads transport-wide feedback as a
    list of lost packets.
    """
    handle = transport._handle_rtcp_data

    async def handle_tapped(data: bytes) -> None:
        take(data)
        await handle(data)

    transport._handle_rtcp_data = handle_tapped


def add_sender(
    connection: RTCPeerConnection,
    kind: str,
    frames: FrameSource,
    codec: str,
    *,
    listens: bool = True,
    on_failure: Callable[[], None] = lambda: None,
) -> PacketSender:
    """Add a transceiver that sends from `frames` with `codec` alone, such as `video/VP8`; call
    before the offer is set.

    `listens`: whether the page may send on the same line. `on_failure` is called when sending ends
    although the connection has not.
    """
    transceiver = connection.addTransceiver(kind, direction="sendrecv" if listens else "sendonly")
    transceiver.setCodecPreferences(_with_retransmission(kind, codec))
    old = transceiver.sender
    sender = PacketSender(kind, old.transport, frames, on_failure)
    # its own stream id: browsers delay video to match the sound of the same stream
    sender._stream_id = f"{old._stream_id}-{kind}"
    transceiver.receiver._set_rtcp_ssrc(sender._ssrc)
    setattr(transceiver, "_RTCRtpTransceiver__sender", sender)
    return sender


def number_own_packets(connection: RTCPeerConnection) -> None:
    """Agree on transport-wide numbers only for what we send; call before the answer is made.

    A page that sends with them expects feedback, which aiortc does not give.
    """
    for transceiver in connection.getTransceivers():
        if not isinstance(transceiver.sender, PacketSender):
            transceiver._headerExtensions = [
                extension
                for extension in transceiver._headerExtensions
                if extension.uri != TRANSPORT_NUMBER
            ]


def discard(receiver: RTCRtpReceiver) -> None:
    """Keep a receiver from starting; call it before the connection is up.

    aiortc finds the receiver of a stream that no offer has named by its payload type, and only
    while a single receiver has that type: those that are not used must not start.
    """

    async def receive_nothing(_parameters: Any) -> None:
        pass

    setattr(receiver, "receive", receive_nothing)


def on_encoded_frame(receiver: RTCRtpReceiver, take: Callable[[bytes, int], None]) -> None:
    """Have `take` called on the loop with (encoded picture or sound, RTP ticks from 0) instead of
    it being decoded.

    Call it before the connection is up. aiortc still puts packets together, asks for lost ones and
    reports to the sender.
    """
    setattr(receiver, "_RTCRtpReceiver__decoder_queue", _EncodedFrameTap(take))


async def ask_key_frame(receiver: RTCRtpReceiver) -> None:
    """Report a lost frame to the sender, so that the next one is a key frame."""
    retransmissions = getattr(receiver, "_RTCRtpReceiver__rtx_ssrc")
    for ssrc in list(getattr(receiver, "_RTCRtpReceiver__remote_streams")):
        if ssrc not in retransmissions:
            await receiver._send_rtcp_pli(ssrc)


def restrict_codec(transceiver: RTCRtpTransceiver, codec: str) -> None:
    """Let the page send with one codec, such as `video/VP8`; it resends in the same stream."""
    wanted = [
        c
        for c in RTCRtpSender.getCapabilities(transceiver.kind).codecs
        if c.mimeType.lower() == codec.lower()
    ]
    transceiver.setCodecPreferences(wanted)


def set_turn_tls_context(connection: RTCPeerConnection, context: ssl.SSLContext) -> None:
    """Set whose certificates a TLS relay needs, before gathering; default is the system's."""
    for transport in connection._RTCPeerConnection__iceTransports:  # type: ignore[attr-defined]
        ice = transport.iceGatherer._connection
        if ice.turn_ssl:
            ice.turn_ssl = context


async def close_sockets(connection: RTCPeerConnection) -> None:
    """Close the sockets of a connection whose own close() failed: after an offer that aiortc could
    not apply, close() stops at the first part that cannot be closed.
    """
    for transport in connection._RTCPeerConnection__iceTransports:  # type: ignore[attr-defined]
        await transport.iceGatherer._connection.close()


class _EncodedFrameTap(queue.Queue[Any]):
    """Replaces the queue to aiortc's decoder, whose thread then sleeps until the end."""

    def __init__(self, take: Callable[[bytes, int], None]) -> None:
        super().__init__()
        self._take = take

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        if item is None:
            super().put(item, block, timeout)
            return
        _, frame = item
        self._take(frame.data, frame.timestamp)


def limit_forward_tsn(transport: Any) -> None:
    """Let an `RTCSctpTransport` send FORWARD TSN at most once every `FORWARD_TSN_PERIOD` s.

    A message that is not retransmitted leaves a gap, and a FORWARD TSN (RFC 3758) tells the
    receiver to skip it. aiortc sends one in answer to every SACK that does not know it yet, and the
    receiver answers each with a SACK: where a full queue makes the path half a second long, about a
    hundred of each are in flight at any time, more with each message, and keep the queue full.
    """
    update = transport._update_advanced_peer_ack_point
    sent_at = float("-inf")

    def update_rarely() -> None:
        nonlocal sent_at
        update()
        if transport._forward_tsn_chunk is not None:
            now = time.monotonic()
            if now - sent_at < FORWARD_TSN_PERIOD:
                transport._forward_tsn_chunk = None
            else:
                sent_at = now

    transport._update_advanced_peer_ack_point = update_rarely


def limit_sacks(transport: Any) -> None:
    """Let an `RTCSctpTransport` acknowledge at most once every `SACK_PERIOD` s.

    RFC 9260, section 6.2, has a receiver wait for up to 0.5 s. aiortc acknowledges each message at
    once, and the acknowledgements of twenty-five messages a second take 20 kbit/s.
    """
    send = transport._send_sack
    sent_at = float("-inf")
    tasks: set[asyncio.Task[None]] = set()

    async def send_later(pause: float) -> None:
        await asyncio.sleep(pause)
        if transport._sack_needed and transport.transport.state == "connected":
            await send_rarely()

    async def send_rarely() -> None:
        nonlocal sent_at
        pause = sent_at + SACK_PERIOD - time.monotonic()
        if pause <= 0.0:
            sent_at = time.monotonic()
            await send()
        elif not tasks:
            task = asyncio.ensure_future(send_later(pause))
            tasks.add(task)
            task.add_done_callback(tasks.discard)

    transport._send_sack = send_rarely


def install() -> None:
    """Add playout-delay and transport-wide feedback to aiortc, and the loopback address to aioice
    where there is no other; idempotent.

    Raises:
        UnsupportedAiortcError: another aiortc than 1.16.x is installed, or one that lacks a name
            used here.
    """
    check()
    offered = aiortc.codecs.HEADER_EXTENSIONS["video"]
    for uri, number in _FREE_EXTENSION_IDS.items():
        if all(extension.uri != uri for extension in offered):
            offered.append(RTCRtpHeaderExtensionParameters(id=number, uri=uri))
    for codec in aiortc.codecs.CODECS["video"]:
        if codec.mimeType == "video/VP8" and _TRANSPORT_CC not in codec.rtcpFeedback:
            codec.rtcpFeedback.append(_TRANSPORT_CC)
    if not hasattr(aioice.ice.get_host_addresses, "found_by"):
        aioice.ice.get_host_addresses = _WithLoopback(aioice.ice.get_host_addresses)


def check() -> None:
    """Raise UnsupportedAiortcError for an aiortc that these hooks do not fit."""
    if not aiortc.__version__.startswith("1.16."):
        raise UnsupportedAiortcError(
            f"aiortc {aiortc.__version__} is installed, but 1.16 is required"
        )
    missing = [
        f"{owner.__name__}.{name}"
        for owner, names in PRIVATE_NAMES.items()
        for name in names
        if name not in dir(owner) and name not in owner.__init__.__code__.co_names
    ]
    if missing:
        raise UnsupportedAiortcError(f"aiortc {aiortc.__version__} lacks {', '.join(missing)}")


class _WithLoopback:
    """aioice's search for addresses, with 127.0.0.1 where no other interface is up."""

    def __init__(self, found_by: Callable[..., list[str]]) -> None:
        self.found_by = found_by

    def __call__(self, use_ipv4: bool, use_ipv6: bool) -> list[str]:
        return self.found_by(use_ipv4=use_ipv4, use_ipv6=use_ipv6) or [LOOPBACK]


def _stream_for(parameters: RTCRtpSendParameters, ssrc: int, rtx_ssrc: int) -> RtpStream:
    ids = {
        extension.uri: extension.id
        for extension in parameters.headerExtensions
        if 1 <= extension.id <= LARGEST_ID
    }
    agreed = ExtensionIds(
        mid=ids.get(MID),
        abs_send_time=ids.get(ABS_SEND_TIME),
        playout_delay=ids.get(PLAYOUT_DELAY),
        transport_number=ids.get(TRANSPORT_NUMBER),
    )
    payload_type = parameters.codecs[0].payloadType
    assert payload_type is not None
    rtx = [
        c
        for c in parameters.codecs
        if c.mimeType.lower().endswith("/rtx") and c.parameters.get("apt") == payload_type
    ]
    return RtpStream(
        ssrc=ssrc,
        payload_type=payload_type,
        sequence=random.randrange(0x8000),
        extension=extension_block(agreed, parameters.muxId),
        timed=agreed.abs_send_time is not None,
        numbered=agreed.transport_number is not None,
        rtx_ssrc=rtx_ssrc,
        rtx_payload_type=rtx[0].payloadType if rtx else None,
        rtx_sequence=random.randrange(0x8000),
    )


def _with_retransmission(kind: str, codec: str) -> list[RTCRtpCodecCapability]:
    wanted = {codec.lower(), f"{kind}/rtx"}
    return [c for c in RTCRtpSender.getCapabilities(kind).codecs if c.mimeType.lower() in wanted]
