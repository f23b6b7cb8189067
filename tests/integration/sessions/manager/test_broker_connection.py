"""One look of the scheduler at what robots have said of themselves, in a real database."""

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


class Look:
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
        self._work = work
        self.reconnect()

    def reconnect(self):
        self.connection = BrokerConnection(None, self._work, lambda: self.now)

    def hear(self, message, suffix="connection"):
        topic, payload = Topic(topics.of("giraff", suffix)), codec.encode(message)
        self.gate.receive(Message(topic, payload, 1, retain=False, mid=1, properties=None))

    def tick(self):
        self.gate.follow()
        return self.connection._tick()


@pytest.fixture
def giraff():
    return Robot.objects.create(name="giraff", title="Giraff")


@pytest.fixture
def look(giraff):
    return Look()


def connection_of_giraff():
    return Robot.objects.get().presence.connection


def test_a_process_that_has_just_gone_on_after_a_stop_writes_nothing_until_it_has_beaten(look):
    look.hear(words.online())
    look.now += CONFIRMED_ALONE_SECONDS + 1.0
    assert look.tick() == []
    assert connection_of_giraff() != "ONLINE"
    look.ownership.confirm(look.now)
    look.tick()
    assert connection_of_giraff() == "ONLINE"


def test_presence_that_the_database_refused_is_stored_by_the_next_look(look, monkeypatch):
    look.hear(words.online())
    look.hear(words.factsheet(), "factsheet")
    take = PresenceWriter.take

    def away(writer, robot, message, now, **how):
        take(writer, robot, message, now, **how)
        raise OperationalError("the database is away")

    with monkeypatch.context() as patched:
        patched.setattr(PresenceWriter, "take", away)
        with pytest.raises(OperationalError):
            look.tick()
    assert connection_of_giraff() != "ONLINE"
    look.tick()
    assert connection_of_giraff() == "ONLINE"
    assert Robot.objects.get().presence.factsheet


def test_news_that_is_repeated_uses_the_allowance_of_the_system_log_once(look, monkeypatch):
    def away(*_, **__):
        raise OperationalError("the database is away")

    look.hear(words.online())
    with monkeypatch.context() as patched:
        patched.setattr(PresenceWriter, "write", away)
        for _ in range(int(LOGGED_RATE[1]) + 1):
            with pytest.raises(OperationalError):
                look.tick()
    look.tick()
    assert [entry.event for entry in SystemLog.objects.all()] == ["robot_online"]


def test_a_robot_gained_before_the_clock_was_set_back_is_missed_as_soon(look, giraff):
    ana = User.objects.create(username="ana")
    now = timezone.now()
    look.hear(words.online())
    look.tick()
    giraff.refresh_from_db()
    granted = store.take(giraff, ana, "p1", now=now)
    look.ownership.become({n: epoch for n, epoch in look.epochs.items() if n != GIRAFF})
    look.tick()
    look.ownership.become(look.epochs)
    scheduler, hour = look._work.scheduler, datetime.timedelta(hours=1)
    scheduler.tick({}, RobotLink(since=now.timestamp()), now + hour)
    for seconds in (0.0, 300.0):  # of a silent robot, after the step
        at = now + datetime.timedelta(seconds=seconds)
        scheduler.tick({}, RobotLink(since=now.timestamp()), at)
    assert Session.objects.get(pk=granted.session).state == "ended"


def test_the_presence_of_a_robot_that_is_anothers_by_now_is_left_to_its_owner(look):
    look.tick()
    look.hear(words.online())
    look.ownership.become({n: epoch for n, epoch in look.epochs.items() if n != GIRAFF})
    look.tick()
    assert connection_of_giraff() != "ONLINE"
    RobotPresence.objects.update(connection="ONLINE", boot="b1")  # by its owner
    look.ownership.become(look.epochs)
    look.hear(words.broken())
    look.tick()
    assert connection_of_giraff() == "CONNECTIONBROKEN", "the row was read anew"


def test_a_row_is_read_anew_when_shards_changed_hands_while_there_was_no_connection(look):
    look.hear(words.online())
    look.tick()
    look.ownership.become({n: epoch for n, epoch in look.epochs.items() if n != GIRAFF})
    RobotPresence.objects.update(connection="CONNECTIONBROKEN")  # by its owner
    look.ownership.become(look.epochs)
    look.reconnect()
    look.hear(words.online())
    look.tick()
    assert connection_of_giraff() == "ONLINE"


def test_a_row_is_read_anew_although_the_database_was_away_when_shards_changed_hands(
    look, monkeypatch
):
    look.hear(words.online())
    look.tick()
    look.ownership.become({n: epoch for n, epoch in look.epochs.items() if n != GIRAFF})
    RobotPresence.objects.update(connection="CONNECTIONBROKEN")  # by its owner
    look.ownership.become(look.epochs)

    def away(*_, **__):
        raise OperationalError("the database is away")

    with monkeypatch.context() as patched:
        patched.setattr(PresenceWriter, "write", away)
        with pytest.raises(OperationalError):
            look.tick()
    look.hear(words.online())
    look.tick()
    assert connection_of_giraff() == "ONLINE"


@pytest.mark.parametrize("step", [120.0, -120.0, 86_400.0])
def test_a_step_of_the_servers_clock_ends_no_drive(look, giraff, monkeypatch, step):
    """As when a virtual machine is resumed, or NTP corrects the clock."""
    ahead = [0.0]
    clock = lambda: time.time() + ahead[0]
    moment = lambda: datetime.datetime.fromtimestamp(clock(), datetime.UTC)
    monkeypatch.setattr(broker_connection.timezone, "now", moment)
    look.connection = BrokerConnection(None, look._work, clock)
    look.intake._clock = clock
    look.hear(words.online())
    look.tick()
    giraff.refresh_from_db()
    ana, ben = (User.objects.create(username=name) for name in ("ana", "ben"))
    granted = store.take(giraff, ana, "p1", now=moment())
    waiting = store.take(giraff, ben, "p2", now=moment())
    beat = {"session": granted.session, "epoch": granted.epoch, "visitor_silence": 0.1}
    look.hear(words.state(1, **beat), "state")
    look.tick()
    assert Session.objects.get(pk=granted.session).state == "driving"
    ahead[0] = step
    for seq in range(2, 5):
        look.tick()
        assert Session.objects.get(pk=granted.session).state == "driving"
        assert Session.objects.get(pk=waiting.session).state == "waiting"
        look.hear(words.state(seq, **beat), "state")
        store.seen({granted.session, waiting.session}, moment())
    kinds = SessionEvent.objects.filter(session=granted.session).values_list("type", flat=True)
    assert "server_absent" not in kinds
