"""What aiortc 1.16 does not offer: shared packets, playout-delay, key-frame requests, an RTP clock,
and a robot without network.

`PacketSender` takes the place of aiortc's RTCRtpSender. The original asks a track for frames,
encodes them for its one viewer and draws a random RTP origin that cannot be read; ours is handed
payloads that were encoded once for everybody, with their RTP timestamps. DTLS, SRTP, ICE, RTCP
reports and SDP stay aiortc's. The project pins 1.16.x, `check()` refuses anything that lacks a name
used here, and a test runs all of it against a real connection.
"""

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
    RTCRtpCodecCapability,
    RTCRtpCodecParameters,
    RTCRtpHeaderExtensionParameters,
    RTCRtpSendParameters,
)
from aiortc.rtp import AnyRtcpPacket, RtcpRrPacket, RtcpSrPacket

from robots.agent.media.rtp import (
    LARGEST_ID,
    ExtensionIds,
    RtpStream,
    extension_block,
    ntp_time,
)
from robots.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

PLAYOUT_DELAY = "http://www.webrtc.org/experiments/rtp-hdrext/playout-delay"
ABS_SEND_TIME = "http://www.webrtc.org/experiments/rtp-hdrext/abs-send-time"
MID = "urn:ietf:params:rtp-hdrext:sdes:mid"
_FREE_EXTENSION_ID = 4  # aiortc itself takes 1 to 3 in the offers it makes
LOOPBACK = "127.0.0.1"
_NOTE_EVERY = 0.25  # s; a sender report goes out about once a second

# Every private name of theirs that the code in this folder touches, and where it is: `check` looks
# for each, and a test reads the folder for others.
PRIVATE_NAMES: dict[type, tuple[str, ...]] = {
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
    RTCRtpTransceiver: ("_RTCRtpTransceiver__sender",),
    RTCRtpReceiver: (
        "_RTCRtpReceiver__decoder_queue",
        "_RTCRtpReceiver__remote_streams",
        "_RTCRtpReceiver__rtx_ssrc",
        "_send_rtcp_pli",
        "_set_rtcp_ssrc",
        "receive",
    ),
    RTCPeerConnection: ("_RTCPeerConnection__iceTransports",),
    RTCDtlsTransport: ("_tx_srtp", "_send_rtp"),
    RTCIceTransport: ("_connection",),
    RTCIceGatherer: ("_connection",),
    RTCSctpTransport: ("_forward_tsn_chunk", "_update_advanced_peer_ack_point"),  # of sctp.py
    aioice.ice.Connection: ("_nominated", "turn_ssl"),
    aioice.turn.TurnTransport: ("_TurnTransport__inner_protocol",),
}


class UnsupportedAiortcError(RuntimeError):
    """The installed aiortc is not one that these hooks fit."""


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
    """Where a sender finds what it sends, and whom it tells what the viewer asks for.

    `backlog` is set by the sender: it returns the bytes that wait in the socket. `detour` is what
    its packets have to take, or None.
    """

    backlog: Callable[[], int]
    detour: Detour | None

    async def take(self) -> OutgoingFrame:
        """Wait for the next thing to send."""

    def key_frame_wanted(self) -> None:
        """Hear that the viewer lost a picture (PLI, FIR)."""

    def heard(self, loss: float | None) -> None:
        """Note RTCP from the viewer, with its share of lost packets if it reports one."""


