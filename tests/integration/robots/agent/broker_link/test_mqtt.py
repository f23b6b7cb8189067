"""The agent's connection to a real Mosquitto, which is restored without losing records."""

import asyncio
import contextlib
import random
import ssl
import subprocess
import sys
import threading
import time

import msgspec
import pytest

from robots.agent.broker_link.mqtt import Endpoint, MqttLink
from robots.agent.broker_link.outbox import Outbox, outbound
from robots.agent.timing import Backoff
from robots.api import codec, messages as m
from telepresence_site.demo import lan
from tests.support import words
from tests.support.architectures.mqtt_ear import Ear
from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto
from tests.support.sessions.site import free_port, wait_for

pytestmark = pytest.mark.broker

SHEET = words.factsheet(boot="0000000000aa-1")
LEASE = m.Lease(session="s1", epoch=1, peer="p1", who="Ada", renewal=0, stamp=1.0)


class Inbox:
    """Records what arrives."""

    def __init__(self):
        self.messages, self.rejections, self.changes, self.rivals = [], [], [], []

    def arrived(self, suffix, message, *, retained):
        self.messages.append((suffix, message, retained))

    def rejected(self, reason):
        self.rejections.append(reason)

    def link_changed(self, *, up):
        self.changes.append(up)

    def rival(self, boot):
        self.rivals.append(boot)

    def is_needed(self):
        return True


class LinkThread:
    """A link on a loop in a thread, as in the agent."""

    def __init__(self, url, sheet=SHEET, ca=None, others=()):
        self.inbox = Inbox()
        others = tuple(map(Endpoint.of, others))
        self.link = MqttLink(Endpoint.of(url, ca=ca), sheet, rng=random.Random(1), others=others)
        self.loop = asyncio.SelectorEventLoop()
        self._thread = threading.Thread(target=self._run)
        self.crashed = True

    def _run(self):
        with contextlib.suppress(asyncio.CancelledError):
            self._task = self.loop.create_task(self.link.run(self.inbox))
            self.loop.run_until_complete(self._task)
        self.crashed = False
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        if self._thread.is_alive():
            self.call(self.link.close)
        self._thread.join(10.0)
        assert not self._thread.is_alive()
        assert not self.crashed

    def call(self, function, *arguments):
        self.loop.call_soon_threadsafe(function, *arguments)

    def wait_until_sent(self):
        self.wait(lambda: not self.link.outbox.unacknowledged and not len(self.link.outbox))

    def publish(self, suffix, message):
        self.call(self.link.publish, suffix, codec.encode(message))

    def wait(self, condition, within=15.0):
        inbox = self.inbox
        state = lambda: (inbox.messages[-5:], inbox.rejections[-5:], inbox.changes)
        wait_for(condition, within, "what was waited for", state)


def state(seq):
    return words.state(seq, boot=SHEET.boot)


@pytest.mark.parametrize("scheme", ["mqtt", "ws", "mqtts", "wss"])
def test_agent_publishes_and_receives_its_topics_on_every_transport(tmp_path, scheme):
    key, certificate = lan.certificate(tmp_path, ["127.0.0.1"])
    with Mosquitto(tmp_path, (key, certificate)) as broker, Ear(broker.port) as ear:
        with LinkThread(broker.url_of(scheme), ca=str(certificate)) as agent:
            assert ear.wait("connection").state == "ONLINE"
            assert ear.wait("factsheet") == SHEET
            ear.say("lease", LEASE)
            agent.wait(lambda: ("lease", LEASE, False) in agent.inbox.messages)
            ear.say("lease", None)
            agent.wait(lambda: ("lease", None, False) in agent.inbox.messages)
        assert ear.wait("connection", lambda c: c.state == "OFFLINE")


def test_other_transport_replaces_a_dead_one_to_the_broker(broker, ear):
    with LinkThread(f"mqtt://127.0.0.1:{free_port()}", others=[broker.url]) as agent:
        assert ear.wait("connection").state == "ONLINE"
        agent.wait(lambda: agent.inbox.changes[-1:] == [True])
    with LinkThread(broker.url, others=[f"mqtt://127.0.0.1:{free_port()}"]) as agent:
        agent.wait(lambda: agent.inbox.changes == [True])


def test_agent_connects_to_the_next_node_when_its_node_is_lost(tmp_path, broker, ear):
    folder = tmp_path / "second"
    folder.mkdir()
    with Mosquitto(folder) as second, Ear(second.port) as there:
        url = second.url.replace("127.0.0.1", "localhost")
        with LinkThread(broker.url, others=[url]) as agent:
            assert ear.wait("connection").state == "ONLINE"
            agent.wait(lambda: agent.inbox.changes == [True])
            broker.kill()
            assert there.wait("connection").state == "ONLINE"
            assert there.wait("factsheet") == SHEET
            agent.wait(lambda: agent.inbox.changes == [True, False, True])
            broker.start()
            agent.publish("state", state(1))
            assert there.wait("state").seq == 1, "the node that answers is kept"


