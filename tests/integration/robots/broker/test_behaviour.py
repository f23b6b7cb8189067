"""What the rest of the system requires from a broker, the same for all brokers."""

import asyncio
import contextlib
import random

import aiomqtt
import pytest

from robots.api.topics import of, session_notices
from robots.broker.permissions import MAX_PACKET
from tests.support.patience import patient
from tests.support.sessions.broker_rig import (
    ACCEPTED,
    BAD_PASSWORD,
    NOT_AUTHORIZED,
    RawClient,
    connect_packet,
    framed,
    subscribe_packet,
    text,
    until_thrown_out,
)

pytestmark = pytest.mark.broker
EVERYTHING, NOTICES = "telepresence/v1/#", session_notices("s1")
STATE, LEASE, ACTION = (of("giraff", suffix) for suffix in ("state", "lease", "command/action"))
VELOCITY, CONNECTION = of("giraff", "command/velocity"), of("giraff", "connection")
PING, PONG = b"\xc0\x00", b"\xd0\x00"
PERSISTENT = {"client_id": "the-recorder", "clean_session": False}


async def connected(rig, user, **options):
    """Return a RawClient that the broker has accepted; the robot is added if it is new."""
    if user not in rig.tokens:
        await rig.robot(user)
    raw = await RawClient.open(rig.port)
    assert await raw.connect(user, rig.tokens[user], **options) == ACCEPTED
    return raw


# --- authentication -------------------------------------------------------------------------------


async def test_a_robot_that_is_added_connects_with_its_own_token_alone(rig):
    assert not await rig.is_let_in("giraff", "anything")
    await rig.robot("giraff")
    await rig.robot("rhodon")
    assert await rig.is_let_in("giraff")
    assert not await rig.is_let_in("giraff", "wrong")
    assert not await rig.is_let_in("unknown", rig.tokens["giraff"])
    assert not await rig.is_let_in("giraff", rig.tokens["rhodon"])


async def test_a_client_without_a_user_name_is_refused(rig):
    raw = await RawClient.open(rig.port)
    raw.send(connect_packet("anonymous"))
    answer = await raw.read(4)
    assert answer is not None
    assert answer[3] in {BAD_PASSWORD, NOT_AUTHORIZED}
    assert await raw.is_hung_up()


async def test_a_new_token_replaces_the_old_one(rig):
    raw = await connected(rig, "giraff")
    old = rig.tokens["giraff"]
    await rig.robot("giraff")
    assert await rig.is_let_in("giraff")
    assert not await rig.is_let_in("giraff", old)
    # Mosquitto checks passwords only when a client connects
    if rig.kind == "nats":
        assert await raw.is_hung_up()


async def test_a_revoked_robot_is_disconnected_and_refused_and_no_other_is(rig):
    revoked = await connected(rig, "giraff")
    await rig.robot("rhodon")
    async with rig.receiver("web", "telepresence/v1/+/state") as web, rig.client("rhodon") as other:
        rig.revoke("giraff")
        assert await revoked.is_hung_up()
        assert not await rig.is_let_in("giraff")
        await other.publish(of("rhodon", "state"), b"still here", qos=1)
        await web.payload(of("rhodon", "state"), b"still here")


# --- permissions ----------------------------------------------------------------------------------


async def test_a_robots_outputs_reach_servers_and_their_commands_reach_the_robot(rig):
    await rig.robot("giraff")
    async with (
        rig.receiver("web", "telepresence/v1/+/#") as web,
        rig.receiver("giraff", of("giraff", "signal/+")) as giraff,
    ):
        await giraff.subscribe(VELOCITY, qos=0)
        await giraff.publish(of("giraff", "signal/p1/reply"), b"answer", qos=1)
        await web.publish(of("giraff", "signal/p1"), b"offer", qos=1)
        await web.publish(VELOCITY, b"go")
        await web.payload(of("giraff", "signal/p1/reply"), b"answer")
        await giraff.payload(of("giraff", "signal/p1"), b"offer")
        await giraff.payload(VELOCITY, b"go")


