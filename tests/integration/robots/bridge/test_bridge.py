"""The web process's bridge on real brokers: relay, reconnection, and no replay."""

import asyncio
import contextlib
import random
import time
from dataclasses import replace

import aiomqtt
import msgspec
import pytest

from robots.api import codec, messages as m, picture, topics
from robots.api.idle import WATCHER
from robots.bridge.bridge import REPORTS_IN_FLIGHT, STOP_SECONDS, Bridge
from robots.bridge.delivery import FAULTS, LINK, NOTICE
from robots.bridge.failover import Failover
from tests.support import words
from tests.support.browsers.pages import until
from tests.support.patience import patient
from tests.support.sessions.broker_rig import HOST, KINDS, BrokerRig

pytestmark = pytest.mark.broker
LEASE = m.Lease(session="s1", epoch=3, peer="p1", who="Ada", renewal=0, stamp=1.0)


class Listener:
    """Records what it receives."""

    def __init__(self):
        self.inbound_messages = []

    def handle_message(self, inbound):
        self.inbound_messages.append(inbound)

    def received(self, suffix):
        return [inbound.message for inbound in self.inbound_messages if inbound.suffix == suffix]

    def sequence(self):
        """Return the numbers of the states that it received."""
        return [state.seq for state in self.received("state")]


@pytest.fixture(params=KINDS)
async def rig(request, tmp_path):
    rig = BrokerRig(request.param, tmp_path)
    await rig.start()
    await rig.robot("giraff")
    yield rig
    await rig.stop()


@contextlib.asynccontextmanager
async def bridge_of(rig, seed=1):
    bridge = Bridge(f"mqtt://{HOST}:{rig.port}", ("web", rig.tokens["web"]), random.Random(seed))
    try:
        assert await bridge.wait_connected(patient(5))
        yield bridge
    finally:
        await bridge.close()


@contextlib.asynccontextmanager
async def robot_of(rig):
    """Yield the robot's client: `got` are the (suffix, message, retained) that it received, without
    the `beats`, which the bridge sends while a page is open.
    """
    async with rig.client("giraff") as client:
        client.got, client.beats = [], []
        inputs = [topic for topic in topics.subscriptions("giraff") if "/connection" not in topic]
        await client.subscribe([(topic, 0) for topic in inputs])

        async def read():
            async for message in client.messages:
                _, suffix = topics.parse(str(message.topic))
                content = codec.decode(suffix, message.payload) if message.payload else None
                if suffix == "command/heartbeat":
                    client.beats.append(content)
                else:
                    client.got.append((suffix, content, message.retain))

        reading = asyncio.create_task(read())
        try:
            yield client
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)


def actions(robot):
    """Return the ids of the actions that the robot received."""
    return [message.action_id for suffix, message, _ in robot.got if suffix == "command/action"]


async def listen(bridge, *listeners):
    """Subscribe listeners to the robot, wait until the broker has confirmed it, and return the last
    listener, a new one by default, with what the bridge knows about the robot as its `known`.
    """
    listeners = listeners or (Listener(),)
    for each in listeners:
        each.known = bridge.listen("giraff", each)
    await until(lambda: not bridge._in_flight)
    return listeners[-1]


async def say(client, suffix, message, *, qos=1, retain=False):
    await client.publish(topics.of("giraff", suffix), codec.encode(message), qos=qos, retain=retain)


async def test_refused_subscription_is_repeated(rig, monkeypatch):
    subscribe, refusals = aiomqtt.Client.subscribe, 2

    async def busy(client, topic, *rest, **more):
        nonlocal refusals
        if refusals and "giraff" in str(topic):
            refusals -= 1
            return [0x80 for _ in topic]
        return await subscribe(client, topic, *rest, **more)

    async with robot_of(rig) as robot, bridge_of(rig) as bridge:
        monkeypatch.setattr(aiomqtt.Client, "subscribe", busy)
        listener = Listener()
        bridge.listen("giraff", listener)
        for seq in range(1, 200):
            await say(robot, "state", words.state(seq=seq))
            await asyncio.sleep(0.1)
            if listener.received("state"):
                break
        assert listener.received("state")
        assert refusals == 0


async def test_messages_are_relayed_from_and_to_a_robot(rig):
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        listener = await listen(bridge)
        await say(robot, "connection", words.online(), retain=True)
        await until(lambda: listener.known.online)
        await say(robot, "state", words.state(seq=1))
        await say(robot, "signal/p1/reply", m.SdpAnswer(sdp="v=0"))
        await until(lambda: listener.received("state") and listener.received("signal/p1/reply"))
        assert bridge.send("giraff", "command/velocity", words.velocity())
        assert bridge.send("giraff", "signal/p1", m.Bye(reason="left"))
        assert bridge.publish_lease("giraff", LEASE)
        await until(lambda: len(robot.got) == 3)
    assert {suffix for suffix, _, _ in robot.got} == {"command/velocity", "signal/p1", "lease"}


