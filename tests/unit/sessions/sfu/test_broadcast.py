"""A robot's stream when Janus, the robot or a page fails, with a Janus in memory."""

import asyncio
import contextlib
import itertools

import pytest

from robots.api import codec, messages as m
from sessions.protocol import WantOffer
from sessions.sfu import broadcast as module
from sessions.sfu.broadcast import Broadcast
from sessions.sfu.janus import HANGUP, UP, Handle
from sessions.sfu.mountpoint import (
    CANNOT_CREATE,
    MOUNTPOINT_EXISTS,
    NO_SUCH_MOUNTPOINT,
    mountpoint_of,
)
from sessions.sfu.robot_leg import CONNECT_SECONDS, STAY_SECONDS, RobotLeg
from tests.support import words
from tests.support.patience import until
from tests.support.sessions.memory_bridge import MemoryBridge

ANSWER = m.SdpAnswer(sdp="v=0 answer")
UNAUTHORIZED, INVALID = 458, 453  # of janus_streaming.c: a wrong secret, and a wrong value


class Janus:
    """A session of sessions/sfu/janus.py and its two plug-ins. Like src/plugins/janus_streaming.c,
    it refuses an unknown mountpoint (455) and a second one of the same number (456); `refuses` has
    further refusals by request.
    """

    def __init__(self):
        self.closed = asyncio.Event()
        self.open_gate = asyncio.Event()
        self.open_gate.set()
        self.label, self.viewers = None, 0
        self.refuses, self.asked, self.trickled, self.detached = {}, [], [], []
        self.handles, self.plugins = {}, {}
        self._numbers = itertools.count(1)

    @contextlib.asynccontextmanager
    async def open(self):
        yield self

    async def attach(self, plugin, on_event=None):
        if on_event is not None:  # for a connection
            await self.open_gate.wait()
        handle = Handle(self, next(self._numbers))
        self.handles[handle.number], self.plugins[handle.number] = on_event, plugin
        return handle

    def forget(self, handle):
        self.handles.pop(handle.number, None)

    def attached(self, plugin):
        return [number for number in self.handles if self.plugins[number] == plugin]

    async def send(self, verb, _handle, **fields):
        assert verb == "trickle"
        self.trickled.append(fields["candidate"])

    async def request(self, verb, handle, **fields):
        await asyncio.sleep(0)
        if verb == "detach":
            self.detached.append(handle)
            return {}
        name = fields["body"]["request"]
        self.asked.append(name)
        code = self.refuses.get(name, 0) or self._refusal(name)
        if code:
            return {"plugindata": {"data": {"error_code": code, "error": name}}}
        return getattr(self, f"_{name}", lambda *_: {})(handle, fields["body"])

    def _refusal(self, name):
        if name == "create":
            return MOUNTPOINT_EXISTS if self.label is not None else 0
        needs = name in {"info", "edit", "destroy", "watch"}
        return NO_SUCH_MOUNTPOINT if needs and self.label is None else 0

    def _info(self, *_):
        media = [{"port": 20000}, {"port": 20002}]
        info = {"metadata": self.label, "viewers": self.viewers, "media": media}
        return {"plugindata": {"data": {"info": info}}}

    def _create(self, _handle, body):
        self.label = body["metadata"]
        return {}

    def _edit(self, _handle, body):
        self.label = body["new_metadata"]
        return {}

    def _destroy(self, *_):
        self.label = None
        return {}

    def _watch(self, *_):
        return {"jsep": {"sdp": "v=0 offer"}}

    _process = _watch

    def _generate(self, handle, _body):
        self.handles[handle](UP, "")
        return {}


class Bridge(MemoryBridge):
    """Its robot answers every offer with the next of `answers`, and then with the last one."""

    def __init__(self):
        super().__init__()
        self.stored["giraff", "connection"] = codec.encode(words.online())
        self.answers = [ANSWER]

    def send(self, robot, suffix, message):
        if super().send(robot, suffix, message) and isinstance(message, m.SdpOffer):
            answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
            asyncio.get_running_loop().call_soon(self.say, robot, f"{suffix}/reply", answer)
        return self.connected

    def offers(self):
        return [message for _, _, message in self.sent if isinstance(message, m.SdpOffer)]


