"""Clocks, payloads and packets."""

import itertools
import math

from aiortc.rtcrtpparameters import RTCRtpHeaderExtensionParameters, RTCRtpParameters
from aiortc.rtp import HeaderExtensionsMap, RtpPacket, unpack_header_extensions
from hypothesis import given, strategies as st

from robots.agent.media.rtp import (
    ASKED_AGAIN,
    HISTORY,
    ExtensionIds,
    MediaClockSender,
    RtpClock,
    RtpStream,
    capture_stamp,
    extension_block,
    ntp_time,
)
from robots.agent.media.webrtc.aiortc_hooks import ABS_SEND_TIME, MID
from robots.api.messages import MediaClock
from tests.support.examples import examples

NOW = 1_800_000_000.25


def test_a_timestamp_follows_the_capture_stamp() -> None:
    clock = RtpClock(origin=7)
    assert [clock.tick(stamp) for stamp in (NOW, NOW + 0.1, NOW + 1.0)] == [0, 9_000, 90_000]
    assert clock.timestamp(9_000) == 9_007


@examples(50, thorough=1000)
@given(st.lists(st.floats(min_value=0, max_value=4e9), min_size=2, max_size=50))
def test_timestamps_grow_although_the_wall_clock_steps_back(stamps: list[float]) -> None:
    clock = RtpClock(origin=0)
    ticks = [clock.tick(stamp) for stamp in stamps]
    assert all(0 < after - before <= 5.0 * 90_000 for before, after in itertools.pairwise(ticks))


def test_a_page_computes_the_stamp_across_the_wrap_of_32_bits() -> None:
    clock = MediaClock(rtp=2**32 - 45_000, stamp=NOW)
    assert capture_stamp(clock, 45_000) == NOW + 1.0
    assert capture_stamp(clock, 2**32 - 90_000) == NOW - 0.5


def test_media_clock_is_sent_every_second_and_when_it_no_longer_fits() -> None:
    sender = MediaClockSender()
    assert sender.before(0, NOW, 0.0) == MediaClock(rtp=0, stamp=NOW)
    assert sender.before(45_000, NOW + 0.5, 0.5) is None
    assert sender.before(90_000, NOW + 1.0, 1.0) is not None
    assert sender.before(93_000, NOW + 3600.0, 1.03) is not None, "the robot's clock was set"
    assert sender.before(96_000, NOW + 3600.0 + 3_000 / 90_000, 1.07) is None
    sender.forget()
    assert sender.before(99_000, NOW + 3600.0 + 6_000 / 90_000, 1.1) is not None


@examples(50, thorough=1000)
@given(st.permutations(range(1, 15)), st.text("abc012", min_size=1, max_size=16))
def test_header_extensions_are_read_back(numbers: list[int], mid: str) -> None:
    mid_id, time_id, delay_id, number_id = numbers[:4]
    ids = ExtensionIds(
        mid=mid_id, abs_send_time=time_id, playout_delay=delay_id, transport_number=number_id
    )
    block = extension_block(ids, mid)
    stream = RtpStream(5, 97, 9, block, timed=True, numbered=True, transport_number=65_535)
    raw = stream.packets((b"data",), 1234, NOW)[0]
    assert len(raw) % 4 == 0
    words = int.from_bytes(raw[14:16], "big")
    elements = dict(unpack_header_extensions(0xBEDE, raw[16 : 16 + 4 * words]))
    assert elements[mid_id] == mid.encode()
    assert elements[delay_id] == bytes(3)
    assert elements[time_id] == (ntp_time(NOW) >> 14 & 0xFFFFFF).to_bytes(3, "big")
    assert elements[number_id] == b"\xff\xff"
    assert stream.transport_number == 0
    assert raw[16 + 4 * words :] == b"data"


def test_header_has_only_the_agreed_extensions() -> None:
    assert extension_block(ExtensionIds(), "0") == b""
    stream = RtpStream(ssrc=5, payload_type=97, sequence=9)
    assert RtpPacket.parse(stream.packets((b"x",), 1, NOW)[0]).payload == b"x"


