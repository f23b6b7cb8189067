"""What the rest of the system relies on in a broker, the same for both."""

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
    ReceivedPacket,
    connect_packet,
    framed,
    subscribe_packet,
    text,
    until_thrown_out,
)

pytestmark = pytest.mark.broker
GIRAFF_STATE, GIRAFF_LEASE = of("giraff", "state"), of("giraff", "lease")


# --- who may come in ------------------------------------------------------------------------------


async def test_the_right_token_is_let_in(rig):
    await rig.robot("giraff")
    assert await rig.is_let_in("giraff")


async def test_a_wrong_token_an_unknown_user_and_another_robots_token_are_refused(rig):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    assert not await rig.is_let_in("giraff", "wrong")
    assert not await rig.is_let_in("nobody", rig.tokens["giraff"])
    assert not await rig.is_let_in("giraff", rig.tokens["rhodon"])


async def test_somebody_without_a_name_is_refused(rig):
    raw = await RawClient.open(rig.port)
    raw.send(connect_packet("anonymous"))
    answer = await raw.read(4)
    assert answer is not None
    assert answer[3] in {BAD_PASSWORD, NOT_AUTHORIZED}
    assert await raw.is_hung_up()


async def test_a_robot_made_while_the_broker_runs_is_let_in(rig):
    assert not await rig.is_let_in("giraff", "anything")
    await rig.robot("giraff")
    assert await rig.is_let_in("giraff")


async def test_a_revoked_robot_is_disconnected_at_once_and_not_let_in_again(rig):
    await rig.robot("giraff")
    raw = await RawClient.open(rig.port)
    assert await raw.connect("giraff", rig.tokens["giraff"]) == ACCEPTED
    rig.revoke("giraff")
    assert await raw.is_hung_up()
    assert not await rig.is_let_in("giraff")


async def test_a_new_token_throws_out_who_holds_the_old_one(rig):
    await rig.robot("giraff")
    old = rig.tokens["giraff"]
    raw = await RawClient.open(rig.port)
    assert await raw.connect("giraff", old) == ACCEPTED
    await rig.robot("giraff")
    assert await rig.is_let_in("giraff")
    assert not await rig.is_let_in("giraff", old)
    # Mosquitto asks for the password again only when the connection is made anew
    if rig.kind == "nats":
        assert await raw.is_hung_up()


async def test_revoking_one_robot_leaves_the_others_connected(rig):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    async with (
        rig.client("web") as web,
        rig.client("rhodon") as rhodon,
        ReceivedPacket(web) as heard,
    ):
        await web.subscribe("telepresence/v1/+/state", qos=1)
        gone = await RawClient.open(rig.port)
        await gone.connect("giraff", rig.tokens["giraff"])
        rig.revoke("giraff")
        assert await gone.is_hung_up()
        await rhodon.publish(of("rhodon", "state"), b"still here", qos=1)
        await heard.payload(of("rhodon", "state"), b"still here")


# --- who may say and hear what --------------------------------------------------------------------


async def test_a_robots_outputs_reach_the_servers_and_servers_commands_reach_the_robot(rig):
    await rig.robot("giraff")
    async with (
        rig.client("web") as web,
        rig.client("giraff") as giraff,
        ReceivedPacket(web) as server,
        ReceivedPacket(giraff) as robot,
    ):
        await web.subscribe("telepresence/v1/+/#", qos=1)
        await giraff.subscribe(of("giraff", "signal/+"), qos=1)
        await giraff.subscribe(of("giraff", "command/velocity"), qos=0)
        await giraff.publish(of("giraff", "signal/p1/reply"), b"answer", qos=1)
        await web.publish(of("giraff", "signal/p1"), b"offer", qos=1)
        await web.publish(of("giraff", "command/velocity"), b"go")
        await server.payload(of("giraff", "signal/p1/reply"), b"answer")
        await robot.payload(of("giraff", "signal/p1"), b"offer")
        await robot.payload(of("giraff", "command/velocity"), b"go")


