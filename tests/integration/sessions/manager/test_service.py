"""The session manager with a real broker, a real database and a robot that follows a script."""

import asyncio
import contextlib
import hashlib
import itertools
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any

import aiomqtt
import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.dispatch import Signal
from django.utils import timezone

from accounts.models import User
from robots.api import codec, messages, topics
from robots.api.disk_space import DiskSpace
from robots.models import Robot, RobotPresence
from robots.process.cancellation import cancel
from sessions import protocol, signals
from sessions.leases import readiness, store
from sessions.manager.return_to_dock import ReturnToDock
from sessions.models import (
    Lease,
    NetworkSample,
    Session,
    SessionEvent,
    Snapshot,
    StateChunk,
    SystemLog,
)
from tests.support.host_jitter import watched
from tests.support.patience import patient
from tests.support.robots import update_robots
from tests.support.sessions.recorder_rig import (
    HOST,
    ScriptedRobot,
    running_manager,
    running_mosquitto,
    wait_for,
)

pytestmark = [pytest.mark.django_db(transaction=True), pytest.mark.broker]


@pytest.fixture
def broker():
    with running_mosquitto() as broker:
        yield broker


@pytest.fixture
def giraff():
    return Robot.objects.create(name="giraff", title="Giraff")


@pytest.fixture
def visitors():
    return {name: User.objects.create(username=name) for name in ("ana", "ben", "cem")}


@sync_to_async
def take(visitor: User, peer: str = "", **words) -> store.Taken:
    robot = Robot.objects.get(name="giraff")
    return store.take(robot, visitor, peer or f"peer-{visitor}", now=timezone.now(), **words)


async def drive(visitor: User) -> str:
    """Take the robot and wait until the session drives."""
    await wait_for(
        lambda: Robot.objects.get(name="giraff").is_online(timezone.now()),
        what="the robot's presence",
    )
    session = (await take(visitor)).session
    await state_of(session, "driving")
    return session


async def state_of(session: str, state: str, within: float = 15.0) -> Session:
    return await wait_for(
        lambda: Session.objects.filter(pk=session, state=state).select_related("robot").first(),
        within,
        f"the state {state}",
    )


def stored_seqs(session: str) -> list[int]:
    seqs = []
    for chunk in StateChunk.objects.filter(session=session).order_by("first_seq"):
        assert [state["seq"] for state in chunk.states] == list(
            range(chunk.first_seq, chunk.last_seq + 1)
        )
        assert len(chunk.states) == chunk.count
        seqs += [state["seq"] for state in chunk.states]
    return seqs


async def complete(session: str, robot: ScriptedRobot, within: float = 20.0) -> None:
    """Wait until exactly the states that the robot sent are stored."""
    await wait_for(
        lambda: sorted(stored_seqs(session)) == sorted(robot.sent[session]), within, "every state"
    )


@sync_to_async
def leave(session: str, visitor: User) -> bool:
    return store.leave(session, peer=f"peer-{visitor}", now=timezone.now())


async def leave_and_complete(session: str, visitor: User, robot: ScriptedRobot) -> None:
    """Leave, and wait until the lease has ended and exactly the sent states are stored."""
    await leave(session, visitor)
    await wait_for(lambda: robot.session is None)
    await complete(session, robot)


async def closed_record(session: str, **fields: Any) -> Session:
    row = Session.objects.filter(pk=session, closed_at__isnull=False, **fields)
    return await wait_for(row.first, 15, "the closed record")


@contextlib.asynccontextmanager
async def driven(broker, visitor: User, **wish: Any) -> AsyncIterator[tuple[ScriptedRobot, str]]:
    """Run a session manager and a robot, which the visitor drives; yield the robot and the
    session.
    """
    async with running_manager(broker.url), ScriptedRobot("giraff", broker.url, **wish) as robot:
        yield robot, await drive(visitor)


@contextlib.contextmanager
def receiving(signal: Signal, receiver: Callable[..., None]) -> Iterator[None]:
    signal.connect(receiver, weak=False)
    try:
        yield
    finally:
        signal.disconnect(receiver)


# --- a drive --------------------------------------------------------------------------------------