@pytest.mark.parametrize(
    "topic",
    [
        of("rhodon", "state"),
        LEASE,
        VELOCITY,
        of("giraff", "signal/p1"),
        NOTICES,
        of("giraff", "state/more"),
        "telepresence/v1/giraff",
        "somewhere/else",
        of("rhodon", "connection"),
    ],
)
async def test_a_robot_publishes_only_its_outputs_also_as_retained(rig, topic):
    await rig.robot("giraff")
    async with rig.receiver("web", EVERYTHING) as web:
        for qos in (0, 1):
            await publish_forbidden(rig, "giraff", topic, qos)
        async with rig.client("giraff") as giraff:
            await giraff.publish(STATE, b"true", qos=1)
        await web.payload(STATE, b"true")
        assert web.payloads(topic) == []
    async with rig.receiver("web", EVERYTHING) as later:
        await later.publish(session_notices("s2"), b"end", qos=1)
        await later.payload(session_notices("s2"), b"end")
        assert later.payloads(topic) == []


async def publish_forbidden(rig, user, topic, qos):
    """Publish a forbidden message and wait until the broker has handled it: Mosquitto 2.0.11
    disconnects a client for QoS 1, and drops QoS 0.
    """
    raw = await connected(rig, user, client_id=f"forger-{qos}")
    raw.send(framed(0x31 | qos << 1, text(topic) + (b"\x00\x01" if qos else b"") + b"forged"))
    raw.send(PING)
    while (packet := await raw.packet()) is not None and packet != (0xD0, b""):
        pass
    raw.abort()


@pytest.mark.parametrize(
    "filter_",
    [
        "#",
        "+/#",
        "telepresence/#",
        EVERYTHING,
        "telepresence/v1/+/lease",
        of("rhodon", "lease"),
        "$SYS/#",
    ],
)
async def test_a_robot_receives_only_its_inputs_for_any_subscription(rig, filter_):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    async with rig.client("web") as web, rig.receiver("giraff") as giraff:
        await web.publish(of("rhodon", "lease"), b"retained secret", qos=1, retain=True)
        with contextlib.suppress(aiomqtt.MqttError):
            # Mosquitto accepts any filter, and delivers only permitted messages
            assert await giraff.subscribe(filter_, qos=1)
        await giraff.subscribe(ACTION, qos=1)
        await web.publish(of("rhodon", "lease"), b"secret", qos=1)
        await web.publish(of("rhodon", "command/velocity"), b"secret")
        await web.publish(NOTICES, b"secret", qos=1)
        await web.publish(ACTION, b"mine", qos=1)
        await giraff.payload(ACTION, b"mine")
        assert {str(message.topic) for message in giraff.messages} == {ACTION}


async def test_a_server_cannot_publish_a_robots_outputs(rig):
    async with rig.receiver("web", EVERYTHING) as web:
        for qos in (0, 1):
            await publish_forbidden(rig, "web", STATE, qos)
        await web.publish(LEASE, b"granted", qos=1)
        await web.payload(LEASE, b"granted")
        assert web.payloads(STATE) == []


async def test_a_robots_images_reach_servers_and_requests_for_them_this_robot_alone(rig):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    image, request = of("giraff", "picture"), of("giraff", "command/picture")
    async with (
        rig.receiver("web", image, qos=0) as web,
        rig.receiver("giraff", request, qos=0) as giraff,
    ):
        with contextlib.suppress(aiomqtt.MqttError):
            async with rig.client("rhodon") as rhodon:
                await rhodon.subscribe(image)
        for topic in (image, request):
            await publish_forbidden(rig, "rhodon", topic, 0)
        await giraff.publish(image, b"an image")
        await web.publish(request, b"one more")
        await web.payload(image, b"an image")
        await giraff.payload(request, b"one more")
    assert web.payloads(image) == [b"an image"]
    assert giraff.payloads(request) == [b"one more"]


# --- retained messages ----------------------------------------------------------------------------