class PacketSender(RTCRtpSender):
    """Sends what an outbox holds to one viewer, instead of encoding a track."""

    def __init__(
        self, kind: str, transport: Any, frames: FrameSource, on_failure: Callable[[], None]
    ) -> None:
        super().__init__(kind, transport)
        self._outbox, self._on_failure = frames, on_failure
        frames.backlog = self.backlog
        self._stream: RtpStream | None = None
        self._noted = 0.0

    async def send(self, parameters: RTCRtpSendParameters) -> None:
        """Begin to send with these parameters; aiortc calls this once the connection is up."""
        if self._stream is None:
            self._stream = _stream_for(parameters, self._ssrc, self._rtx_ssrc)
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
                out = await self._outbox.take()
                now = time.time()
                self._send_at_once(
                    self._stream.packets(out.payloads, out.timestamp, now, key=out.key)
                )
                if out.more:
                    self._send_at_once(self._stream.again(out.more, now))
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

    def _send_at_once(self, packets: list[bytes]) -> None:
        """Encrypt and send, without the five awaits a packet of aiortc's own way, none of which
        ever waits.

        Raises:
            ConnectionError: the connection is not up, or not any more.
        """
        dtls: Any = self.transport
        pair = dtls.transport._connection._nominated.get(1)
        if pair is None or dtls.state != "connected":
            raise ConnectionError("not connected")
        protect = dtls._tx_srtp.protect
        send = pair.protocol.transport.sendto
        address = pair.remote_addr
        detour = self._outbox.detour
        for packet in packets:
            if detour is None:
                send(protect(packet), address)
            else:
                # Encrypted in its order, as SRTP wants it; what a network then does to it is the
                # network's.
                protected = protect(packet)
                detour.offer(len(protected), functools.partial(self._send_late, protected))

    def _send_late(self, protected: bytes) -> None:
        """Send an encrypted packet that comes from a detour, to wherever the page is by now."""
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
        if packet and self._outbox.detour is None:
            await self.transport._send_rtp(packet)
        elif packet:
            self._send_at_once([packet])

    def _send_keyframe(self) -> None:
        self._outbox.key_frame_wanted()

    async def _handle_rtcp_packet(self, packet: AnyRtcpPacket) -> None:
        self._outbox.heard(_loss(packet, self._ssrc))
        await super()._handle_rtcp_packet(packet)


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

    `listens`: whether what the page sends on the same line is wanted. `on_failure` is called when
    sending ends although the connection has not.
    """
    transceiver = connection.addTransceiver(kind, direction="sendrecv" if listens else "sendonly")
    transceiver.setCodecPreferences(_with_retransmission(kind, codec))
    old = transceiver.sender
    sender = PacketSender(kind, old.transport, frames, on_failure)
    # A stream id of its own: browsers hold a picture back to match the sound of the same stream,
    # ours must never wait.
    sender._stream_id = f"{old._stream_id}-{kind}"
    transceiver.receiver._set_rtcp_ssrc(sender._ssrc)
    setattr(transceiver, "_RTCRtpTransceiver__sender", sender)
    return sender


def discard(receiver: RTCRtpReceiver) -> None:
    """Let a receiver never begin; call it before the connection is up.

    aiortc finds the receiver of a stream that no offer has named by its payload type, and only
    while one receiver alone has that type: one that is discarded must not be in the way.
    """
    setattr(receiver, "receive", _receive_nothing)


async def _receive_nothing(_parameters: Any) -> None:
    pass


def on_encoded_frame(receiver: RTCRtpReceiver, take: Callable[[bytes, int], None]) -> None:
    """Have `take` called on the loop with (encoded picture or sound, RTP ticks from 0) instead of
    it being decoded.

    Call it before the connection is up. Putting packets together, asking again for lost ones and
    telling the sender stay aiortc's.
    """
    setattr(receiver, "_RTCRtpReceiver__decoder_queue", _EncodedFrameTap(take))


async def ask_key_frame(receiver: RTCRtpReceiver) -> None:
    """Tell the sender that a picture was lost, so that the next one is whole."""
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
    """Close the sockets of a connection whose own close() failed: an offer that aiortc gave up
    half-way leaves parts that cannot be closed, and that stops at the first of them.
    """
    for transport in connection._RTCPeerConnection__iceTransports:  # type: ignore[attr-defined]
        await transport.iceGatherer._connection.close()


class _EncodedFrameTap(queue.Queue[Any]):
    """Takes the place of the queue to aiortc's decoder, whose thread then sleeps until the end."""

    def __init__(self, take: Callable[[bytes, int], None]) -> None:
        super().__init__()
        self._take = take

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        if item is None:
            super().put(item, block, timeout)
            return
        _, frame = item
        self._take(frame.data, frame.timestamp)


def install() -> None:
    """Teach aiortc the playout-delay extension, and aioice to fall back on the loopback address;
    idempotent.

    Raises:
        UnsupportedAiortcError: another aiortc than 1.16.x is installed, or one that lacks a name
            used here.
    """
    check()
    offered = aiortc.codecs.HEADER_EXTENSIONS["video"]
    if all(extension.uri != PLAYOUT_DELAY for extension in offered):
        offered.append(RTCRtpHeaderExtensionParameters(id=_FREE_EXTENSION_ID, uri=PLAYOUT_DELAY))
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
        if not _has(owner, name)
    ]
    if missing:
        raise UnsupportedAiortcError(f"aiortc {aiortc.__version__} lacks {', '.join(missing)}")


class _WithLoopback:
    """aioice's search for addresses, with 127.0.0.1 where no other interface is up."""

    def __init__(self, found_by: Callable[..., list[str]]) -> None:
        self.found_by = found_by

    def __call__(self, use_ipv4: bool, use_ipv6: bool) -> list[str]:
        return self.found_by(use_ipv4=use_ipv4, use_ipv6=use_ipv6) or [LOOPBACK]


def _has(owner: Any, name: str) -> bool:
    return name in dir(owner) or name in owner.__init__.__code__.co_names


def _stream_for(parameters: RTCRtpSendParameters, ssrc: int, rtx_ssrc: int) -> RtpStream:
    ids = {
        extension.uri: extension.id
        for extension in parameters.headerExtensions
        if 1 <= extension.id <= LARGEST_ID
    }
    agreed = ExtensionIds(
        mid=ids.get(MID), abs_send_time=ids.get(ABS_SEND_TIME), playout_delay=ids.get(PLAYOUT_DELAY)
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
        rtx_ssrc=rtx_ssrc,
        rtx_payload_type=rtx[0].payloadType if rtx else None,
        rtx_sequence=random.randrange(0x8000),
    )


def _with_retransmission(kind: str, codec: str) -> list[RTCRtpCodecCapability]:
    wanted = {codec.lower(), f"{kind}/rtx"}
    return [c for c in RTCRtpSender.getCapabilities(kind).codecs if c.mimeType.lower() in wanted]


def _loss(packet: AnyRtcpPacket, ssrc: int) -> float | None:
    if not isinstance(packet, RtcpRrPacket | RtcpSrPacket):
        return None
    return next(
        (report.fraction_lost / 256 for report in packet.reports if report.ssrc == ssrc), None
    )