@pytest.mark.parametrize(
    "topic",
    [
        of("rhodon", "state"),
        of("giraff", "lease"),
        of("giraff", "command/velocity"),
        of("giraff", "signal/p1"),
        session_notices("s1"),
        of("giraff", "state/more"),
        "telepresence/v1/giraff",
        "somewhere/else",
        of("rhodon", "connection"),
    ],
)
async def test_what_a_robot_may_not_write_reaches_nobody(rig, topic):
    await rig.robot("giraff")
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe("telepresence/v1/#", qos=1)
        for qos in (0, 1):
            await publish_or_be_hung_up_on(rig, "giraff", topic, b"forged", qos)
        async with rig.client("giraff") as giraff:
            await giraff.publish(GIRAFF_STATE, b"true", qos=1)
        await heard.payload(GIRAFF_STATE, b"true")
        assert heard.payloads(topic) == []
    async with rig.client("web") as web, ReceivedPacket(web) as later:
        await web.subscribe("telepresence/v1/#", qos=1)
        await web.publish(session_notices("s2"), b"end", qos=1)
        await later.payload(session_notices("s2"), b"end")
        assert later.payloads(topic) == []


async def publish_or_be_hung_up_on(rig, user, topic, payload, qos):
    """Publish what is forbidden and wait until the broker has dealt with it: Mosquitto 2.0.11 hangs
    up on QoS 1, and drops QoS 0.
    """
    raw = await RawClient.open(rig.port)
    await raw.connect(user, rig.tokens[user], client_id=f"forger-{qos}")
    raw.send(framed(0x31 | qos << 1, text(topic) + (b"\x00\x01" if qos else b"") + payload))
    raw.send(b"\xc0\x00")
    while (packet := await raw.packet()) is not None and packet != (0xD0, b""):
        pass
    raw.abort()


@pytest.mark.parametrize(
    "filter_",
    [
        "#",
        "+/#",
        "telepresence/#",
        "telepresence/v1/#",
        "telepresence/v1/+/lease",
        of("rhodon", "lease"),
        "$SYS/#",
    ],
)
async def test_a_robot_hears_nothing_of_others_whatever_it_subscribes_to(rig, filter_):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    async with rig.client("web") as web, rig.client("giraff") as giraff:
        await web.publish(of("rhodon", "lease"), b"kept secret", qos=1, retain=True)
        async with ReceivedPacket(giraff) as heard:
            await subscribe_or_be_refused(giraff, filter_)
            await giraff.subscribe(of("giraff", "command/action"), qos=1)
            await web.publish(of("rhodon", "lease"), b"told secret", qos=1)
            await web.publish(of("rhodon", "command/velocity"), b"secret")
            await web.publish(session_notices("s1"), b"secret", qos=1)
            await web.publish(of("giraff", "command/action"), b"mine", qos=1)
            await heard.payload(of("giraff", "command/action"), b"mine")
            assert {str(message.topic) for message in heard.messages} == {
                of("giraff", "command/action")
            }


async def subscribe_or_be_refused(client, filter_):
    try:
        codes = await client.subscribe(filter_, qos=1)
    except aiomqtt.MqttError:
        return
    assert codes  # Mosquitto grants anything and delivers what is permitted


async def test_a_server_may_not_speak_for_a_robot(rig):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe("telepresence/v1/#", qos=1)
        for qos in (0, 1):
            await publish_or_be_hung_up_on(rig, "web", GIRAFF_STATE, b"forged", qos)
        await web.publish(GIRAFF_LEASE, b"granted", qos=1)
        await heard.payload(GIRAFF_LEASE, b"granted")
        assert heard.payloads(GIRAFF_STATE) == []


# --- retained messages ----------------------------------------------------------------------------


async def test_a_retained_message_comes_with_retain_to_a_new_subscriber_and_without_to_an_old_one(
    rig,
):
    async with rig.client("web") as old, ReceivedPacket(old) as live:
        await old.subscribe(GIRAFF_LEASE, qos=1)
        await old.publish(GIRAFF_LEASE, b"lease", qos=1, retain=True)
        assert not (await live.payload(GIRAFF_LEASE, b"lease")).retain
        async with rig.client("web") as new, ReceivedPacket(new) as stored:
            await new.subscribe(GIRAFF_LEASE, qos=1)
            assert (await stored.payload(GIRAFF_LEASE, b"lease")).retain


async def test_only_the_newest_retained_message_is_kept(rig):
    async with rig.client("web") as web:
        for payload in (b"one", b"two"):
            await web.publish(GIRAFF_LEASE, payload, qos=1, retain=True)
        async with rig.client("web") as new, ReceivedPacket(new) as stored:
            await new.subscribe("telepresence/v1/+/lease", qos=1)
            await stored.payload(GIRAFF_LEASE, b"two")
            assert stored.payloads(GIRAFF_LEASE) == [b"two"]


