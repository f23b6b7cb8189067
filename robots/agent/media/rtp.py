"""RTP by hand (RFC 3550, 4588, 7741, 8285): clocks, payloads and packets, without sockets.

aiortc packetizes once a viewer; here a picture is cut into payloads once, and each viewer only gets
its own headers. The RTP timestamp comes from the moment of capture, so that one `MediaClock`
message lets a page turn it back into that moment.
"""

import itertools
import struct
from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import Literal

from robots.api.messages import MediaClock

Kind = Literal["audio", "video"]

VIDEO_RATE = 90_000
AUDIO_RATE = 48_000
MAX_PAYLOAD = 1_200  # bytes; what WebRTC itself sends, so that relays and tunnels need not fragment
LARGEST_ID, LONGEST_ELEMENT = 14, 16  # of the one-byte form of header extensions
HISTORY = 256  # packets kept for retransmission: about 1.5 s of a 1.2 Mbit/s video
ASKED_AGAIN = 0.08  # s in which a packet is not retransmitted twice
# share of the sent octets, and octets, that are retransmitted at most in a second
AGAIN_SHARE, LEAST_AGAIN = 0.4, 4_000
COPIED, MOST_COPIES = 16, 24  # the newest packets that are copied, and the copies of one frame

_TWO_16, _TWO_32 = 1 << 16, 1 << 32
_NTP_EPOCH = 2_208_988_800  # Unix time 0 in seconds of NTP (RFC 5905)
_LONGEST_STEP = 5.0  # s
_CLOCK_PERIOD = 1.0  # s
_TOLERANCE = 0.001  # s

# ticks from the last of one source to the first of the next
STEP: dict[Kind, int] = {"audio": 960, "video": 3000}
ROUND = 1 << 32  # ticks after which a timestamp wraps


class JoinedTicks:
    """One growing count of RTP ticks from several sources, each with its own origin."""

    def __init__(self, step: int) -> None:
        self._step, self._source, self._offset, self._last = step, "", 0, 0

    def tick(self, source: str, ticks: int) -> int:
        """Return the joined ticks of `ticks` of a source."""
        if source != self._source:
            self._source, self._offset = source, self._last + self._step - ticks
        self._last = ticks + self._offset
        return self._last


class RtpClock:
    """Gives each capture stamp its RTP timestamp, growing even when the robot's wall clock is set.

    A stamp that goes backwards, or jumps ahead by more than 5 s (a camera that was away, an NTP
    step), starts a new correspondence one `frame` later, and `reading` says so; browsers freeze on
    a timestamp that goes backwards.
    """

    def __init__(self, origin: int, rate: int = VIDEO_RATE, frame: float = 1 / 30) -> None:
        self._origin = origin
        self._rate = rate
        self._frame = frame
        self._ticks = 0
        self._stamp: float | None = None

    def tick(self, stamp: float) -> int:
        """Return the ticks (1/rate s, from 0, growing) of a frame captured at `stamp`, Unix s."""
        if self._stamp is not None:
            step = stamp - self._stamp
            self._ticks += max(
                1, round((step if 0.0 < step <= _LONGEST_STEP else self._frame) * self._rate)
            )
        self._stamp = stamp
        return self._ticks

    def timestamp(self, ticks: int) -> int:
        """Return the 32-bit RTP timestamp of `ticks`."""
        return (self._origin + ticks) % _TWO_32


class MediaClockSender:
    """Decides when a page is sent the relation of RTP timestamps and capture stamps: once a second,
    because the data channel may lose a message, and at once when a frame does not fit the last one.
    """

    def __init__(self) -> None:
        self._sent: MediaClock | None = None
        self._sent_at = 0.0

    def before(self, rtp: int, stamp: float, now: float) -> MediaClock | None:
        """Return the message to send before the frame (rtp, stamp), or None."""
        if (
            self._sent is not None
            and now - self._sent_at < _CLOCK_PERIOD
            and abs(capture_stamp(self._sent, rtp) - stamp) < _TOLERANCE
        ):
            return None
        self._sent, self._sent_at = MediaClock(rtp=rtp, stamp=stamp, rate=VIDEO_RATE), now
        return self._sent

    def forget(self) -> None:
        """Send it again with the next frame: there is a new channel."""
        self._sent = None


