"""The embedded broker's bounds, which no client on a quiet loopback reaches."""

import asyncio
import ssl

import pytest

from robots.api.topics import SERVER, of
from robots.broker import hub as hub_module
from robots.broker import packets
from robots.broker.embedded import CONNECT_BYTES, MAX_STRANGERS, EmbeddedBroker
from robots.broker.hub import WINDOW, Hub
from robots.broker.packets import Connect, PacketReader, Publish, Subscribe
from robots.broker.permissions import BrokerUser, of_robot, of_server
from robots.credentials import hash_token
from tests.support.broker_rig import RawClient, connect_packet, framed
from tests.support.patience import patient
from tests.support.server import certificate

WEB = BrokerUser("web", "hash", of_server())
GIRAFF, RHODON = (BrokerUser(name, "hash", of_robot(name)) for name in ("giraff", "rhodon"))
LEASE = of("giraff", "lease")


class MemoryLink:
    """Keeps what the hub writes."""

    def __init__(self):
        self.is_ready, self.is_kicked = True, False
        self.reader, self.heard = PacketReader(10_000_000), []

    def write(self, data):
        self.heard += [packet for packet in self.reader.feed(data) if isinstance(packet, Publish)]

    def kick(self):
        self.is_kicked = True


def join(hub, user, client_id="c", *, clean=True, will=None, now=0.0):
    link = MemoryLink()
    session, code, _ = hub.connect(Connect(client_id, clean, 0, user.name, "token", will), user, link, now)
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
    hub.publish(web, Publish(of("giraff", "command/velocity"), b"go", qos=0))
    hub.publish(web, Publish(LEASE, b"lease", qos=1, packet_id=1))
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
        hub.publish(web, Publish(LEASE, str(number).encode(), qos=1, packet_id=1))
    assert len(link.heard) == WINDOW
    hub.acknowledge(web, link.heard[0].packet_id)
    assert len(link.heard) == WINDOW + 1
    assert [int(message.payload) for message in link.heard] == list(range(WINDOW + 1))


def test_a_queue_that_is_full_refuses_the_newest(monkeypatch):
    monkeypatch.setattr(hub_module, "QUEUE_BYTES", 10)
    hub = Hub()
    web, link = join(hub, WEB, clean=False)
    subscribe(hub, web, LEASE)
    hub.leave(web, link, graceful=True, now=0.0)
    other, _ = join(hub, WEB, "other")
    for payload in (b"12345", b"67890", b"abcde"):
        hub.publish(other, Publish(LEASE, payload, qos=1, packet_id=1))
    back, again = join(hub, WEB, clean=False)
    hub.resume(back)
    assert [message.payload for message in again.heard] == [b"12345", b"67890"]


def test_retained_messages_are_bounded(monkeypatch):
    monkeypatch.setattr(hub_module, "MAX_RETAINED", 2)
    hub = Hub()
    web, _ = join(hub, WEB)
    for robot in ("giraff", "rhodon", "third"):
        hub.publish(web, Publish(of(robot, "lease"), b"x", retain=True))
    assert len(hub.retained) == 2


def test_a_robot_retains_what_the_topic_table_says_and_nothing_else():
    hub = Hub()
    (giraff, _), (web, heard) = join(hub, GIRAFF), join(hub, WEB)
    subscribe(hub, web, "telepresence/v1/#")
    for suffix in ("signal/p1/reply", "photo/a1", "picture/p1", "state", "connection", "factsheet"):
        hub.publish(giraff, Publish(of("giraff", suffix), b"x", retain=True))
    assert set(hub.retained) == {of("giraff", "connection"), of("giraff", "factsheet")}
    assert len(heard.heard) == 6  # all the same it is delivered
    hub.publish(web, Publish(f"{SERVER}/news", b"x", retain=True))
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
    _, old = join(hub, GIRAFF, "agent", will=Publish(of("giraff", "connection"), b"broken", qos=1))
    session, _ = join(hub, GIRAFF, "agent")
    assert old.is_kicked
    assert [message.payload for message in heard.heard] == [b"broken"]
    hub.leave(session, old, graceful=False, now=1.0)  # the old socket ends later, and means nothing
    assert session.link is not None


