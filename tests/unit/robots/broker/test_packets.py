"""Bytes to MQTT packets: whatever comes, in whatever pieces."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.broker import packets
from robots.broker.packets import (
    Acknowledgement,
    Connect,
    Disconnect,
    PacketReader,
    PingRequest,
    ProtocolError,
    PublishPacket,
    Subscribe,
    Unsubscribe,
)
from tests.support.examples import examples
from tests.support.sessions.broker_rig import connect_packet, framed, subscribe_packet, text

LIMIT = 4096
TOPIC = st.text(
    st.characters(blacklist_characters="+#\0", blacklist_categories=["Cs"]), min_size=1, max_size=40
).filter(lambda t: t.count("/") < 32)
MESSAGE = st.builds(
    lambda topic, payload, qos, retain, packet_id, dup: PublishPacket(
        topic, payload, qos, retain, packet_id if qos else 0, dup
    ),
    TOPIC,
    st.binary(max_size=2000),
    st.integers(0, 2),
    st.booleans(),
    st.integers(1, 0xFFFF),
    st.booleans(),
)


def read(data, limit=LIMIT):
    return list(PacketReader(limit).feed(data))


@given(st.lists(MESSAGE, max_size=5), st.data())
def test_a_publish_written_and_read_in_any_pieces_is_the_same(messages, data):
    stream = b"".join(packets.publish(message) for message in messages)
    reader, found = PacketReader(LIMIT), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        found += reader.feed(stream[:size])
        stream = stream[size:]
    assert found == messages


@examples(250, thorough=10_000)
@given(st.binary(max_size=300))
def test_random_bytes_are_packets_or_a_protocol_error(data):
    try:
        read(data)
    except ProtocolError:
        return


@examples(150, thorough=5000)
@given(st.integers(1, 14), st.integers(0, 15), st.binary(max_size=60))
def test_random_bodies_are_packets_or_a_protocol_error(kind, flags, body):
    try:
        assert len(read(framed(kind << 4 | flags, body))) == 1
    except ProtocolError:
        return


def test_every_packet_of_a_client_is_read():
    assert read(
        connect_packet(
            "c1", "giraff", "token", clean=False, keep_alive=5, will=("a/b", "gone", 1, True)
        )
    ) == [
        Connect(
            "c1",
            clean=False,
            keep_alive=5,
            user="giraff",
            password="token",
            will=PublishPacket("a/b", b"gone", 1, retain=True),
        )
    ]
    assert read(connect_packet("")) == [
        Connect("", clean=True, keep_alive=60, user=None, password=None, will=None)
    ]
    assert read(subscribe_packet(7, ("a/+", 1), ("b", 0))) == [Subscribe(7, (("a/+", 1), ("b", 0)))]
    assert read(framed(0xA2, b"\x00\x07" + text("a"))) == [Unsubscribe(7, ("a",))]
    assert read(b"\x40\x02\x00\x07\xc0\x00\xe0\x00") == [
        Acknowledgement(packets.PUBACK, 7),
        PingRequest(),
        Disconnect(),
    ]
    assert read(b"\x62\x02\x00\x07") == [Acknowledgement(packets.PUBREL, 7)]


@pytest.mark.parametrize("level", [3, 5])
def test_another_version_of_mqtt_is_told_apart(level):
    with pytest.raises(packets.UnsupportedVersionError):
        read(connect_packet("c1", level=level))


def test_an_oversized_packet_is_refused_before_it_has_come():
    with pytest.raises(ProtocolError, match="bytes"):
        read(b"\x30\xff\xff\x7f")


def test_the_limit_counts_the_whole_packet():
    fits = framed(0x30, text("a") + bytes(LIMIT - 3 - 3))
    assert len(fits) == LIMIT
    assert len(read(fits)) == 1
    with pytest.raises(ProtocolError):
        read(framed(0x30, text("a") + bytes(LIMIT - 3 - 2)))


def test_what_came_whole_before_an_error_is_still_read():
    packets_read = PacketReader(LIMIT).feed(b"\xc0\x00\xf0\x00")
    assert next(packets_read) == PingRequest()
    with pytest.raises(ProtocolError):
        next(packets_read)


def test_a_will_without_its_flag_is_refused():
    with pytest.raises(ProtocolError):
        read(framed(0x10, text("MQTT") + b"\x04\x2a\x00\x3c" + text("c1")))


@given(st.data())
def test_who_reads_what_is_missing_reads_a_connect_and_nothing_behind_it(data):
    connect = connect_packet(
        data.draw(st.text("ab", max_size=40)),
        data.draw(st.sampled_from([None, "giraff"])),
        will=("a/b", "x" * 200, 1, True),
    )
    stream, reader, read_bytes = connect + b"\xc0\x00" * 50, PacketReader(LIMIT), 0
    while not reader.size:
        count = data.draw(st.integers(1, reader.missing))
        reader.add(stream[read_bytes : read_bytes + count])
        read_bytes += count
    assert read_bytes == len(connect)
    assert isinstance(reader.take(), Connect)


def test_the_shortest_connect_is_read_at_once():
    assert PacketReader(LIMIT).missing == len(connect_packet(""))


@pytest.mark.parametrize(("first", "tail"), [(0x82, b"\x01"), (0xA2, b"")])
def test_a_packet_of_endless_filters_is_refused(first, tail):
    fits = framed(first, b"\x00\x01" + (text("a") + tail) * packets.MAX_FILTERS)
    assert len(read(fits)[0].filters) == packets.MAX_FILTERS
    with pytest.raises(ProtocolError, match="filters"):
        read(framed(first, b"\x00\x01" + (text("a") + tail) * (packets.MAX_FILTERS + 1)))