async def test_an_empty_retained_message_deletes_what_was_kept_and_is_itself_delivered(rig):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(GIRAFF_LEASE, qos=1)
        await web.publish(GIRAFF_LEASE, b"lease", qos=1, retain=True)
        await web.publish(GIRAFF_LEASE, b"", qos=1, retain=True)
        await heard.payload(GIRAFF_LEASE, b"")
        async with rig.client("web") as new, ReceivedPacket(new) as stored:
            await new.subscribe("telepresence/v1/#", qos=1)
            await web.publish(session_notices("s1"), b"end", qos=1)
            await stored.payload(session_notices("s1"), b"end")
            assert stored.payloads(GIRAFF_LEASE) == []


async def test_a_client_that_comes_back_with_a_session_gets_no_retained_message_of_others(rig):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    async with rig.client("web") as web:
        await web.subscribe("telepresence/v1/#", qos=1)
        await web.publish(of("rhodon", "lease"), b"secret", qos=1, retain=True)
        for _ in range(2):
            async with (
                rig.client("giraff", client_id="giraff-1", clean_session=False) as giraff,
                ReceivedPacket(giraff) as heard,
            ):
                await giraff.subscribe(of("giraff", "command/action"), qos=1)
                await web.publish(of("giraff", "command/action"), b"mine", qos=1)
                await heard.payload(of("giraff", "command/action"), b"mine")
                assert heard.payloads(of("rhodon", "lease")) == []


# --- quality of service ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("published", "subscribed", "delivered"),
    [(0, 1, 0), (1, 0, 0), (1, 1, 1), (0, 0, 0), (2, 1, 1)],
)
async def test_a_message_is_delivered_with_the_lesser_quality_of_service(
    rig, published, subscribed, delivered
):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(GIRAFF_LEASE, qos=subscribed)
        await web.publish(GIRAFF_LEASE, b"lease", qos=published)
        assert (await heard.payload(GIRAFF_LEASE, b"lease")).qos == delivered
        assert len(heard.messages) == 1


async def test_subscribing_again_changes_the_quality_of_service(rig):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(GIRAFF_LEASE, qos=0)
        await web.subscribe(GIRAFF_LEASE, qos=1)
        await web.publish(GIRAFF_LEASE, b"lease", qos=1)
        assert (await heard.payload(GIRAFF_LEASE, b"lease")).qos == 1


async def test_overlapping_subscriptions_deliver_a_message_once(rig):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe([("telepresence/v1/#", 0), (GIRAFF_LEASE, 1)])
        await web.publish(GIRAFF_LEASE, b"lease", qos=1)
        await web.publish(session_notices("s1"), b"end", qos=1)
        await heard.payload(session_notices("s1"), b"end")
        assert heard.payloads(GIRAFF_LEASE) == [b"lease"]


@pytest.mark.parametrize("qos", [0, 1])
async def test_messages_of_one_sender_arrive_in_their_order(rig, qos):
    count = 500
    async with (
        rig.client("web") as sender,
        rig.client("web") as receiver,
        ReceivedPacket(receiver) as heard,
    ):
        await receiver.subscribe(of("giraff", "command/velocity"), qos=qos)
        for number in range(count):
            await sender.publish(of("giraff", "command/velocity"), str(number).encode(), qos=qos)
        await heard.until(lambda h: len(h.messages) >= count)
        assert [
            int(payload) for payload in heard.payloads(of("giraff", "command/velocity"))
        ] == list(range(count))


async def test_nothing_comes_after_unsubscribing(rig):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe([(GIRAFF_LEASE, 1), (session_notices("s1"), 1)])
        await web.unsubscribe(GIRAFF_LEASE)
        await web.publish(GIRAFF_LEASE, b"lease", qos=1)
        await web.publish(session_notices("s1"), b"end", qos=1)
        await heard.payload(session_notices("s1"), b"end")
        assert heard.payloads(GIRAFF_LEASE) == []


# --- wills ----------------------------------------------------------------------------------------