async def test_only_later_subscribers_receive_a_message_as_retained(rig):
    async with rig.receiver("web", LEASE) as earlier:
        await earlier.publish(LEASE, b"lease", qos=1, retain=True)
        assert not (await earlier.payload(LEASE, b"lease")).retain
        async with rig.receiver("web", LEASE) as later:
            assert (await later.payload(LEASE, b"lease")).retain


async def test_the_newest_retained_message_replaces_the_others(rig):
    async with rig.client("web") as web:
        for payload in (b"one", b"two"):
            await web.publish(LEASE, payload, qos=1, retain=True)
        async with rig.receiver("web", "telepresence/v1/+/lease") as later:
            await later.payload(LEASE, b"two")
            assert later.payloads(LEASE) == [b"two"]


async def test_an_empty_retained_message_is_delivered_and_deletes_the_retained_one(rig):
    async with rig.receiver("web", LEASE) as web:
        await web.publish(LEASE, b"lease", qos=1, retain=True)
        await web.publish(LEASE, b"", qos=1, retain=True)
        await web.payload(LEASE, b"")
        async with rig.receiver("web", EVERYTHING) as later:
            await web.publish(NOTICES, b"end", qos=1)
            await later.payload(NOTICES, b"end")
            assert later.payloads(LEASE) == []


async def test_a_client_that_resumes_a_session_gets_no_retained_message_of_others(rig):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    async with rig.receiver("web", EVERYTHING) as web:
        await web.publish(of("rhodon", "lease"), b"secret", qos=1, retain=True)
        for _ in range(2):
            options = {"client_id": "giraff-1", "clean_session": False}
            async with rig.receiver("giraff", ACTION, **options) as giraff:
                await web.publish(ACTION, b"mine", qos=1)
                await giraff.payload(ACTION, b"mine")
                assert giraff.payloads(of("rhodon", "lease")) == []


# --- quality of service ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("published", "subscribed", "delivered"),
    [(0, 1, 0), (1, 0, 0), (1, 1, 1), (0, 0, 0), (2, 1, 1)],
)
async def test_a_message_is_delivered_with_the_lower_quality_of_service(
    rig, published, subscribed, delivered
):
    async with rig.receiver("web", LEASE, qos=subscribed) as web:
        await web.publish(LEASE, b"lease", qos=published)
        assert (await web.payload(LEASE, b"lease")).qos == delivered
        assert len(web.messages) == 1


@pytest.mark.parametrize("qos", [0, 1])
async def test_messages_of_one_sender_arrive_in_order(rig, qos):
    count = 500
    async with rig.client("web") as sender, rig.receiver("web", VELOCITY, qos=qos) as receiver:
        for number in range(count):
            await sender.publish(VELOCITY, str(number).encode(), qos=qos)
        await receiver.until_received(count)
        assert [int(payload) for payload in receiver.payloads(VELOCITY)] == list(range(count))


async def test_an_unsubscribed_topic_is_not_delivered(rig):
    async with rig.receiver("web", LEASE, NOTICES) as web:
        await web.client.unsubscribe(LEASE)
        await web.publish(LEASE, b"lease", qos=1)
        await web.publish(NOTICES, b"end", qos=1)
        await web.payload(NOTICES, b"end")
        assert web.payloads(LEASE) == []


# --- wills ----------------------------------------------------------------------------------------

WILL = (CONNECTION, "broken", 1, True)


async def test_the_will_of_a_robot_whose_connection_breaks_is_published_and_retained(rig):
    async with rig.receiver("web", CONNECTION) as web:
        (await connected(rig, "giraff", will=WILL)).abort()
        await web.payload(CONNECTION, b"broken")
    async with rig.receiver("web", CONNECTION) as later:
        assert (await later.payload(CONNECTION, b"broken")).retain


@pytest.mark.nightly
async def test_the_will_of_a_silent_robot_is_published_after_its_keep_alive(rig):
    async with rig.receiver("web", CONNECTION) as web:
        raw = await connected(rig, "giraff", keep_alive=1, will=WILL)
        await web.payload(CONNECTION, b"broken")
        assert await raw.is_hung_up()


