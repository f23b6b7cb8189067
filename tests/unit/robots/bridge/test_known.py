"""What a web process knows of a robot."""

import pytest
from hypothesis import given, strategies as st

from robots.api import codec, messages as m, topics
from robots.bridge.broker_address import BadAddress, BrokerAddress, parse
from robots.bridge.delivery import Delivery
from robots.bridge.known import DOUBT_SECONDS, KnownRobot
from tests.support import words
from tests.support.examples import examples


def lease(**changes):
    return words.lease(**{"epoch": 3, "stamp": 10.0, **changes})


@pytest.fixture
def known():
    return KnownRobot("giraff")


def test_the_will_of_an_earlier_boot_is_ignored(known):
    known.take("connection", words.online("b1"), 0.0)
    known.take("connection", words.online("b2"), 1.0)
    assert not known.take("connection", words.broken("b1"), 5.0)
    assert known.online


def beat(n):
    return codec.encode(m.Heartbeat(n=n, stamp=float(n)))


def test_heartbeats_after_a_will_restore_the_robot_and_its_pages():
    delivery, page = Delivery(), Ear()
    delivery.listen("giraff", page, 0.0)
    known = delivery.known["giraff"]
    offline = codec.encode(words.broken())
    delivery.arrive(topics.of("giraff", "connection"), codec.encode(words.online()), 0.0)
    delivery.arrive(topics.of("giraff", "connection"), offline, 10.0)
    delivery.arrive(topics.of("giraff", "heartbeat"), beat(1), 11.0)
    assert known.online is False, "that may be the last of one that went"
    delivery.arrive(topics.of("giraff", "heartbeat"), beat(2), 10.0 + DOUBT_SECONDS)
    assert known.online
    delivery.arrive(topics.of("giraff", "heartbeat"), beat(3), 20.0)
    assert [message.state for message in page.received("connection")] == [
        "ONLINE",
        "CONNECTIONBROKEN",
        "ONLINE",
    ]
    delivery.arrive(topics.of("giraff", "connection"), offline, 30.0)
    assert known.online is False


def test_silence_counts_only_after_the_robot_was_asked_for_heartbeats(known):
    known.take("connection", words.online(), 0.0)
    assert not known.is_silent(29.0, 1.2)
    known.needed_since = 29.0
    assert not known.is_silent(30.0, 1.2)
    assert known.is_silent(30.5, 1.2)


class Ear:
    def __init__(self):
        self.messages = []

    def handle_message(self, inbound):
        self.messages.append(inbound)

    def received(self, suffix):
        return [inbound.message for inbound in self.messages if inbound.suffix == suffix]


def test_a_robot_gets_a_heartbeat_each_second_while_a_page_needs_it():
    delivery, page, display = Delivery(), Ear(), Ear()
    delivery.listen("giraff", display, 0.0, needs=False)
    assert delivery.beats_due(5.0) == []
    delivery.listen("giraff", page, 10.0)
    assert delivery.beats_due(10.0) == [("giraff", 0)]
    assert delivery.beats_due(10.9) == []
    assert delivery.beats_due(11.0) == [("giraff", 1)]
    delivery.beat_again()
    assert delivery.beats_due(11.1) == [("giraff", 0)]
    delivery.ignore("giraff", page)
    assert delivery.beats_due(20.0) == []
    assert not delivery.known["giraff"].is_silent(100.0, 1.2)


def test_a_lease_is_in_force_while_it_is_renewed(known):
    known.take("lease", lease(), 100.0)
    assert known.lease_at(109.9) == lease()
    assert known.lease_at(110.0) is None
    known.take("lease", lease(renewal=1), 109.0)
    assert known.lease_at(118.0) == lease(renewal=1)


def test_late_copies_change_nothing(known):
    known.take("lease", lease(epoch=5, renewal=4, stamp=50.0), 0.0)
    assert not known.take("lease", lease(epoch=5, renewal=3, stamp=49.0), 1.0)
    assert not known.take("lease", lease(epoch=4, renewal=9, stamp=40.0), 1.0)
    known.take("lease", None, 2.0)
    assert not known.take("lease", lease(epoch=4, renewal=9, stamp=40.0), 100.0)
    assert known.lease is None


def test_a_lower_epoch_is_accepted_after_the_lease_has_ended(known):
    known.take("lease", lease(epoch=50, stamp=10.0), 0.0)
    assert not known.take("lease", lease(epoch=1, stamp=20.0), 5.0)
    assert known.take("lease", lease(epoch=1, stamp=20.0), 11.0)


def test_a_lease_of_the_database_overrides_every_message(known):
    known.take("lease", lease(epoch=50, stamp=10.0), 0.0)
    assert known.take_lease(lease(epoch=2, stamp=5.0), 1.0, certain=True)
    assert known.lease.epoch == 2


@examples(100, thorough=3000)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=20))
def test_the_newest_lease_counts_in_any_order_of_arrival(arrivals):
    known = KnownRobot("giraff")
    for epoch, renewal in arrivals:
        known.take("lease", lease(epoch=epoch, renewal=renewal), 0.0)
    assert (known.lease.epoch, known.lease.renewal) == max(arrivals)


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("mqtt://127.0.0.1", BrokerAddress("127.0.0.1", 1883)),
        ("mqtts://broker.example.org:9999", BrokerAddress("broker.example.org", 9999, tls=True)),
        ("ws://h", BrokerAddress("h", 80, websocket=True, path="/mqtt")),
        ("wss://h/bus", BrokerAddress("h", 443, tls=True, websocket=True, path="/bus")),
        ("mqtt://me:p%40ss@h:1", BrokerAddress("h", 1, username="me", password="p@ss")),
        ("mqtt://[::1]:1884", BrokerAddress("::1", 1884)),
    ],
)
def test_an_address_has_host_port_protocol_and_credentials(url, address):
    assert parse(url) == address


@pytest.mark.parametrize(
    "url", ["", "127.0.0.1:1883", "http://h", "mqtt://", "mqtt://h:99999", "mqtt://h:x"]
)
def test_an_address_that_cannot_be_used_is_named(url):
    with pytest.raises(BadAddress, match="broker's address"):
        parse(url)