async def test_open_page_keeps_the_robot_awake(rig):
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        began = time.monotonic()
        listener = await listen(bridge)
        await until(lambda: robot.beats)
        assert time.monotonic() - began < patient(0.5)
        await until(lambda: len(robot.beats) >= 3)
        assert {(beat.peer, beat.needed) for beat in robot.beats} == {(WATCHER, True)}
        bridge.ignore("giraff", listener)
        assert bridge._delivery.beats_due(time.monotonic() + 60.0) == []


async def test_later_listener_gets_retained_messages(rig):
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        await say(robot, "connection", words.online(), retain=True)
        await say(robot, "factsheet", words.factsheet(), retain=True)
        bridge.publish_lease("giraff", LEASE)
        await until(lambda: robot.got)
        known = bridge.listen("giraff", Listener())
        await until(lambda: known.online and known.factsheet and known.lease)
        assert known.lease == LEASE


async def test_robot_without_listeners_is_not_subscribed(rig):
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        one, two = Listener(), Listener()
        await listen(bridge, one, two)
        await say(robot, "state", words.state(seq=1))
        await until(lambda: one.received("state") and two.received("state"))
        bridge.ignore("giraff", one)
        await say(robot, "state", words.state(seq=2))
        await until(lambda: len(two.received("state")) == 2)
        bridge.ignore("giraff", two)
        await until(lambda: not bridge._in_flight)
        await say(robot, "state", words.state(seq=3))
        await listen(bridge, one)
        await say(robot, "state", words.state(seq=4))
        await until(lambda: one.sequence()[-1:] == [4])
        assert one.sequence() == [1, 4]
        assert bridge.counts["arrived"] == 3


async def test_notices_of_a_session_reach_followers_in_every_web_process(rig):
    async with bridge_of(rig, 1) as here, bridge_of(rig, 2) as there:
        one, two, other = Listener(), Listener(), Listener()
        here.follow("s1", one)
        there.follow("s1", two)
        there.follow("s2", other)
        here.publish_notice("s1", "session/turn_warning\n{}")
        await until(lambda: one.received(NOTICE) and two.received(NOTICE))
        there.unfollow("s1", two)
        here.publish_notice("s1", "session/ended\n{}")
        here.publish_notice("s2", "session/ended\n{}")
        await until(lambda: other.received(NOTICE) and len(one.received(NOTICE)) == 2)
        assert len(two.received(NOTICE)) == 1


async def test_bad_messages_are_counted_and_the_next_one_is_delivered(rig):
    async with bridge_of(rig) as bridge, rig.client("giraff") as robot:
        listener = await listen(bridge)
        malformed = (b"", b"{", b"\xff\xff", b"[]", b'{"stamp": NaN}', b"[" * 5000)
        for payload in (*malformed, b"x" * 40_000):
            await robot.publish("telepresence/v1/giraff/state", payload, qos=1)
        await say(robot, "state", words.state(seq=2))
        await until(lambda: listener.sequence() == [2])
        assert bridge.counts["malformed"] == 6
        assert bridge.counts["oversized"] == 1


async def test_listeners_get_messages_again_after_a_restart_of_the_broker(rig):
    async with bridge_of(rig) as bridge:
        listener = await listen(bridge)
        await rig.restart()
        await until(lambda: listener.received(LINK) == [False, True])
        await rig.until(lambda: rig.is_let_in("giraff"))
        async with robot_of(rig) as robot:
            await say(robot, "state", words.state(seq=9))
            await until(lambda: listener.received("state"))


class Broken(Listener):
    """Raises on every message."""

    def handle_message(self, inbound):
        super().handle_message(inbound)
        raise LookupError("an error of ours")


