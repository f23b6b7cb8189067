"""Ticks of the session manager, with messages of robots and a real database."""

import asyncio
import datetime
import time
from unittest import mock

import pytest
from aiomqtt import Message, Topic
from django.db import OperationalError
from django.utils import timezone

from accounts.models import User
from robots.api import codec, topics
from robots.models import Robot, RobotPresence
from robots.presence.writer import PresenceWriter
from sessions.leases import store
from sessions.leases.transitions import RobotLink
from sessions.manager import broker_connection
from sessions.manager.broker_connection import BrokerConnection, Work
from sessions.manager.health import ManagerHealth
from sessions.manager.ingest import Intake
from sessions.manager.intake_gate import IntakeGate
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.scheduler import Scheduler
from sessions.models import Session, SessionEvent, SystemLog
from sessions.recording.builder import LOGGED_RATE
from sessions.shards import rows
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import CONFIRMED_ALONE_SECONDS, Ownership
from tests.support import words

pytestmark = pytest.mark.django_db
GIRAFF = shard_of("giraff")


class TickingManager:
    """A connection without its client, and with a stopped clock."""

    def __init__(self):
        self.now, self.ownership = 1000.0, Ownership(lambda: self.now)
        rows.take_over([one.number for one in rows.holdings()], [""], "first")
        self.epochs = {one.number: one.epoch for one in rows.holdings()}
        self.ownership.become(self.epochs)
        self.ownership.wanted = frozenset(self.epochs)
        self.ownership.confirm(self.now)
        self.intake = Intake(
            mock.Mock(),
            lambda: self.now,
            wake_signals=lambda: None,
            wake_scheduler=lambda: None,
        )
        self.gate = IntakeGate(self.intake, self.ownership, lambda: self.now)
        work = Work(
            ownership=self.ownership,
            recorder=None,
            ingest=self.intake,
            gate=self.gate,
            scheduler=Scheduler(self.ownership),
            return_to_dock=ReturnToDock(self.ownership),
            presence=PresenceWriter(fence=self.ownership),
            thread=None,
            health=ManagerHealth(),
            disk=None,
            due=asyncio.Event(),
            received=asyncio.Event(),
        )
        self.work = work
        self.reconnect()

    def reconnect(self):
        self.connection = BrokerConnection(None, self.work, lambda: self.now)

    def receive(self, message, suffix="connection"):
        topic, payload = Topic(topics.of("giraff", suffix)), codec.encode(message)
        self.gate.receive(Message(topic, payload, 1, retain=False, mid=1, properties=None))

    def lose_giraff(self):
        self.ownership.become({n: epoch for n, epoch in self.epochs.items() if n != GIRAFF})

    def tick(self):
        self.gate.follow()
        return self.connection._tick()


@pytest.fixture
def giraff():
    return Robot.objects.create(name="giraff", title="Giraff")


@pytest.fixture
def manager(giraff):
    return TickingManager()


def fail(*_, **__):
    raise OperationalError("the database is unavailable")


def connection_of_giraff():
    return Robot.objects.get().presence.connection


def test_process_that_was_stopped_writes_nothing_before_its_next_beat(manager):
    manager.receive(words.online())
    manager.now += CONFIRMED_ALONE_SECONDS + 1.0
    assert manager.tick() == []
    assert connection_of_giraff() != "ONLINE"
    manager.ownership.confirm(manager.now)
    manager.tick()
    assert connection_of_giraff() == "ONLINE"


def test_presence_that_the_database_refused_is_stored_by_the_next_tick(manager, monkeypatch):
    manager.receive(words.online())
    manager.receive(words.factsheet(), "factsheet")
    take = PresenceWriter.take

    def take_and_fail(writer, robot, message, now, **how):
        take(writer, robot, message, now, **how)
        fail()

    with monkeypatch.context() as patched:
        patched.setattr(PresenceWriter, "take", take_and_fail)
        with pytest.raises(OperationalError):
            manager.tick()
    assert connection_of_giraff() != "ONLINE"
    manager.tick()
    assert connection_of_giraff() == "ONLINE"
    assert Robot.objects.get().presence.factsheet