async def test_presence_follows_the_robot(broker, giraff):
    async with running_manager(broker.url):
        async with ScriptedRobot("giraff", broker.url) as robot:
            await wait_for(
                lambda: Robot.objects.get(name="giraff").is_online(timezone.now()), what="presence"
            )
            for boot, state in (("boot-0", "CONNECTIONBROKEN"), ("boot-1", "OFFLINE")):
                connection = messages.Connection(boot=boot, state=state, stamp=1.0)
                await robot.publish("connection", connection)
            await wait_for(
                lambda: Robot.objects.get(name="giraff").presence.connection == "OFFLINE",
                what="absence",
            )
        logged = [entry.event async for entry in SystemLog.objects.order_by("at")]
        assert logged == ["robot_online", "robot_offline"]


async def test_robot_that_is_taken_during_the_first_tick_keeps_its_lease(broker, giraff, visitors):
    """On a busy computer the tick takes seconds: what the manager read before it, without a driver,
    is then out of date.
    """
    first = iter([True])

    def takes(**_news):
        if next(first, False):
            taken = store.take(
                Robot.objects.get(name="giraff"), visitors["ana"], "peer-ana", now=timezone.now()
            )
            assert isinstance(taken, store.TakeGranted)

    async with ScriptedRobot("giraff", broker.url) as robot:
        await sync_to_async(RobotPresence.objects.filter(robot__name="giraff").update)(
            connection="ONLINE", last_seen_at=timezone.now()
        )
        with receiving(signals.ticked, takes):
            async with running_manager(broker.url):
                await wait_for(lambda: any(robot.leases), what="the lease")
                await asyncio.sleep(0.5)
    given = [lease is not None for lease in robot.leases]
    assert given == sorted(given), "the lease was taken away again"


async def test_receiver_that_raises_stops_neither_the_others_nor_the_record(
    broker, giraff, visitors
):
    seen = []

    def raises(**_news):
        raise KeyError("a bug of another app")

    def receive(**news):
        seen.append(news["state"].seq)

    with (
        receiving(signals.state_received, raises),
        receiving(signals.state_received, receive),
    ):
        async with driven(broker, visitors["ana"]) as (_, session):
            await wait_for(lambda: seen and stored_seqs(session))


@pytest.mark.nightly
async def test_disk_that_does_not_answer_delays_neither_leases_nor_the_heartbeat(
    broker, giraff, visitors, monkeypatch
):
    answers, asked, published = threading.Event(), threading.Event(), []
    answers.set()
    room = DiskSpace.state

    def hangs(self):
        if not answers.is_set():
            asked.set()
            answers.wait(60)
        return room(self)

    monkeypatch.setattr(DiskSpace, "state", hangs)

    async def listen(client):
        async for message in client.messages:
            status = msgspec.json.decode(message.payload, type=messages.ManagerStatus)
            published.append(status.faults)

    async with (
        running_manager(broker.url),
        ScriptedRobot("giraff", broker.url) as robot,
        aiomqtt.Client(HOST, broker.port) as client,
    ):
        await client.subscribe(topics.MANAGER_STATUS)
        listening = asyncio.create_task(listen(client))
        await drive(visitors["ana"])
        answers.clear()
        try:
            await wait_for(asked.is_set, what="the read of the disk")
            before, leases = len(published), len(robot.leases)
            await wait_for(
                lambda: len(published) > before + 3 and len(robot.leases) > leases + 1,
                what="beats and renewals",
            )
            # a busy computer holds the database, which is another fault
            assert {*itertools.chain(*published[before:])} <= {"database"}
        finally:
            answers.set()
        await cancel(listening)


