"""The embedded broker's bounds, which no client on a quiet loopback reaches."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.api.topics import SERVER, of
from robots.broker import hub as hub_module
from robots.broker import packets
from robots.broker.bounded_log import LINES_OF_SUBJECT
from robots.broker.filters import matches
from robots.broker.hub import MAX_UNRELEASED, MESSAGE_BYTES, WINDOW, Hub
from robots.broker.packets import Connect, PacketReader, PublishPacket, Subscribe
from robots.broker.permissions import (
    ROBOT_ALLOWANCE,
    SERVER_ALLOWANCE,
    BrokerUser,
    Permissions,
    of_robot,
    of_server,
)

WEB = BrokerUser("web", "hash", of_server())
GIRAFF, RHODON = (BrokerUser(name, "hash", of_robot(name)) for name in ("giraff", "rhodon"))
LEASE = of("giraff", "lease")


class MemoryLink:
    """Keeps what the hub writes."""

    def __init__(self):
        self.is_ready, self.is_kicked = True, False
        self.reader, self.heard = PacketReader(10_000_000), []

    def write(self, data):
        self.heard += [
            packet for packet in self.reader.feed(data) if isinstance(packet, PublishPacket)
        ]

    def kick(self):
        self.is_kicked = True


def join(hub, user, client_id="c", *, clean=True, will=None, now=0.0):
    link = MemoryLink()
    session, code, _ = hub.connect(
        Connect(client_id, clean, 0, user.name, "token", will), user, link, now
    )
    assert code == packets.ACCEPTED
    return session, link


def subscribe(hub, session, filter_, qos=1):
    request = Subscribe(1, ((filter_, qos),))
    codes = hub.subscribe(session, request)
    hub.send_retained(session, request, codes)
    return codes[0]


def test_a_slow_reader_loses_the_unimportant_and_keeps_the_important():
    hub = Hub()
    web, link = join(hub, WEB)
    subscribe(hub, web, "telepresence/v1/#")
    link.is_ready = False
    hub.publish(web, PublishPacket(of("giraff", "command/velocity"), b"go", qos=0))
    hub.publish(web, PublishPacket(LEASE, b"lease", qos=1, packet_id=1))
    assert link.heard == []
    link.is_ready = True
    hub.push(web)
    assert [message.payload for message in link.heard] == [b"lease"]
    assert web.dropped == 1


def test_no_more_than_a_window_is_in_flight():
    hub = Hub()
    web, link = join(hub, WEB)
    subscribe(hub, web, LEASE)
    for number in range(WINDOW + 5):
        hub.publish(web, PublishPacket(LEASE, str(number).encode(), qos=1, packet_id=1))
    assert len(link.heard) == WINDOW
    hub.acknowledge(web, link.heard[0].packet_id)
    assert len(link.heard) == WINDOW + 1
    assert [int(message.payload) for message in link.heard] == list(range(WINDOW + 1))


def bounded(**bounds):
    """A server whose sessions hold little."""
    return BrokerUser(
        "web", "hash", replace(of_server(), allowance=replace(SERVER_ALLOWANCE, **bounds))
    )


@pytest.mark.parametrize(
    "bounds", [{"queue_messages": 2}, {"queue_bytes": 3 * (MESSAGE_BYTES + len(LEASE)) + 10}]
)
def test_a_queue_that_is_full_refuses_the_newest(bounds):
    hub = Hub()
    user = bounded(**bounds)
    web, link = join(hub, user, clean=False)
    subscribe(hub, web, LEASE)
    hub.leave(web, link, graceful=True, now=0.0)
    other, _ = join(hub, user, "other")
    for payload in (b"12345", b"67890", b"abcde"):
        hub.publish(other, PublishPacket(LEASE, payload, qos=1, packet_id=1))
    back, again = join(hub, user, clean=False)
    hub.resume(back)
    assert [message.payload for message in again.heard] == [b"12345", b"67890"]


@pytest.mark.parametrize("payload", [b"", bytes(100_000)])
def test_what_a_subscriber_never_acknowledges_is_bounded_in_count_and_bytes(payload):
    hub = Hub()
    giraff, _ = join(hub, GIRAFF)
    subscribe(hub, giraff, of("giraff", "connection"))
    for _ in range(3 * ROBOT_ALLOWANCE.queue_messages):
        hub.publish(giraff, PublishPacket(of("giraff", "connection"), payload, qos=1, packet_id=1))
    held = [*giraff.queue, *giraff.inflight.values()]
    assert len(held) <= ROBOT_ALLOWANCE.queue_messages
    assert (
        giraff.held_bytes
        == sum(MESSAGE_BYTES + len(m.topic) + len(m.payload) for m in held)
        <= ROBOT_ALLOWANCE.queue_bytes
    )
    assert giraff.dropped == 3 * ROBOT_ALLOWANCE.queue_messages - len(held)


def test_who_acknowledges_is_sent_everything_and_nothing_is_held_any_more():
    hub = Hub()
    web, link = join(hub, WEB)
    subscribe(hub, web, LEASE)
    for number in range(2 * WINDOW):
        hub.publish(web, PublishPacket(LEASE, str(number).encode(), qos=1, packet_id=1))
    for number in range(2 * WINDOW):
        hub.acknowledge(web, link.heard[number].packet_id)
        hub.acknowledge(web, link.heard[number].packet_id)  # again: it counts once
    assert [int(message.payload) for message in link.heard] == list(range(2 * WINDOW))
    assert (web.held_bytes, len(web.queue), len(web.inflight)) == (0, 0, 0)


def test_a_client_that_comes_back_is_sent_again_what_it_owes_only_as_far_as_it_keeps_up():
    hub = Hub()
    web, link = join(hub, WEB, clean=False)
    subscribe(hub, web, LEASE)
    for number in range(10):
        hub.publish(web, PublishPacket(LEASE, str(number).encode(), qos=1, packet_id=1))
    hub.leave(web, link, graceful=False, now=0.0)
    first_ids = [message.packet_id for message in link.heard]
    for _ in range(2):
        back, again = join(hub, WEB, clean=False)
        again.is_ready = False
        hub.resume(back)
        assert again.heard == []
        again.is_ready = True
        hub.push(back)
        assert [
            (message.packet_id, int(message.payload), message.dup) for message in again.heard
        ] == [(packet_id, number, True) for number, packet_id in enumerate(first_ids)]
        hub.leave(back, again, graceful=False, now=0.0)


def test_who_never_releases_what_was_received_once_is_hung_up_on():
    hub = Hub()
    giraff, _ = join(hub, GIRAFF)
    for packet_id in range(1, MAX_UNRELEASED + 1):
        hub.receive_once(
            giraff, PublishPacket(of("giraff", "state"), b"", qos=2, packet_id=packet_id)
        )
    # sent again: nothing new
    hub.receive_once(giraff, PublishPacket(of("giraff", "state"), b"", qos=2, packet_id=1))
    with pytest.raises(packets.ProtocolError):
        hub.receive_once(
            giraff, PublishPacket(of("giraff", "state"), b"", qos=2, packet_id=MAX_UNRELEASED + 1)
        )


@settings(max_examples=300)
@given(
    st.lists(
        st.sampled_from(
            [
                "a",
                "b",
                "+",
                "#",
                "a/b",
                "a/+",
                "a/#",
                "+/b",
                "+/+",
                "+/#",
                "a/b/c",
                "a/+/c",
                "$x/#",
                "$x/+",
            ]
        ),
        max_size=8,
    ),
    st.lists(
        st.sampled_from(["a", "b", "a/b", "b/a", "a/b/c", "a/", "$x/a", "$x"]),
        min_size=1,
        max_size=4,
    ),
)
def test_subscriptions_and_retained_messages_are_found_as_the_filters_match(filters, topics):
    everything = BrokerUser("web", "hash", Permissions(("#",), ("#", "$x/#"), SERVER_ALLOWANCE))
    hub = Hub()
    sessions = {filter_: join(hub, everything, filter_)[0] for filter_ in filters}
    granted = {
        filter_ for filter_, session in sessions.items() if subscribe(hub, session, filter_) == 1
    }
    for topic in topics:
        hub.retained[topic] = PublishPacket(topic, b"x", retain=True)
        assert {session.client_id for session, _ in hub._route(topic)} == {
            filter_ for filter_ in granted if matches(filter_, topic)
        }
    for filter_ in granted:
        assert {m.topic for m in hub._retained_under(filter_)} == {
            topic for topic in topics if matches(filter_, topic)
        }
        hub.unsubscribe(sessions[filter_], (filter_,))
    assert not any(hub._route(topic) for topic in topics)


def test_refused_messages_leave_a_few_lines(caplog):
    hub = Hub()
    giraff, _ = join(hub, GIRAFF)
    for _ in range(1000):
        hub.publish(giraff, PublishPacket(of("rhodon", "state"), b""))
    assert len(caplog.records) == LINES_OF_SUBJECT


def test_retained_messages_are_bounded(monkeypatch):
    monkeypatch.setattr(hub_module, "MAX_RETAINED", 2)
    hub = Hub()
    web, _ = join(hub, WEB)
    for robot in ("giraff", "rhodon", "third"):
        hub.publish(web, PublishPacket(of(robot, "lease"), b"x", retain=True))
    assert len(hub.retained) == 2


def test_a_robot_retains_what_the_topic_table_says_and_nothing_else():
    hub = Hub()
    (giraff, _), (web, heard) = join(hub, GIRAFF), join(hub, WEB)
    subscribe(hub, web, "telepresence/v1/#")
    for suffix in ("signal/p1/reply", "photo/a1", "picture/p1", "state", "connection", "factsheet"):
        hub.publish(giraff, PublishPacket(of("giraff", suffix), b"x", retain=True))
    assert set(hub.retained) == {of("giraff", "connection"), of("giraff", "factsheet")}
    assert len(heard.heard) == 6  # all the same it is delivered
    hub.publish(web, PublishPacket(f"{SERVER}/news", b"x", retain=True))
    assert f"{SERVER}/news" in hub.retained


def test_left_sessions_of_one_user_are_bounded_and_expire():
    hub = Hub()
    for number in range(10):
        session, link = join(hub, GIRAFF, f"c{number}", clean=False)
        hub.leave(session, link, graceful=True, now=float(number))
    assert sorted(client_id for _, client_id in hub.sessions) == ["c6", "c7", "c8", "c9"]
    hub.expire(before=8.0)
    assert sorted(client_id for _, client_id in hub.sessions) == ["c8", "c9"]


def test_a_forgotten_session_leaves_nothing_behind():
    hub = Hub()
    web, link = join(hub, WEB)
    subscribe(hub, web, LEASE)
    hub.leave(web, link, graceful=True, now=0.0)
    assert not hub.sessions
    assert not hub._subscribers
    assert not hub._routes


def test_another_user_with_the_same_client_id_takes_over_nothing():
    hub = Hub()
    _, link = join(hub, GIRAFF, "agent")
    join(hub, RHODON, "agent")
    assert not link.is_kicked
    assert len(hub.sessions) == 2


def test_a_take_over_publishes_the_will_of_the_connection_that_goes():
    hub = Hub()
    web, heard = join(hub, WEB)
    subscribe(hub, web, of("giraff", "connection"))
    _, old = join(
        hub, GIRAFF, "agent", will=PublishPacket(of("giraff", "connection"), b"broken", qos=1)
    )
    session, _ = join(hub, GIRAFF, "agent")
    assert old.is_kicked
    assert [message.payload for message in heard.heard] == [b"broken"]
    hub.leave(session, old, graceful=False, now=1.0)  # the old socket ends later, and means nothing
    assert session.link is not None


def test_a_revoked_user_is_kicked_and_its_will_published():
    hub = Hub()
    web, heard = join(hub, WEB)
    subscribe(hub, web, of("giraff", "connection"))
    _, link = join(hub, GIRAFF, will=PublishPacket(of("giraff", "connection"), b"broken", qos=1))
    hub.set_users({"web": WEB}, now=0.0)
    assert link.is_kicked
    assert [message.payload for message in heard.heard] == [b"broken"]
    assert list(hub.sessions) == [("web", "c")]


def test_an_unnamed_client_cannot_keep_a_session():
    hub = Hub()
    session, code, _ = hub.connect(
        Connect("", clean=False, keep_alive=0, user="web", password="t", will=None),
        WEB,
        MemoryLink(),
        0.0,
    )
    assert session is None
    assert code == packets.BAD_CLIENT_ID


def test_subscriptions_of_one_session_are_bounded(monkeypatch):
    monkeypatch.setattr(hub_module, "MAX_FILTERS", 2)
    hub = Hub()
    web, _ = join(hub, WEB)
    assert [subscribe(hub, web, of(name, "state")) for name in ("a", "b", "c", "a")] == [
        1,
        1,
        packets.SUBSCRIPTION_REFUSED,
        1,
    ]