def _map() -> HeaderExtensionsMap:
    extensions = HeaderExtensionsMap()
    agreed = [RTCRtpHeaderExtensionParameters(*one) for one in ((1, MID), (3, ABS_SEND_TIME))]
    extensions.configure(RTCRtpParameters(headerExtensions=agreed))
    return extensions


def test_aiortc_reads_our_packets_and_only_the_last_has_the_marker() -> None:
    block = extension_block(ExtensionIds(mid=1, abs_send_time=3), "0")
    stream = RtpStream(ssrc=5, payload_type=97, sequence=65_535, extension=block, timed=True)
    packets = [RtpPacket.parse(raw, _map()) for raw in stream.packets((b"one", b"two"), 77, NOW)]
    assert [(p.sequence_number, p.marker, p.payload, p.timestamp, p.ssrc) for p in packets] == [
        (65_535, 0, b"one", 77, 5),
        (0, 1, b"two", 77, 5),
    ]
    assert packets[0].extensions.mid == "0"
    assert packets[0].extensions.abs_send_time == ntp_time(NOW) >> 14 & 0xFFFFFF
    assert (stream.packets_sent, stream.octets_sent) == (2, 6)


def test_a_packet_is_repeated_unchanged_without_a_retransmission_stream() -> None:
    stream = RtpStream(ssrc=5, payload_type=97, sequence=100)
    sent = stream.packets((b"one",), 77, NOW)[0]
    assert stream.retransmission(100, NOW) == sent


def test_old_packets_are_not_sent_again() -> None:
    stream = RtpStream(ssrc=5, payload_type=97, sequence=0)
    for _ in range(HISTORY + 1):
        stream.packets((b"x",), 1, NOW)
    assert stream.retransmission(0, NOW) is None
    assert stream.retransmission(1, NOW) is not None
    assert stream.retransmission(60_000, NOW) is None


def test_after_a_key_frame_no_earlier_packet_is_repeated() -> None:
    stream = RtpStream(ssrc=5, payload_type=97, sequence=0)
    stream.packets((b"old",), 1, NOW)
    stream.packets((b"key",), 2, NOW, key=True)
    assert stream.retransmission(0, NOW) is None
    assert stream.retransmission(1, NOW) is not None


def test_repeated_requests_for_all_packets_are_limited_to_a_share() -> None:
    stream = RtpStream(ssrc=5, payload_type=97, sequence=0)
    for n in range(60):
        stream.packets((bytes(1000), bytes(1000)), n, NOW + n / 30)
    again = 0
    for n in range(30):
        now = NOW + 2.0 + n / 30
        again += sum(len(stream.retransmission(sequence, now) or b"") for sequence in range(120))
    assert 4_000 < again < 0.5 * 60_000
    assert stream.retransmission(119, NOW + 10.0) is not None
    assert stream.retransmission(119, NOW + 10.0 + ASKED_AGAIN / 2) is None, "it is on its way"
    assert stream.retransmission(119, NOW + 10.1 + ASKED_AGAIN) is not None


def test_copies_fill_the_requested_bytes() -> None:
    stream = RtpStream(ssrc=5, payload_type=97, sequence=0, rtx_ssrc=6, rtx_payload_type=98)
    assert stream.again(5_000, NOW) == []
    stream.packets((bytes(1000), bytes(400)), 1, NOW)
    copies = stream.again(5_000, NOW)
    assert 3_500 < sum(map(len, copies)) <= 5_000
    assert {RtpPacket.parse(copy).payload_type for copy in copies} == {98}
    stream.rtx_payload_type = None
    assert stream.again(5_000, NOW) == [], "the same packet twice is taken for an attack"


def test_ntp_time_counts_from_1900() -> None:
    assert ntp_time(0.0) >> 32 == 2_208_988_800
    assert math.isclose((ntp_time(0.5) & 0xFFFFFFFF) / 2**32, 0.5)
