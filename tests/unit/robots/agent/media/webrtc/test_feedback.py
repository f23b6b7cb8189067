"""What transport-wide feedback says about packets."""

import struct

import pytest
from hypothesis import given, strategies as st

from robots.agent.media.webrtc.feedback import SentPackets, arrivals
from tests.support.examples import examples
from tests.support.media.transport_feedback import feedback

# a run of two with small differences, then 14 bits: arrived, lost, arrived
CHUNKS = struct.pack("!HH", 1 << 13 | 2, 1 << 15 | 0b10_1000_0000_0000)
TICKS = bytes([4, 8, 12, 16])


def test_arrivals_are_read_across_the_wrap_of_the_numbers() -> None:
    found = arrivals(feedback(65_534, 5, CHUNKS, TICKS))
    assert [number for number, _ in found] == [65_534, 65_535, 0, 1, 2]
    assert [at and round(at - 64.0, 6) for _, at in found] == [0.001, 0.003, 0.006, None, 0.01]


def test_large_and_negative_differences_are_read() -> None:
    chunk = struct.pack("!H", 0b11 << 14 | 0b10_10 << 10)
    found = arrivals(feedback(7, 2, chunk, struct.pack("!hh", 4000, -400)))
    assert found == [(7, 65.0), (8, pytest.approx(64.9))]


def test_quickest_packet_and_losses_are_reported_once() -> None:
    sent = SentPackets()
    for number in range(5):
        sent.add(number, 10.0 + 0.004 * number)
    (first,) = sent.deliveries(feedback(0, 5, CHUNKS, TICKS))
    assert (first.sent_at, first.expected, first.lost) == (10.016, 5, 1)
    assert list(sent.deliveries(feedback(0, 5, CHUNKS, TICKS))) == [], "a repeated message"


def test_late_packet_is_no_longer_lost() -> None:
    sent = SentPackets()
    for number in range(5):
        sent.add(number, 10.0)
    assert len(list(sent.deliveries(feedback(0, 5, CHUNKS, TICKS)))) == 1
    (late,) = sent.deliveries(feedback(3, 1, struct.pack("!H", 1 << 13 | 1), b"\x04"))
    assert (late.expected, late.lost) == (0, -1)


def test_delay_does_not_jump_where_the_reference_time_wraps() -> None:
    sent, one = SentPackets(), struct.pack("!H", 1 << 13 | 1)
    last = ((1 << 24) - 1) * 64 // 1000
    delays = []
    for number, seconds in enumerate((last, 0)):
        sent.add(number, 100.0 + number)
        report = sent.deliveries(feedback(number, 1, one, b"\x00", seconds=seconds))
        delays += [delivery.delay for delivery in report]
    assert abs(delays[1] - delays[0]) < 2.0


@examples(100, thorough=2000)
@given(st.binary(max_size=200), st.binary(max_size=60))
def test_any_bytes_are_read_without_an_error(data: bytes, rest: bytes) -> None:
    sent = SentPackets()
    list(sent.deliveries(data))
    list(sent.deliveries(struct.pack("!BBH", 0x8F, 205, len(rest) // 4) + rest))