def capture_stamp(clock: MediaClock, rtp: int) -> float:
    """Return the moment of capture of the picture `rtp`, as a page computes it."""
    ahead = (rtp - clock.rtp + (_TWO_32 >> 1)) % _TWO_32 - (_TWO_32 >> 1)
    return clock.stamp + ahead / clock.rate


def vp8_payloads(picture: bytes) -> tuple[bytes, ...]:
    """Cut a VP8 picture into RTP payloads, each with its descriptor (RFC 7741, section 4.2):
    partition 0, and no picture id.

    The ids would jump when a viewer changes from one encoder to another. Without them the order
    of pictures follows from the sequence numbers, which are separate for each viewer.
    """
    first, rest = b"\x10", b"\x00"
    size = MAX_PAYLOAD - len(first)
    return tuple(
        (rest if start else first) + picture[start : start + size]
        for start in range(0, len(picture), size)
    )


def ntp_time(unix: float) -> int:
    """Return Unix time in seconds as a 64-bit NTP timestamp (32.32 fixed point)."""
    return int((unix + _NTP_EPOCH) * _TWO_32)


@dataclass(frozen=True)
class ExtensionIds:
    """The header extensions agreed on, ids 1 to 14, None where not agreed."""

    mid: int | None = None
    abs_send_time: int | None = None
    playout_delay: int | None = None
    transport_number: int | None = None