def test_broker_with_an_untrusted_certificate_is_refused(tmp_path, caplog):
    with (
        Mosquitto(tmp_path, lan.certificate(tmp_path, ["127.0.0.1"])) as broker,
        LinkThread(broker.url_of("mqtts")) as agent,
    ):
        agent.wait(lambda: "certificate verify failed" in caplog.text)
        assert not agent.link.connected


@pytest.mark.nightly
def test_unknown_password_is_logged_with_what_to_do(tmp_path, caplog):
    with (
        Mosquitto(tmp_path, anonymous=False) as broker,
        LinkThread(broker.url) as agent,
    ):
        agent.wait(lambda: "does not accept this robot's password yet" in caplog.text)
        assert "manage.py" not in caplog.text, "a site that has just made it needs a moment"
        agent.wait(lambda: "On the site's machine run `manage.py enrol giraff" in caplog.text)
    assert "[code" not in caplog.text


def test_retained_lease_is_marked_as_retained(broker, ear):
    ear.say("lease", LEASE, retain=True)
    with LinkThread(broker.url) as agent:
        agent.wait(lambda: ("lease", LEASE, True) in agent.inbox.messages)


def test_malformed_and_oversized_messages_are_counted_and_do_not_end_the_loop(broker, ear):
    noise = random.Random(5)
    with LinkThread(broker.url) as agent:
        agent.wait(lambda: agent.link.connected)
        commands = ("command/velocity", "command/action", "command/heartbeat")
        for number, suffix in enumerate(60 * (*commands, "lease", "signal/p1")):
            raw = noise.randbytes(noise.randrange(1, 200)) if number % 7 else b"x" * 200_000
            ear.say(suffix, None, raw=raw)
        agent.wait(lambda: len(agent.inbox.rejections) == 300)
        assert {"malformed", "oversized"} == set(agent.inbox.rejections)
        ear.say("lease", LEASE)
        agent.wait(lambda: ("lease", LEASE, False) in agent.inbox.messages)


def test_after_a_broker_restart_retained_messages_and_all_states_are_sent(broker, ear):
    with LinkThread(broker.url) as agent:
        ear.wait("connection")
        for seq in range(1, 21):
            agent.publish("state", state(seq))
        ear.wait("state", lambda s: s.seq == 20)
        broker.kill()
        agent.wait(lambda: agent.inbox.changes[-1:] == [False])
        for seq in range(21, 301):
            agent.publish("state", state(seq))
        agent.publish("pose", words.pose(stamp=9.0))
        seen = ear.count
        # The agent waits until the ear has subscribed again; a server would request lost states.
        waiting = threading.Event()
        ear.subscribed.clear()

        def wait_for_the_ear():
            waiting.set()
            ear.subscribed.wait(patient(10.0))

        agent.call(wait_for_the_ear)
        assert waiting.wait(patient(10.0))
        broker.start()
        assert ear.wait("connection", since=seen).state == "ONLINE"
        ear.wait("factsheet", since=seen)
        ear.wait("state", lambda s: s.seq == 300)
        agent.wait_until_sent()
        assert agent.link.outbox.lost == 0
        assert [s.seq for s in ear.all("state") if s.seq > 20] == list(range(21, 301))
        assert ear.all("pose") == [], "an old pose was sent"


@pytest.mark.nightly
def test_unacknowledged_messages_are_sent_again(broker, ear):
    with LinkThread(broker.url) as agent:
        ear.wait("connection")
        broker.freeze(on=True)
        for seq in range(1, 51):
            agent.publish("state", state(seq))
        agent.wait(lambda: agent.link.outbox.unacknowledged > 0)
        agent.wait(lambda: agent.inbox.changes[-1:] == [False], within=20.0)
        broker.freeze(on=False)
        ear.wait("state", lambda s: s.seq == 50)
        agent.wait_until_sent()
        assert {s.seq for s in ear.all("state")} == set(range(1, 51))


KILLED = """
import asyncio, random, sys
from robots.agent.broker_link.mqtt import Endpoint, MqttLink
from tests.integration.robots.agent.broker_link.test_mqtt import SHEET, Inbox
link = MqttLink(Endpoint.of(sys.argv[1]), SHEET, rng=random.Random(1))
asyncio.SelectorEventLoop().run_until_complete(link.run(Inbox()))
"""


def test_killed_agent_leaves_a_will(broker, ear):
    agent = subprocess.Popen([sys.executable, "-c", KILLED, broker.url])
    try:
        ear.wait("connection", lambda c: c.state == "ONLINE")
    finally:
        agent.kill()
        agent.wait()
    assert ear.wait("connection", lambda c: c.state == "CONNECTIONBROKEN").boot == SHEET.boot