def test_a_revoked_user_is_kicked_and_its_will_published():
    hub = Hub()
    web, heard = join(hub, WEB)
    subscribe(hub, web, of("giraff", "connection"))
    _, link = join(hub, GIRAFF, will=Publish(of("giraff", "connection"), b"broken", qos=1))
    hub.set_users({"web": WEB}, now=0.0)
    assert link.is_kicked
    assert [message.payload for message in heard.heard] == [b"broken"]
    assert list(hub.sessions) == [("web", "c")]


def test_an_unnamed_client_cannot_keep_a_session():
    hub = Hub()
    session, code, _ = hub.connect(Connect("", clean=False, keep_alive=0, user="web", password="t", will=None), WEB, MemoryLink(), 0.0)
    assert session is None
    assert code == packets.BAD_CLIENT_ID


def test_subscriptions_of_one_session_are_bounded(monkeypatch):
    monkeypatch.setattr(hub_module, "MAX_FILTERS", 2)
    hub = Hub()
    web, _ = join(hub, WEB)
    assert [subscribe(hub, web, of(name, "state")) for name in ("a", "b", "c", "a")] == [1, 1, packets.SUBSCRIPTION_REFUSED, 1]


# --- sockets ----------------------------------------------------------------------------------------------------------


@pytest.fixture(params=["plain", "tls"])
async def door(request, tmp_path, monkeypatch):
    """Yield (what opens a connection to a running broker, the addresses of strangers as it counts them); `web` has the token `token`."""
    monkeypatch.setattr("robots.broker.embedded.CONNECT_SECONDS", 600.0)  # on a busy computer nobody goes by themselves meanwhile
    users = {"web": BrokerUser("web", hash_token("token"), of_server())}

    async def read():
        return users

    serving = asking = None
    if request.param == "tls":
        key, chain = certificate(tmp_path)
        serving, asking = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH), ssl.create_default_context(cafile=str(chain))
        serving.load_cert_chain(chain, key)
    broker = EmbeddedBroker(read)
    port = await broker.start("127.0.0.1", 0, serving)

    async def enter():
        return RawClient(*await asyncio.open_connection("127.0.0.1", port, ssl=asking))

    yield enter, broker._strangers
    await broker.stop()


async def test_an_address_holds_so_many_places_before_it_says_who_it_is_and_whoever_was_let_in_counts_no_more(door):
    enter, strangers = door
    known = [await enter() for _ in range(3)]
    assert [await client.connect("web", "token", client_id=f"c{n}") for n, client in enumerate(known)] == [packets.ACCEPTED] * 3
    assert not strangers
    silent = [await enter() for _ in range(MAX_STRANGERS)]
    assert await (await enter()).is_hung_up()
    assert strangers == {"127.0.0.1": MAX_STRANGERS}
    known[0].send(b"\xc0\x00")
    assert await known[0].packet() == (0xD0, b""), "it is still served"
    for client in silent:
        client.abort()
    async with asyncio.timeout(patient(10)):
        while strangers:
            await asyncio.sleep(0.01)
    again = await enter()
    assert await again.connect("web", "token") == packets.ACCEPTED


async def test_nothing_long_is_kept_of_a_packet_before_its_sender_is_let_in(door):
    enter, _ = door
    stranger, friend = await enter(), await enter()
    stranger.send(connect_packet("long", "web", b"x" * 0xFFFF)[: CONNECT_BYTES // 2])
    assert await stranger.is_hung_up()
    assert await friend.connect("web", "token") == packets.ACCEPTED
    friend.send(framed(0x32, len(LEASE).to_bytes(2, "big") + LEASE.encode() + b"\x00\x07" + bytes(2 * CONNECT_BYTES)))
    assert await friend.packet() == (0x40, b"\x00\x07")