async def test_listener_that_raises_does_not_affect_the_others(rig):
    async with bridge_of(rig) as bridge:
        listeners = [Broken(), Listener(), Broken()]
        await listen(bridge, *listeners)
        bridge.follow("s1", listeners[0])
        bridge.follow("s1", listeners[1])
        async with robot_of(rig) as robot:
            await say(robot, "state", words.state(seq=1))
            bridge.publish_notice("s1", "session/turn_warning\n{}")
            for each in listeners:
                await until(lambda each=each: each.received("state"))
            await until(lambda: listeners[1].received(NOTICE))
        assert listeners[1].received(LINK) == [], "the connection was lost"
        await rig.restart()
        await until(lambda: listeners[1].received(LINK) == [False, True])
        assert bridge.connected
        assert bridge.serves(asyncio.get_running_loop())
        await rig.until(lambda: rig.is_let_in("giraff"))
        async with robot_of(rig) as robot:
            await say(robot, "state", words.state(seq=2))
            await until(lambda: listeners[1].sequence() == [1, 2])


@pytest.mark.parametrize("where", ["arrive", "bring_everybody", "bring_faults", "beats_due"])
async def test_error_in_the_bridge_ends_neither_of_its_tasks(rig, monkeypatch, where):
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        listener, failed = await listen(bridge), []
        right = getattr(bridge._delivery, where)

        def fails_once(*arguments):
            if not failed:
                failed.append(where)
                raise LookupError("an error of ours")
            return right(*arguments)

        monkeypatch.setattr(bridge._delivery, where, fails_once)
        if where == "bring_everybody":
            await rig.restart()
            await rig.until(lambda: rig.is_let_in("giraff"))
        else:
            await say(robot, "state", words.state(seq=1))
        await until(lambda: failed)
        await until(lambda: bridge.connected)
        async with robot_of(rig) as again:
            await say(again, "state", words.state(seq=2))
            await until(lambda: listener.sequence()[-1:] == [2])
            listener.inbound_messages.clear()
            await until(lambda: listener.received(FAULTS))


async def test_commands_are_dropped_while_the_broker_is_away_and_never_replayed(rig):
    async with bridge_of(rig) as bridge:
        listener = await listen(bridge)
        await rig.stop()
        await until(lambda: listener.received(LINK) == [False])
        assert not bridge.connected
        assert not bridge.send("giraff", "command/velocity", words.velocity(seq=1))
        assert not bridge.send("giraff", "command/action", m.Dock(action_id="d", stamp=1.0))
        assert not bridge.publish_lease("giraff", LEASE)
        await rig._start()
        await rig.until(lambda: rig.is_let_in("giraff"))
        async with robot_of(rig) as robot:
            await until(lambda: bridge.connected)
            bridge.send("giraff", "command/velocity", words.velocity(seq=2))
            await until(lambda: robot.got)
            assert [message.seq for _, message, _ in robot.got] == [2]


async def test_stop_is_repeated_and_a_report_is_kept_until_the_broker_is_back(rig, monkeypatch):
    # as long as a broker takes to start on a busy machine
    monkeypatch.setattr("robots.bridge.bridge.STOP_SECONDS", patient(STOP_SECONDS * 5))
    async with bridge_of(rig) as bridge:
        await listen(bridge)
        await rig.stop()
        await until(lambda: not bridge.connected)
        bridge.send_stop("giraff", m.Stop(action_id="stop-1", stamp=1.0))
        bridge.report("telepresence/v1/server/page/s1", m.Bye(reason="kept"))
        # so that the robot reconnects before the bridge
        node = bridge._failover.node
        bridge._failover = Failover((replace(node, port=1),), random.Random(1))
        await rig._start()
        await rig.until(lambda: rig.is_let_in("giraff"))
        async with robot_of(rig) as robot, rig.client("web") as manager:
            await manager.subscribe("telepresence/v1/server/page/+", qos=1)
            bridge._failover = Failover((replace(node, port=rig.port),), random.Random(1))
            await until(lambda: actions(robot) == ["stop-1"])
            async with asyncio.timeout(patient(10.0)):
                message = await anext(aiter(manager.messages))
            assert msgspec.json.decode(message.payload)["reason"] == "kept"


async def test_stop_that_could_not_be_sent_is_repeated_on_the_same_connection(rig, monkeypatch):
    async with robot_of(rig) as robot, bridge_of(rig) as bridge:
        publish, refused = bridge._client.publish, []

        async def refuses_twice(topic, payload, **options):
            if len(refused) < 2:
                refused.append(topic)
                raise aiomqtt.MqttError("no room")
            await publish(topic, payload, **options)

        monkeypatch.setattr(bridge._client, "publish", refuses_twice)
        bridge.send_stop("giraff", m.Stop(action_id="stop-1", stamp=1.0))
        await until(lambda: actions(robot) == ["stop-1"])
        assert len(refused) == 2