async def test_a_robot_that_disconnects_in_order_leaves_no_will(rig):
    async with rig.receiver("web", "telepresence/v1/giraff/#") as web:
        raw = await connected(rig, "giraff", will=WILL)
        raw.send(framed(0xE0, b""))
        assert await raw.is_hung_up()
        async with rig.client("giraff") as giraff:
            await giraff.publish(STATE, b"back", qos=1)
            await web.payload(STATE, b"back")
        assert web.payloads(CONNECTION) == []


async def test_a_will_that_the_robot_may_not_publish_is_dropped(rig):
    await rig.robot("giraff")
    async with rig.receiver("web", EVERYTHING) as web:
        raw = await RawClient.open(rig.port)
        will = (of("rhodon", "connection"), "forged", 1, True)
        await raw.connect("giraff", rig.tokens["giraff"], will=will)
        raw.abort()
        async with rig.client("giraff") as giraff:
            await giraff.publish(STATE, b"back", qos=1)
            await web.payload(STATE, b"back")
        assert web.payloads(of("rhodon", "connection")) == []


# --- reconnecting ---------------------------------------------------------------------------------


async def test_a_reconnecting_robot_replaces_its_old_connection_at_once(rig):
    old = await connected(rig, "giraff", client_id="giraff-agent")
    async with (
        asyncio.timeout(patient(2.0)),
        rig.receiver("giraff", ACTION, client_id="giraff-agent") as giraff,
        rig.client("web") as web,
    ):
        assert await old.is_hung_up()
        await web.publish(ACTION, b"dock", qos=1)
        await giraff.payload(ACTION, b"dock")


async def test_a_client_with_a_wrong_token_cannot_take_a_connection_over(rig):
    raw = await connected(rig, "giraff", client_id="giraff-agent")
    thief = await RawClient.open(rig.port)
    assert await thief.connect("giraff", "wrong", client_id="giraff-agent") != ACCEPTED
    raw.send(PING)
    assert await raw.read(2) == PONG


async def test_a_persistent_session_gets_missed_messages_in_order_and_not_as_retained(rig):
    await rig.robot("giraff")
    async with rig.receiver("web", "telepresence/v1/+/state", **PERSISTENT):
        pass
    async with rig.client("giraff") as giraff:
        for number in range(300):
            await giraff.publish(STATE, str(number).encode(), qos=1)
        await giraff.publish(of("giraff", "pose"), b"not subscribed", qos=0)
    async with rig.receiver("web", **PERSISTENT) as recorder:
        await recorder.until_received(300)
        assert [int(payload) for payload in recorder.payloads(STATE)] == list(range(300))
        assert not any(message.retain for message in recorder.messages)


async def test_a_persistent_session_gets_an_unacknowledged_message_again(rig):
    raw = await connected(rig, "web", client_id="the-recorder", clean=False)
    raw.send(subscribe_packet(1, (LEASE, 1)))
    assert (await raw.packet())[0] == 0x90
    async with rig.client("web") as web:
        await web.publish(LEASE, b"lease", qos=1)
    assert (await raw.packet())[0] == 0x32
    raw.abort()
    back = await RawClient.open(rig.port)
    back.send(connect_packet("the-recorder", "web", rig.tokens["web"], clean=False))
    assert await back.packet() == (0x20, b"\x01\x00")  # session present
    first, body = await back.packet()
    assert first == 0x3A  # QoS 1, duplicate
    assert body.endswith(b"lease")


async def test_a_clean_connection_deletes_the_session(rig):
    async with rig.receiver("web", LEASE, **PERSISTENT):
        pass
    clean = {"client_id": PERSISTENT["client_id"], "clean_session": True}
    async with rig.client("web", **clean):
        pass
    async with rig.receiver("web", NOTICES, **clean) as recorder, rig.client("web") as web:
        await web.publish(LEASE, b"lease", qos=1)
        await web.publish(NOTICES, b"end", qos=1)
        await recorder.payload(NOTICES, b"end")
        assert recorder.payloads(LEASE) == []