async def test_the_will_of_a_robot_that_vanishes_is_published_and_kept(rig):
    await rig.robot("giraff")
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(of("giraff", "connection"), qos=1)
        raw = await RawClient.open(rig.port)
        assert (
            await raw.connect(
                "giraff", rig.tokens["giraff"], will=(of("giraff", "connection"), "broken", 1, True)
            )
            == ACCEPTED
        )
        raw.abort()
        await heard.payload(of("giraff", "connection"), b"broken")
    async with rig.client("web") as web, ReceivedPacket(web) as later:
        await web.subscribe(of("giraff", "connection"), qos=1)
        assert (await later.payload(of("giraff", "connection"), b"broken")).retain


@pytest.mark.nightly
async def test_the_will_of_a_robot_that_falls_silent_is_published_after_its_keep_alive(rig):
    await rig.robot("giraff")
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(of("giraff", "connection"), qos=1)
        raw = await RawClient.open(rig.port)
        await raw.connect(
            "giraff",
            rig.tokens["giraff"],
            keep_alive=1,
            will=(of("giraff", "connection"), "broken", 1, True),
        )
        await heard.payload(of("giraff", "connection"), b"broken")
        assert await raw.is_hung_up()


async def test_a_robot_that_says_good_bye_leaves_no_will(rig):
    await rig.robot("giraff")
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe("telepresence/v1/giraff/#", qos=1)
        raw = await RawClient.open(rig.port)
        await raw.connect(
            "giraff", rig.tokens["giraff"], will=(of("giraff", "connection"), "broken", 1, True)
        )
        raw.send(framed(0xE0, b""))
        assert await raw.is_hung_up()
        async with rig.client("giraff") as giraff:
            await giraff.publish(GIRAFF_STATE, b"back", qos=1)
            await heard.payload(GIRAFF_STATE, b"back")
        assert heard.payloads(of("giraff", "connection")) == []


async def test_a_will_past_the_permissions_is_never_published(rig):
    await rig.robot("giraff")
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe("telepresence/v1/#", qos=1)
        raw = await RawClient.open(rig.port)
        await raw.connect(
            "giraff", rig.tokens["giraff"], will=(of("rhodon", "connection"), "forged", 1, True)
        )
        raw.abort()
        async with rig.client("giraff") as giraff:
            await giraff.publish(GIRAFF_STATE, b"back", qos=1)
            await heard.payload(GIRAFF_STATE, b"back")
        assert heard.payloads(of("rhodon", "connection")) == []


# --- coming back ----------------------------------------------------------------------------------


async def test_a_reconnecting_robot_gets_in_at_once_while_its_old_connection_lingers(rig):
    await rig.robot("giraff")
    old = await RawClient.open(rig.port)
    assert await old.connect("giraff", rig.tokens["giraff"], client_id="giraff-agent") == ACCEPTED
    async with (
        asyncio.timeout(patient(2.0)),
        rig.client("giraff", client_id="giraff-agent") as giraff,
        ReceivedPacket(giraff) as heard,
        rig.client("web") as web,
    ):
        await giraff.subscribe(of("giraff", "command/action"), qos=1)
        assert await old.is_hung_up()
        await web.publish(of("giraff", "command/action"), b"dock", qos=1)
        await heard.payload(of("giraff", "command/action"), b"dock")


async def test_twenty_reconnections_in_a_row_get_in(rig):
    await rig.robot("giraff")
    lingering = []
    for _ in range(20):
        raw = await RawClient.open(rig.port)
        assert (
            await raw.connect("giraff", rig.tokens["giraff"], client_id="giraff-agent") == ACCEPTED
        )
        lingering.append(raw)
    for raw in lingering[:-1]:
        assert await raw.is_hung_up()
    lingering[-1].send(b"\xc0\x00")
    assert await lingering[-1].read(2) == b"\xd0\x00"


async def test_somebody_without_the_token_takes_over_nothing(rig):
    await rig.robot("giraff")
    raw = await RawClient.open(rig.port)
    await raw.connect("giraff", rig.tokens["giraff"], client_id="giraff-agent")
    thief = await RawClient.open(rig.port)
    assert await thief.connect("giraff", "wrong", client_id="giraff-agent") != ACCEPTED
    raw.send(b"\xc0\x00")
    assert await raw.read(2) == b"\xd0\x00"