async def test_robot_that_returns_gets_heartbeats_and_no_order_after_a_stop(
    broker, giraff, visitors, monkeypatch
):
    """These heartbeats tell the robot that it could still be stopped."""
    monkeypatch.setattr(readiness, "RETRY_S", 0.2)
    looking, may_look = threading.Event(), threading.Event()
    may_look.set()
    look = ReturnToDock.tick

    def slow(*arguments):
        looking.set()
        may_look.wait(patient(20))
        return look(*arguments)

    monkeypatch.setattr(ReturnToDock, "tick", slow)
    home = {"returns_home": True, "turnaround": "returning", "turnaround_reason": "dock"}
    await sync_to_async(update_robots)(**home, factsheet={"capabilities": ["dock"]})
    async with running_manager(broker.url), ScriptedRobot("giraff", broker.url) as robot:
        await wait_for(lambda: robot.ordered, what="the order to dock")
        (dock,) = robot.ordered
        assert (type(dock), dock.role) == (messages.Dock, "server")
        robot.beats.clear()
        may_look.clear()
        looking.clear()
        try:
            await wait_for(looking.is_set, what="a slow tick")
            await wait_for(lambda: len(robot.beats) >= 7, what="heartbeats")
        finally:
            may_look.set()
        gaps = [later - before for before, later in itertools.pairwise(robot.beats)]
        assert sum(gaps) / len(gaps) < patient(0.55)
        assert max(gaps) < patient(1.0)
        robot.safety = messages.Safety(inhibited="stopped")
        await robot.publish(
            "action", messages.ActionStatus(action_id=dock.action_id, status="CANCELLED", stamp=1.0)
        )
        await wait_for(
            lambda: RobotPresence.objects.filter(
                turnaround="paused", turnaround_reason="stopped"
            ).exists(),
            what="the pause",
        )
        ordered = len(robot.ordered)
        beats = len(robot.beats)
        await wait_for(lambda: len(robot.beats) >= beats + 4, what="two more seconds")
        assert len(robot.ordered) == ordered
        robot.safety = messages.Safety()
        await wait_for(lambda: len(robot.ordered) > ordered, what="the next order to dock")


# --- complete records -----------------------------------------------------------------------------


@pytest.mark.nightly
async def test_states_that_the_broker_lost_are_requested_again(broker, giraff, visitors):
    async with running_manager(broker.url), ScriptedRobot("giraff", broker.url) as robot:
        robot.loses = lambda seq: seq % 10 in {3, 4}
        session = await drive(visitors["ana"])
        await wait_for(lambda: len(robot.sent[session]) > 40)
        await leave_and_complete(session, visitors["ana"], robot)
        assert robot.asked


@pytest.mark.nightly
async def test_missing_last_states_are_requested_after_the_session(broker, giraff, visitors):
    async with driven(broker, visitors["ana"]) as (robot, session):
        last = robot.seq + 5
        robot.loses = lambda seq: seq > last and robot.session is not None
        await wait_for(lambda: robot.seq > last + 10)
        robot.speaks = False  # no later state shows the gap either
        await leave(session, visitors["ana"])
        await wait_for(lambda: robot.session is None)
        await robot.publish("heartbeat", messages.Heartbeat(n=1, stamp=robot.now()), 0)
        await complete(session, robot)


@pytest.mark.nightly
async def test_states_that_the_agent_no_longer_has_are_counted_as_missing(broker, giraff, visitors):
    async with driven(broker, visitors["ana"]) as (robot, session):
        first = robot.seq + 2
        # the agent is killed before it answers
        robot.loses, robot.answers = (lambda seq: first <= seq < first + 4), False
        await wait_for(lambda: robot.seq > first + 6)
        robot.boot, robot.seq, robot.buffer = "boot-2", 0, {}  # the agent was killed and restarted
        robot.loses, robot.answers = (lambda _seq: False), True
        missing = await wait_for(
            lambda: SessionEvent.objects.filter(session=session, type="states_missing").first(),
            what="the loss",
        )
        assert missing.data == {"boot": "boot-1", "ranges": [[first, first + 3]], "count": 4}
        await leave(session, visitors["ana"])
        closed = await closed_record(session)
        assert closed.summary["missing"] == 4


@pytest.mark.parametrize("forget", [False, True])
async def test_restarted_broker_gets_the_lease_again_and_no_state_is_missing(
    broker, giraff, visitors, forget
):
    async with driven(broker, visitors["ana"]) as (robot, session):
        await wait_for(lambda: len(robot.sent[session]) > 20)
        broker.stop()
        # the agent keeps states while it is offline; this script only stops counting
        robot.speaks = False
        broker.start(forget=forget)
        before = len(robot.leases)
        await wait_for(lambda: len(robot.leases) > before + 1, 15, "the lease after the restart")
        robot.speaks = True
        assert robot.leases[-1].epoch == 1
        await state_of(session, "driving")
        await wait_for(lambda: len(robot.sent[session]) > 40)
        await leave_and_complete(session, visitors["ana"], robot)