class Viewer:
    """A page that watches, and answers nothing by itself."""

    def __init__(self, broadcast, peer):
        self.received, self._broadcast, self._peer = [], broadcast, peer
        broadcast.join(peer, self.received.append)

    def say(self, message):
        self._broadcast.take(self._peer, message)

    def leave(self):
        self._broadcast.leave(self._peer)

    def byes(self):
        return [message.reason for message in self.received if isinstance(message, m.Bye)]

    async def offered(self):
        """Ask for an offer, and return when it is there."""
        before = len(self.received)
        self.say(WantOffer())
        await until(lambda: self.received[before:])
        assert isinstance(self.received[-1], m.SdpOffer), self.received


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    monkeypatch.setattr(module, "STEP_SECONDS", 0.001)
    monkeypatch.setattr(module, "RETRY_SECONDS", 0.001)


@pytest.fixture
async def janus():
    return Janus()


@pytest.fixture
async def bridge():
    return Bridge()


@pytest.fixture
async def broadcast(janus, bridge):
    made = Broadcast("giraff", mountpoint_of("secret", "giraff"), bridge, janus.open, lambda: None)
    yield made
    await made.close()


async def test_signalling_of_a_page_reaches_janus(page, janus):
    await page.offered()
    page.say(ANSWER)
    for fields in ({"sdp_mid": "video"}, {"sdp_m_line_index": 1}, {}):
        page.say(m.Candidate(candidate="one", **fields))
    page.say(m.Candidate(candidate=""))
    await until(lambda: "start" in janus.asked and len(janus.trickled) == 4)
    assert janus.trickled == [
        {"candidate": "one", "sdpMid": "video"},
        {"candidate": "one", "sdpMLineIndex": 1},
        {"candidate": "one", "sdpMLineIndex": 0},
        {"completed": True},
    ]


@pytest.fixture
async def page(broadcast):
    return Viewer(broadcast, "page")


@pytest.mark.parametrize("request_", ["watch", "start"])
async def test_a_page_gets_a_bye_when_janus_refuses_and_may_ask_again(page, janus, request_):
    janus.refuses[request_] = INVALID
    page.say(WantOffer())
    await until(lambda: page.received)
    page.say(ANSWER)
    await until(lambda: page.byes() == ["failed"])
    await until(lambda: not janus.attached("streaming")[1:])  # the first is the broadcast's own
    janus.refuses.clear()
    await page.offered()


async def test_a_page_gets_a_bye_when_its_connection_ends_at_janus(page, janus):
    await page.offered()
    janus.handles[janus.attached("streaming")[-1]](UP, "")
    assert page.byes() == []
    janus.handles[janus.attached("streaming")[-1]](HANGUP, "ICE failed")
    assert page.byes() == ["failed"]


async def test_a_page_that_hangs_up_is_detached_and_its_later_messages_are_dropped(
    broadcast, page, janus
):
    await page.offered()
    (_, handle) = janus.attached("streaming")
    page.say(m.Bye(reason="left"))
    page.say(ANSWER)
    await until(lambda: handle in janus.detached)
    page.leave()
    page.say(WantOffer())
    await Viewer(broadcast, "other").offered()
    assert "start" not in janus.asked
    assert len(page.received) == 1


async def test_a_page_that_leaves_while_it_is_attached_is_detached(broadcast, page, janus):
    first = Viewer(broadcast, "first")
    await first.offered()
    janus.open_gate.clear()
    page.say(WantOffer())
    await until(lambda: not broadcast._viewers["page"].wants)
    page.leave()
    before = set(janus.detached)
    janus.open_gate.set()
    await until(lambda: set(janus.detached) - before)
    assert page.received == []


async def test_no_task_continues_after_the_end(broadcast, page, janus, bridge):
    first = Viewer(broadcast, "first")
    await first.offered()
    janus.open_gate.clear()
    page.say(WantOffer())
    await until(lambda: not broadcast._viewers["page"].wants)
    await broadcast.close()
    janus.open_gate.set()
    await until(lambda: not broadcast._tasks)
    assert page.received == []
    assert bridge.delivery.robots == ()


async def test_a_robot_whose_answer_janus_refuses_gets_another_offer(broadcast, janus, bridge):
    page = Viewer(broadcast, "page")
    janus.refuses["generate"] = INVALID
    page.say(WantOffer())
    await until(lambda: len(bridge.offers()) >= 3)
    assert page.received == []
    janus.refuses.clear()
    await until(lambda: page.received)
    assert isinstance(page.received[0], m.SdpOffer)