async def test_a_persistent_session_gets_what_it_missed_in_order_and_not_as_retained(rig):
    await rig.robot("giraff")
    options = {"client_id": "the-recorder", "clean_session": False}
    async with rig.client("web", **options) as recorder:
        await recorder.subscribe("telepresence/v1/+/state", qos=1)
    async with rig.client("giraff") as giraff:
        for number in range(300):
            await giraff.publish(GIRAFF_STATE, str(number).encode(), qos=1)
        await giraff.publish(of("giraff", "pose"), b"not wanted", qos=0)
    async with rig.client("web", **options) as recorder, ReceivedPacket(recorder) as heard:
        await heard.until(lambda h: len(h.messages) >= 300)
        assert [int(payload) for payload in heard.payloads(GIRAFF_STATE)] == list(range(300))
        assert not any(message.retain for message in heard.messages)


async def test_what_a_persistent_session_did_not_acknowledge_is_sent_again(rig):
    options = {"client_id": "the-recorder", "clean": False}
    raw = await RawClient.open(rig.port)
    await raw.connect("web", rig.tokens["web"], **options)
    raw.send(subscribe_packet(1, (GIRAFF_LEASE, 1)))
    assert (await raw.packet())[0] == 0x90
    async with rig.client("web") as web:
        await web.publish(GIRAFF_LEASE, b"lease", qos=1)
    assert (await raw.packet())[0] == 0x32
    raw.abort()
    back = await RawClient.open(rig.port)
    back.send(connect_packet("the-recorder", "web", rig.tokens["web"], clean=False))
    assert await back.packet() == (0x20, b"\x01\x00")  # session present
    first, body = await back.packet()
    assert first == 0x3A  # QoS 1, duplicate
    assert body.endswith(b"lease")


async def test_a_clean_connection_forgets_the_session(rig):
    async with rig.client("web", client_id="the-recorder", clean_session=False) as recorder:
        await recorder.subscribe(GIRAFF_LEASE, qos=1)
    async with rig.client("web", client_id="the-recorder", clean_session=True):
        pass
    async with (
        rig.client("web", client_id="the-recorder", clean_session=True) as recorder,
        ReceivedPacket(recorder) as heard,
        rig.client("web") as web,
    ):
        await recorder.subscribe(session_notices("s1"), qos=1)
        await web.publish(GIRAFF_LEASE, b"lease", qos=1)
        await web.publish(session_notices("s1"), b"end", qos=1)
        await heard.payload(session_notices("s1"), b"end")
        assert heard.payloads(GIRAFF_LEASE) == []


async def test_clients_come_back_after_a_restart_of_the_broker(rig):
    await rig.robot("giraff")
    async with rig.client("web") as before:
        await before.publish(GIRAFF_LEASE, b"old", qos=1, retain=True)
        await rig.restart()
        await until_thrown_out(before)
    async with (
        rig.client("web") as web,
        rig.client("giraff") as giraff,
        ReceivedPacket(giraff) as heard,
    ):
        await giraff.subscribe(GIRAFF_LEASE, qos=1)
        await web.publish(GIRAFF_LEASE, b"new", qos=1, retain=True)
        await heard.payload(GIRAFF_LEASE, b"new")


# --- bad input and load ---------------------------------------------------------------------------


async def test_a_message_of_one_mebibyte_passes_and_a_larger_one_ends_the_connection(rig):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(of("giraff", "floorplan"), qos=1)
        largest = random.Random(1).randbytes(1024 * 1024)
        await web.publish(of("giraff", "floorplan"), largest, qos=1)
        await heard.until(lambda h: h.messages)
        assert bytes(heard.messages[0].payload) == largest
        sender = await RawClient.open(rig.port)
        await sender.connect("web", rig.tokens["web"], client_id="large")
        sender.send(framed(0x30, text(of("giraff", "floorplan")) + bytes(MAX_PACKET)))
        assert await sender.is_hung_up()
        await web.publish(of("giraff", "floorplan"), b"small", qos=1)
        await heard.payload(of("giraff", "floorplan"), b"small")
        assert len(heard.messages) == 2


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"\x00\x00",
        b"\xf0\x00",
        b"\x10\xff\xff\xff\xff\x7f",
        b"\x30\x02\x00\x05",
        b"\x82\x02\x00\x01",
        framed(0x10, text("MQTT") + b"\x04\x03\x00\x3c" + text("x")),
        framed(0x10, text("NOPE") + b"\x04\x02\x00\x3c" + text("x")),
        bytes(64),
    ],
)
async def test_a_stranger_who_talks_nonsense_is_hung_up_on(rig, data):
    raw = await RawClient.open(rig.port)
    raw.send(data)
    with contextlib.suppress(OSError):  # it has hung up already
        raw.writer.write_eof()
    assert await raw.is_hung_up()
    assert await rig.is_let_in("web")