def extension_block(ids: ExtensionIds, mid: str) -> bytes:
    """Return a one-byte-header extension block (RFC 8285) that ends with abs-send-time and the
    transport-wide number, as far as agreed (`RtpStream` fills them in).

    playout-delay is (0, 0): show each picture as it comes. A mid too long for the one-byte form is
    left out.
    """
    fixed = varying = b""
    if ids.mid is not None and 1 <= len(mid) <= LONGEST_ELEMENT:
        fixed += bytes([ids.mid << 4 | len(mid) - 1]) + mid.encode("ascii")
    if ids.playout_delay is not None:
        fixed += bytes([ids.playout_delay << 4 | 2, 0, 0, 0])
    if ids.abs_send_time is not None:
        varying += bytes([ids.abs_send_time << 4 | 2, 0, 0, 0])
    if ids.transport_number is not None:
        varying += bytes([ids.transport_number << 4 | 1, 0, 0])
    # padding may stand between elements (RFC 8285, section 4.1.2)
    elements = fixed + bytes(-len(fixed + varying) % 4) + varying
    return b"\xbe\xde" + struct.pack("!H", len(elements) // 4) + elements if elements else b""


@dataclass
class RtpStream:
    """The packets of one stream to one viewer: own sequence numbers, shared payloads, and a history
    for retransmission.

    `timed` and `numbered` tell whether `extension` has abs-send-time and a transport-wide number,
    which grows by one with each packet, retransmissions included. `rtx_payload_type` None means
    that a lost packet is sent again as it was.
    """

    ssrc: int
    payload_type: int
    sequence: int
    extension: bytes = b""
    timed: bool = False
    numbered: bool = False
    rtx_ssrc: int = 0
    rtx_payload_type: int | None = None
    rtx_sequence: int = 0
    transport_number: int = 0  # of the next packet
    packets_sent: int = 0
    octets_sent: int = 0
    # when the present second began, and what had been sent by then
    _second: tuple[float, int] = (0.0, 0)
    _octets_a_second: float = 0.0
    # when how many octets were sent again
    _again: deque[tuple[float, int]] = field(default_factory=deque)
    _asked: dict[int, float] = field(default_factory=dict)  # when a packet was sent again
    _history: OrderedDict[int, tuple[bytes, bool, int]] = field(default_factory=OrderedDict)

    def packets(
        self, payloads: tuple[bytes, ...], timestamp: int, now: float, *, key: bool = False
    ) -> list[bytes]:
        """Return the packets of one picture or sound, the last with the marker; `now` is Unix time
        in seconds.

        After a `key` frame nothing older is retransmitted: the page does not need it, and still
        asks for it.
        """
        if key:
            self._history.clear()
            self._asked.clear()
        if not 0.0 <= now - self._second[0] < 1.0:
            self._octets_a_second = float(self.octets_sent - self._second[1])
            self._second = (now, self.octets_sent)
        packets = []
        for position, payload in enumerate(payloads, start=1):
            marker = position == len(payloads)
            header = self._header(self.payload_type, marker, self.sequence, timestamp, self.ssrc)
            packets.append(header + self._next_extension(now) + payload)
            self._remember(payload, marker, timestamp)
            self.sequence = (self.sequence + 1) % _TWO_16
            self.octets_sent += len(payload)
        self.packets_sent += len(payloads)
        return packets

    def retransmission(self, sequence: int, now: float) -> bytes | None:
        """Return the packet that answers a NACK for `sequence`.

        None when it is too old, was just retransmitted, or when the retransmissions of the last
        second reach their limit: a page asks again and again for every packet that a full queue has
        dropped, and the answers would keep the queue full.
        """
        if sequence not in self._history or now - self._asked.get(sequence, 0.0) < ASKED_AGAIN:
            return None
        while self._again and now - self._again[0][0] > 1.0:
            self._again.popleft()
        if sum(octets for _, octets in self._again) > max(
            LEAST_AGAIN, AGAIN_SHARE * self._octets_a_second
        ):
            return None
        packet = self._copy(sequence, now)
        self._asked[sequence] = now
        self._again.append((now, len(packet)))
        return packet

    def _copy(self, sequence: int, now: float) -> bytes:
        payload, marker, timestamp = self._history[sequence]
        extension = self._next_extension(now)
        if self.rtx_payload_type is None:
            header = self._header(self.payload_type, marker, sequence, timestamp, self.ssrc)
            return header + extension + payload
        header = self._header(
            self.rtx_payload_type, marker, self.rtx_sequence, timestamp, self.rtx_ssrc
        )
        self.rtx_sequence = (self.rtx_sequence + 1) % _TWO_16
        return header + extension + struct.pack("!H", sequence) + payload

    def again(self, octets: int, now: float) -> list[bytes]:
        """Return copies of the newest packets, up to `octets`; none without an RTX stream."""
        if self.rtx_payload_type is None:
            return []
        copies: list[bytes] = []
        newest = itertools.cycle(list(reversed(self._history))[:COPIED])
        for sequence in itertools.islice(newest, MOST_COPIES):
            copy = self._copy(sequence, now)
            if octets < len(copy):
                break
            copies.append(copy)
            octets -= len(copy)
        return copies

    def _header(
        self, payload_type: int, marker: bool, sequence: int, timestamp: int, ssrc: int
    ) -> bytes:
        first = 0x90 if self.extension else 0x80
        return struct.pack("!BBHLL", first, marker << 7 | payload_type, sequence, timestamp, ssrc)

    def _next_extension(self, now: float) -> bytes:
        """Return the extensions of the next packet, with abs-send-time (6.18 fixed point seconds)
        and the transport-wide number, if agreed.
        """
        extension = self.extension
        if self.timed:
            end = len(extension) - 3 * self.numbered
            time = (ntp_time(now) >> 14 & 0xFFFFFF).to_bytes(3, "big")
            extension = extension[: end - 3] + time + extension[end:]
        if self.numbered:
            extension = extension[:-2] + struct.pack("!H", self.transport_number)
            self.transport_number = (self.transport_number + 1) % _TWO_16
        return extension

    def _remember(self, payload: bytes, marker: bool, timestamp: int) -> None:
        self._history[self.sequence] = (payload, marker, timestamp)
        if len(self._history) > HISTORY:
            oldest, _ = self._history.popitem(last=False)
            self._asked.pop(oldest, None)