async def test_clients_reconnect_after_a_restart_of_the_broker(rig):
    await rig.robot("giraff")
    async with rig.client("web") as before:
        await before.publish(LEASE, b"old", qos=1, retain=True)
        await rig.restart()
        await until_thrown_out(before)
    async with rig.client("web") as web, rig.receiver("giraff", LEASE) as giraff:
        await web.publish(LEASE, b"new", qos=1, retain=True)
        await giraff.payload(LEASE, b"new")


# --- bad input and load ---------------------------------------------------------------------------


async def test_a_message_of_one_mebibyte_passes_and_a_larger_one_ends_the_connection(rig):
    plan, largest = of("giraff", "floorplan"), random.Random(1).randbytes(1024 * 1024)
    async with rig.receiver("web", plan) as web:
        await web.publish(plan, largest, qos=1)
        await web.payload(plan, largest)
        sender = await connected(rig, "web", client_id="large")
        sender.send(framed(0x30, text(plan) + bytes(MAX_PACKET)))
        assert await sender.is_hung_up()
        await web.publish(plan, b"small", qos=1)
        await web.payload(plan, b"small")
        assert len(web.messages) == 2


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"\x10\xff\xff\xff\xff\x7f",
        framed(0x10, text("NOPE") + b"\x04\x02\x00\x3c" + text("x")),
    ],
)
async def test_a_stranger_who_violates_the_protocol_is_disconnected(rig, data):
    raw = await RawClient.open(rig.port)
    raw.send(data)
    with contextlib.suppress(OSError):  # the broker may have closed the connection already
        raw.writer.write_eof()
    assert await raw.is_hung_up()
    assert await rig.is_let_in("web")


@pytest.mark.parametrize(
    "data",
    [
        b"\x36\x05\x00\x01a\x00\x01",
        b"\x30\x03\x00\x01#",
        b"\x30\x04\x00\x02\xff\xfe",
        b"\xf0\x00",
        b"\x30\xff\xff\xff\x7f",
        connect_packet("again", "web", "x"),
        framed(0x82, b"\x00\x01" + text("a") + b"\x03"),
    ],
)
async def test_a_user_who_violates_the_protocol_is_disconnected_and_others_are_not(rig, data):
    async with rig.receiver("web", LEASE) as web:
        raw = await connected(rig, "web", client_id="bad")
        raw.send(data)
        assert await raw.is_hung_up()
        await web.publish(LEASE, b"lease", qos=1)
        await web.payload(LEASE, b"lease")


async def test_random_bytes_of_strangers_and_users_do_not_stop_the_broker(rig):
    random_bytes = random.Random(7)
    for number in range(150):
        raw = await RawClient.open(rig.port)
        if number % 2:
            await raw.connect("web", rig.tokens["web"], client_id=f"fuzz-{number}")
        raw.send(random_bytes.randbytes(random_bytes.randrange(1, 200)))
        await raw.writer.drain()
        raw.abort()
    assert await rig.is_let_in("web")


@pytest.mark.nightly
async def test_no_message_is_lost_while_other_clients_connect_and_subscribe(rig):
    await rig.robot("giraff")
    count, rate = 400, 200  # messages, and messages a second
    loop = asyncio.get_running_loop()
    async with (
        rig.receiver("web", "telepresence/v1/+/state") as web,
        rig.client("giraff") as giraff,
    ):
        others = asyncio.create_task(connect_and_subscribe(rig))
        started = loop.time()
        for number in range(count):
            await giraff.publish(STATE, str(number).encode(), qos=1)
            await asyncio.sleep(max(0.0, started + number / rate - loop.time()))
        await web.until_received(count)
        others.cancel()
        assert [int(payload) for payload in web.payloads(STATE)] == list(range(count))


async def connect_and_subscribe(rig):
    """Subscribe at QoS 0, as agents and web processes do: while others subscribe at QoS 1, NATS
    loses messages.
    """
    while True:
        async with rig.client("web") as client:
            for number in range(5):
                wanted = f"telepresence/v1/robot-{number}/#"
                await client.subscribe([(wanted, 0), ("telepresence/v1/+/state", 0)])
                await client.unsubscribe(wanted)