@pytest.mark.parametrize(
    "data",
    [
        b"\x36\x05\x00\x01a\x00\x01",
        b"\x32\x05\x00\x01a\x00\x00",
        b"\x30\x03\x00\x01#",
        b"\x30\x04\x00\x02\xff\xfe",
        b"\x82\x02\x00\x01",
        b"\x80\x06\x00\x01\x00\x01a\x00",
        b"\xf0\x00",
        b"\x30\xff\xff\xff\x7f",
        connect_packet("again", "web", "x"),
        framed(0x82, b"\x00\x01" + text("a") + b"\x03"),
        b"\x30\x02\x00\x09",
    ],
)
async def test_a_user_who_breaks_the_protocol_is_hung_up_on_and_the_others_are_not(rig, data):
    async with rig.client("web") as web, ReceivedPacket(web) as heard:
        await web.subscribe(GIRAFF_LEASE, qos=1)
        raw = await RawClient.open(rig.port)
        await raw.connect("web", rig.tokens["web"], client_id="bad")
        raw.send(data)
        assert await raw.is_hung_up()
        await web.publish(GIRAFF_LEASE, b"lease", qos=1)
        await heard.payload(GIRAFF_LEASE, b"lease")


async def test_random_bytes_of_strangers_and_users_do_not_harm_the_broker(rig):
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
async def test_two_hundred_messages_a_second_lose_nothing_while_clients_come_and_go(rig):
    await rig.robot("giraff")
    count = 400
    topic = of("giraff", "state")
    async with (
        rig.client("web") as web,
        rig.client("giraff") as giraff,
        ReceivedPacket(web) as heard,
    ):
        await web.subscribe("telepresence/v1/+/state", qos=1)
        churn = asyncio.create_task(come_and_go(rig))
        started = asyncio.get_running_loop().time()
        for number in range(count):
            await giraff.publish(topic, str(number).encode(), qos=1)
            await asyncio.sleep(
                max(0.0, started + number / 200 - asyncio.get_running_loop().time())
            )
        await heard.until(lambda h: len(h.messages) >= count)
        churn.cancel()
        assert [int(payload) for payload in heard.payloads(topic)] == list(range(count))


async def come_and_go(rig):
    """Subscribe as agents and web processes do, at QoS 0: while others subscribe at QoS 1, NATS
    loses messages.
    """
    while True:
        async with rig.client("web") as client:
            for number in range(5):
                await client.subscribe(
                    [(f"telepresence/v1/robot-{number}/#", 0), ("telepresence/v1/+/state", 0)]
                )
                await client.unsubscribe(f"telepresence/v1/robot-{number}/#")


async def test_pictures_pass_from_a_robot_to_servers_and_requests_from_servers_to_that_robot_alone(
    rig,
):
    await rig.robot("giraff")
    await rig.robot("rhodon")
    async with (
        rig.client("web") as web,
        rig.client("giraff") as giraff,
        ReceivedPacket(web) as seen,
        ReceivedPacket(giraff) as asked,
    ):
        await web.subscribe(of("giraff", "picture"))
        await giraff.subscribe(of("giraff", "command/picture"))
        with contextlib.suppress(aiomqtt.MqttError):
            async with rig.client("rhodon") as rhodon:
                await rhodon.subscribe(of("giraff", "picture"))
        await publish_or_be_hung_up_on(rig, "rhodon", of("giraff", "picture"), b"forged", 0)
        await publish_or_be_hung_up_on(rig, "rhodon", of("giraff", "command/picture"), b"forged", 0)
        await giraff.publish(of("giraff", "picture"), b"a picture")
        await web.publish(of("giraff", "command/picture"), b"one more")
        await seen.payload(of("giraff", "picture"), b"a picture")
        await asked.payload(of("giraff", "command/picture"), b"one more")
    assert seen.payloads(of("giraff", "picture")) == [b"a picture"]
    assert asked.payloads(of("giraff", "command/picture")) == [b"one more"]