async def test_queued_reports_are_sent_in_parts_that_leave_room_for_a_stop(rig, monkeypatch):
    async with bridge_of(rig) as bridge:
        waiting, most = asyncio.Event(), []

        async def confirms_late(_topic, _payload, **_options):
            most.append(len(bridge._in_flight))
            await waiting.wait()

        monkeypatch.setattr(bridge._client, "publish", confirms_late)
        for number in range(3 * REPORTS_IN_FLIGHT):
            bridge.report("telepresence/v1/server/page/s1", m.Bye(reason=f"{number}"))
        await asyncio.sleep(0.05)
        assert len(bridge._in_flight) == REPORTS_IN_FLIGHT
        waiting.set()
        await until(lambda: len(most) == 3 * REPORTS_IN_FLIGHT)
        assert max(most) == REPORTS_IN_FLIGHT


async def test_expired_stop_is_not_sent(rig, monkeypatch):
    monkeypatch.setattr("robots.bridge.bridge.STOP_SECONDS", 0.05)
    async with bridge_of(rig) as bridge:
        await listen(bridge)
        await rig.stop()
        await until(lambda: not bridge.connected)
        bridge.send_stop("giraff", m.Stop(action_id="stop-1", stamp=1.0))
        given_up = time.monotonic() + 0.06
        await until(lambda: time.monotonic() > given_up)
        await rig._start()
        async with robot_of(rig) as robot:
            await until(lambda: bridge.connected)
            bridge.send("giraff", "command/action", m.Undock(action_id="after", stamp=1.0))
            await until(lambda: robot.got)
            assert actions(robot) == ["after"]
    assert STOP_SECONDS == 3.0


async def test_bridge_with_a_wrong_password_logs_it_and_keeps_trying(rig, caplog):
    bridge = Bridge(f"mqtt://{HOST}:{rig.port}", ("web", "wrong"), random.Random(1))
    try:
        await until(lambda: "bridge_lost" in caplog.text)
        assert not bridge.connected
        assert not bridge.send("giraff", "command/velocity", words.velocity())
    finally:
        await bridge.close()


async def test_unconfirmed_messages_are_bounded(rig):
    async with bridge_of(rig) as bridge:
        await listen(bridge)
        sent = [
            bridge.send("giraff", "command/action", m.Undock(action_id=f"a{number}", stamp=1.0))
            for number in range(600)
        ]
        assert sent.count(True) == 500
        assert bridge.counts["unsent"] == 100
        await until(lambda: not bridge._in_flight)
        assert bridge.send("giraff", "command/action", m.Undock(action_id="again", stamp=1.0))


async def test_picture_reaches_listeners_whole_and_malformed_ones_are_counted(rig):
    jpeg = b"\xff\xd8\xff" + bytes(range(256)) * 150 + b"\xff\xd9"
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        listener = Listener()
        bridge.listen("giraff", listener)
        assert bridge.send("giraff", "command/picture", m.PictureRequest(stamp=1.0, peer="p1"))
        await until(lambda: any(suffix == "command/picture" for suffix, _, _ in robot.got))
        large = picture.pack(1.0, jpeg[:3] + b"x" * 60_000 + jpeg[-2:])
        for payload in (b"\0" * 8 + jpeg[:-1], large, picture.pack(12.5, jpeg)):
            await robot.publish(topics.of("giraff", "picture"), payload)
        await until(lambda: listener.received("picture"))
        (inbound,) = [each for each in listener.inbound_messages if each.suffix == "picture"]
        assert inbound.frame == b"picture\n" + picture.pack(12.5, jpeg)
        assert bridge.counts["malformed"] == 1
        assert bridge.counts["oversized"] == 1


async def test_pointers_travel_in_both_directions_and_are_not_retained(rig):
    dot = m.Pointer(stamp=1.0, by="screen", at=(0.25, 0.75))
    command = m.PointCommand(stamp=1.0, at=(0.5, 0.5), session="s1", epoch=3, peer="p1")
    async with bridge_of(rig) as bridge, robot_of(rig) as robot:
        listener = await listen(bridge)
        assert bridge.send("giraff", "command/point", command)
        await say(robot, "pointer", dot, qos=0)
        await until(lambda: listener.received("pointer") and robot.got)
        assert listener.received("pointer") == [dot]
        assert robot.got == [("command/point", command, False)]
        async with bridge_of(rig, seed=2) as second, robot_of(rig) as returned:
            later = await listen(second)
            await say(robot, "state", words.state(seq=1))
            assert second.send("giraff", "signal/p1", m.Bye(reason="left"))
            await until(lambda: later.received("state") and returned.got)
    assert later.received("pointer") == []
    assert [suffix for suffix, _, _ in returned.got] == ["signal/p1"]