async def test_retained_lease_from_before_a_crash_is_cleared(broker, giraff):
    async with aiomqtt.Client(HOST, broker.port) as client:
        stale = messages.Lease(session="old", epoch=7, peer="p", who="ana", renewal=3, stamp=1.0)
        await client.publish(topics.of("giraff", "lease"), codec.encode(stale), 1, retain=True)
    async with ScriptedRobot("giraff", broker.url) as robot:
        await wait_for(lambda: robot.leases == [stale], what="the retained lease")
        async with running_manager(broker.url):
            await wait_for(lambda: robot.leases == [stale, None], what="its removal")
        assert robot.session is None


# --- outcomes, queue, turns, grace ----------------------------------------------------------------


# --- other parts of the record --------------------------------------------------------------------


async def test_clock_offset_of_the_robot_is_stored_with_its_states(broker, giraff, visitors):
    begun = time.time()
    with watched() as computer:
        async with driven(broker, visitors["ana"], clock_ahead=3600.0) as (_, session):
            chunks = StateChunk.objects.filter(session=session, clock_offset__isnull=False)
            chunk = await wait_for(chunks.order_by("-first_seq").first)
            # a beat or a state was under way for so much longer
            late = computer.excuse(begun, time.time())
    assert chunk.clock_offset == pytest.approx(3600.0, abs=0.25 + late)
    assert chunk.first_stamp - chunk.clock_offset == pytest.approx(
        chunk.received_at, abs=0.5 + late
    )


async def test_events_page_reports_network_samples_and_photos_are_stored_once(
    broker, giraff, visitors
):
    async with (
        driven(broker, visitors["ana"]) as (robot, session),
        aiomqtt.Client(HOST, broker.port) as web,
    ):
        event = await robot.event("collision", detail="left front")
        await robot.publish("event", event)
        jpeg = b"\xff\xd8 a mirror \xff\xd9"
        await robot.publish("photo/p1", jpeg)
        await robot.event("photo", action_id="p1", sha256=hashlib.sha256(jpeg).hexdigest())
        await robot.event("photo", action_id="p2", sha256=hashlib.sha256(jpeg).hexdigest())
        await robot.publish("photo/p2", jpeg + b"damaged")
        clicked = protocol.PageEvent(
            stamp=5.0, type="controller", data={"method": "keyboard", "nul": "a\0b"}
        )
        sample = protocol.PageNetwork(stamp=6.0, way="datachannel", round_trip=0.02, fps=30.0)
        for suffix, message in (
            ("page/event", clicked),
            ("page/network", sample),
            ("page/network", sample),
        ):
            report = protocol.PageReport(
                suffix=suffix, session=session, message=msgspec.Raw(codec.encode(message))
            )
            await web.publish(protocol.page_reports(session), codec.encode(report), 1)
        await wait_for(
            lambda: (
                NetworkSample.objects.filter(session=session).exists()
                and SystemLog.objects.filter(event="photo_damaged").exists()
            )
        )

        kept = SessionEvent.objects.filter(session=session)
        assert await kept.filter(type="collision").acount() == 1
        assert (await kept.aget(source="page")).data == {"method": "keyboard", "nul": "ab"}
        network = {"way": "datachannel", "roundTrip": 0.02, "fps": 30.0}
        assert (await NetworkSample.objects.aget(session=session)).data == network
        (snapshot,) = [one async for one in Snapshot.objects.filter(session=session)]
        assert (snapshot.action_id, bytes(snapshot.jpeg)) == ("p1", jpeg)


@pytest.mark.nightly
async def test_session_that_ended_without_a_session_manager_is_closed_by_the_next(
    broker, giraff, visitors
):
    ended = []

    def receive(**news):
        ended.append(str(news["session"].pk))

    with receiving(signals.session_ended, receive):
        async with ScriptedRobot("giraff", broker.url) as robot:
            async with running_manager(broker.url):
                session = await drive(visitors["ana"])
            await leave(session, visitors["ana"])
            async with running_manager(broker.url):
                await wait_for(lambda: ended == [session])
                await wait_for(lambda: robot.session is None)
                await closed_record(session)
    assert ended == [session]
    assert not await Lease.objects.filter(session__isnull=False).aexists()