async def test_a_robot_gets_its_offer_when_the_broker_is_back(broadcast, bridge):
    bridge.lose_broker()
    page = Viewer(broadcast, "page")
    page.say(WantOffer())
    await until(lambda: broadcast._leg is not None)
    assert page.received == []
    bridge.find_broker()
    await until(lambda: page.received)
    assert len(bridge.offers()) == 1


async def test_a_full_robot_refuses_only_the_pages_that_ask(broadcast, bridge):
    bridge.answers = [m.Bye(reason="full")]
    idle, page = Viewer(broadcast, "idle"), Viewer(broadcast, "page")
    page.say(WantOffer())
    await until(lambda: page.byes())
    assert page.byes() == ["full"]
    assert idle.received == []


async def test_two_processes_share_the_stream_of_the_first(janus, bridge):
    """The other process creates it between our `info` and our `create`."""
    janus.refuses["info"] = NO_SUCH_MOUNTPOINT
    janus.label = "another-process 1"
    broadcast = Broadcast("giraff", mountpoint_of("s", "g"), bridge, janus.open, lambda: None)
    page = Viewer(broadcast, "page")
    page.say(WantOffer())
    await until(lambda: "create" in janus.asked)
    janus.refuses.clear()
    await until(lambda: page.received)
    assert isinstance(page.received[0], m.SdpOffer)
    assert bridge.offers() == [], "the robot sends once"
    assert janus.label == "another-process 1"
    await broadcast.close()


async def test_the_stream_of_another_process_is_not_destroyed(janus, bridge, monkeypatch):
    monkeypatch.setattr(module, "LINGER_SECONDS", 0.0)
    janus.label, over = "another-process 1", asyncio.Event()
    broadcast = Broadcast("giraff", mountpoint_of("s", "g"), bridge, janus.open, over.set)
    await until(over.is_set)
    assert "destroy" not in janus.asked
    await broadcast.close()


@pytest.mark.parametrize("request_", ["info", "create"])
async def test_a_janus_that_refuses_the_stream_counts_as_lost(broadcast, janus, request_):
    janus.refuses[request_] = UNAUTHORIZED
    page = Viewer(broadcast, "page")
    await until(lambda: page.byes())
    assert set(page.byes()) == {"sfu_lost"}
    janus.refuses.clear()
    await until(lambda: not broadcast.fault)
    page.received.clear()
    await page.offered()


async def test_creating_the_stream_is_tried_a_few_times_and_later_again(
    broadcast, janus, monkeypatch
):
    monkeypatch.setattr(module, "STEP_SECONDS", 60.0)
    janus.refuses["create"] = CANNOT_CREATE
    page = Viewer(broadcast, "page")
    page.say(WantOffer())
    await until(lambda: "create" in janus.asked)
    for _ in range(1000):
        await asyncio.sleep(0)
    assert janus.asked.count("create") <= 2 * module.PORTS_TRIED, "at the start and for the page"
    janus.refuses.clear()
    page.say(WantOffer())
    await until(lambda: any(isinstance(one, m.SdpOffer) for one in page.received))


async def test_a_robot_that_does_not_connect_in_time_is_given_up(janus, bridge):
    bridge.answers = [m.Candidate(candidate="no answer to the offer")]
    leg = RobotLeg("giraff", "b1", bridge, lambda: None)
    await leg.begin(janus, 20000)
    await leg.take_reply(bridge.answers[0])
    assert not leg.is_lost("b1", leg._began + CONNECT_SECONDS)
    assert leg.is_lost("b1", leg._began + CONNECT_SECONDS + 0.1)
    assert leg.ended == "no_connection"


async def test_a_robot_gets_a_stay_at_intervals(janus, bridge):
    leg = RobotLeg("giraff", "b1", bridge, lambda: None)
    await leg.begin(janus, 20000)
    began = leg._began
    leg.vouch(1, began)
    await leg.take_reply(ANSWER)
    for now in (began, began + 1.0, began + STAY_SECONDS + 1.0, began + STAY_SECONDS + 2.0):
        leg.vouch(2, now)
    stays = [message for _, _, message in bridge.sent if isinstance(message, m.Stay)]
    assert stays == [m.Stay(viewers=2)] * 2