def test_repeated_change_of_presence_is_logged_once(manager, monkeypatch):
    manager.receive(words.online())
    with monkeypatch.context() as patched:
        patched.setattr(PresenceWriter, "write", fail)
        for _ in range(int(LOGGED_RATE[1]) + 1):
            with pytest.raises(OperationalError):
                manager.tick()
    manager.tick()
    assert [entry.event for entry in SystemLog.objects.all()] == ["robot_online"]


def test_silence_of_a_robot_is_detected_after_the_clock_was_set_back(manager, giraff):
    ana = User.objects.create(username="ana")
    now = timezone.now()
    manager.receive(words.online())
    manager.tick()
    giraff.refresh_from_db()
    granted = store.take(giraff, ana, "p1", now=now)
    manager.lose_giraff()
    manager.tick()
    manager.ownership.become(manager.epochs)
    scheduler, hour = manager.work.scheduler, datetime.timedelta(hours=1)
    scheduler.tick({}, RobotLink(since=now.timestamp()), now + hour)
    for seconds in (0.0, 300.0):  # of a silent robot, after the step
        at = now + datetime.timedelta(seconds=seconds)
        scheduler.tick({}, RobotLink(since=now.timestamp()), at)
    assert Session.objects.get(pk=granted.session).state == "ended"


def test_presence_of_a_lost_robot_is_left_to_its_owner(manager):
    manager.tick()
    manager.receive(words.online())
    manager.lose_giraff()
    manager.tick()
    assert connection_of_giraff() != "ONLINE"
    RobotPresence.objects.update(connection="ONLINE", boot="b1")  # by its owner
    manager.ownership.become(manager.epochs)
    manager.receive(words.broken())
    manager.tick()
    assert connection_of_giraff() == "CONNECTIONBROKEN", "the row was read again"


def test_row_is_read_again_when_its_shard_changed_owners_without_a_connection(manager):
    manager.receive(words.online())
    manager.tick()
    manager.lose_giraff()
    RobotPresence.objects.update(connection="CONNECTIONBROKEN")  # by its owner
    manager.ownership.become(manager.epochs)
    manager.reconnect()
    manager.receive(words.online())
    manager.tick()
    assert connection_of_giraff() == "ONLINE"


def test_row_is_read_again_although_the_database_failed_at_the_change_of_owner(
    manager, monkeypatch
):
    manager.receive(words.online())
    manager.tick()
    manager.lose_giraff()
    RobotPresence.objects.update(connection="CONNECTIONBROKEN")  # by its owner
    manager.ownership.become(manager.epochs)

    with monkeypatch.context() as patched:
        patched.setattr(PresenceWriter, "write", fail)
        with pytest.raises(OperationalError):
            manager.tick()
    manager.receive(words.online())
    manager.tick()
    assert connection_of_giraff() == "ONLINE"


@pytest.mark.parametrize("step", [120.0, -120.0, 86_400.0])
def test_step_of_the_servers_clock_ends_no_drive(manager, giraff, monkeypatch, step):
    """As when a virtual machine is resumed, or NTP corrects the clock."""
    ahead = [0.0]
    clock = lambda: time.time() + ahead[0]
    moment = lambda: datetime.datetime.fromtimestamp(clock(), datetime.UTC)
    monkeypatch.setattr(broker_connection.timezone, "now", moment)
    manager.connection = BrokerConnection(None, manager.work, clock)
    manager.intake._clock = clock
    manager.receive(words.online())
    manager.tick()
    giraff.refresh_from_db()
    ana, ben = (User.objects.create(username=name) for name in ("ana", "ben"))
    granted = store.take(giraff, ana, "p1", now=moment())
    waiting = store.take(giraff, ben, "p2", now=moment())
    beat = {"session": granted.session, "epoch": granted.epoch, "visitor_silence": 0.1}
    manager.receive(words.state(1, **beat), "state")
    manager.tick()
    assert Session.objects.get(pk=granted.session).state == "driving"
    ahead[0] = step
    for seq in range(2, 5):
        manager.tick()
        assert Session.objects.get(pk=granted.session).state == "driving"
        assert Session.objects.get(pk=waiting.session).state == "waiting"
        manager.receive(words.state(seq, **beat), "state")
        store.seen({granted.session, waiting.session}, moment())
    kinds = SessionEvent.objects.filter(session=granted.session).values_list("type", flat=True)
    assert "server_absent" not in kinds