@pytest.mark.parametrize("stale", ["CONNECTIONBROKEN", "OFFLINE"])
def test_stale_offline_message_is_answered_with_online(broker, ear, stale):
    with LinkThread(broker.url):
        ear.wait("connection", lambda c: c.state == "ONLINE")
        seen = ear.count
        old = m.Connection(boot="000000000001-0", state=stale, stamp=1.0)
        ear.say("connection", old, retain=True)
        assert ear.wait("connection", lambda c: c.state == "ONLINE", since=seen).boot == SHEET.boot
    with Ear(broker.port) as first_time_user:
        assert first_time_user.wait("connection").state == "OFFLINE"


def test_older_of_two_agents_yields_until_the_newer_one_has_left(broker, ear):
    newer = msgspec.structs.replace(SHEET, boot="0000000000bb-1")
    with LinkThread(broker.url) as old:
        old.wait(lambda: old.link.connected)
        with LinkThread(broker.url, newer) as new:
            old.wait(lambda: old.inbox.rivals == [newer.boot])
            assert new.inbox.rivals == []
            seen = ear.count
        old.wait(lambda: old.inbox.rivals == [newer.boot, None])
        is_back = lambda c: c.state == "ONLINE" and c.boot == SHEET.boot
        assert ear.wait("connection", is_back, since=seen)


def test_agent_waits_for_a_broker_that_starts_later(tmp_path):
    broker = Mosquitto(tmp_path)
    with LinkThread(broker.url) as agent:
        agent.publish("state", state(1))
        with broker, Ear(broker.port) as ear:
            agent.wait(lambda: agent.link.connected)
            agent.publish("state", state(2))
            ear.wait("state", lambda s: s.seq == 2)


def test_agent_ends_while_the_broker_is_away(tmp_path):
    with LinkThread(Mosquitto(tmp_path).url) as agent:
        agent.publish("state", state(1))
        begun = time.monotonic()
    assert time.monotonic() - begun < 10.0


# --- pure -----------------------------------------------------------------------------------------


def test_address_sets_transport_port_and_path():
    plain = Endpoint.of("mqtt://broker.example", "giraff", "secret")
    assert (plain.host, plain.port, plain.transport) == ("broker.example", 1883, "tcp")
    assert (plain.tls, plain.username, plain.password) == (None, "giraff", "secret")
    web = Endpoint.of("wss://broker.example/bus")
    assert (web.port, web.transport, web.path) == (443, "websockets", "/bus")
    assert isinstance(web.tls, ssl.SSLContext)
    assert Endpoint.of("mqtts://u%40x:p@[::1]:1").username == "u@x"
    with pytest.raises(ValueError, match=r"the certificates in /nowhere\.pem cannot be read: "):
        Endpoint.of("mqtts://broker.example", ca="/nowhere.pem")


def test_waits_double_up_to_a_limit_and_are_reset_by_a_lasting_connection():
    backoff = Backoff(random.Random(2), first=0.2, longest=5.0, settled=10.0)
    waits = [backoff.failed() for _ in range(8)]
    bases = [0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0]
    assert all(base / 2 <= wait <= base for wait, base in zip(waits, bases, strict=True))
    assert backoff.failed(held=3.0) > 2.0
    assert backoff.failed(held=60.0) <= 0.2


def test_outbox_keeps_states_drops_poses_and_loses_the_oldest_first():
    outbox = Outbox(messages=3)
    outbox.put(outbound("pose", b"1"), connected=False)
    for number in range(5):
        outbox.put(outbound("state", str(number).encode()), connected=False)
    assert outbox.lost == 2
    first, second = outbox.take(), outbox.take()
    assert (first.payload, second.payload) == (b"2", b"3")
    outbox.put(outbound("heartbeat", b"9"), connected=True)
    outbox.acknowledged(second)
    outbox.disconnected()
    assert [outbox.take().payload for _ in range(len(outbox))] == [b"2", b"4"]
    with pytest.raises(ValueError, match="no topic"):
        outbound("nowhere", b"")


def test_only_the_newest_picture_waits_in_the_outbox():
    outbox = Outbox()
    for payload in (b"one", b"two", b"three"):
        outbox.put(outbound("picture", payload), connected=True)
    assert len(outbox) == 1
    sent = outbox.take()
    assert sent.payload == b"three"
    outbox.put(outbound("picture", b"four"), connected=True)
    assert len(outbox) == 0
    outbox.acknowledged(sent)
    outbox.put(outbound("picture", b"five"), connected=True)
    assert outbox.take().payload == b"five"
    outbox.put(outbound("picture", b"six"), connected=False)
    assert len(outbox) == 0
    assert outbox.lost == 3
