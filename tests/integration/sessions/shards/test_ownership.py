"""The fence around the writes of session managers, in real databases."""

import json
import os
import subprocess
import sys

import pytest
from django.db import OperationalError, connection
from django.test.utils import CaptureQueriesContext

from accounts.models import User
from robots.api import codec, messages, topics
from robots.models import Robot
from robots.presence.writer import PresenceWriter
from sessions.leases import store
from sessions.leases.transitions import RobotLink
from sessions.manager.scheduler import ManagerMessage, Scheduler
from sessions.models import Lease, ManagerBeat, Session, SessionEvent, Shard, StateChunk
from sessions.recording.builder import RecordBuilder
from sessions.recording.items import StateItem
from sessions.recording.store import RecordStore
from sessions.shards import rows
from sessions.shards.division import ALL, Holding
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import Fenced, Ownership
from tests.support import words
from tests.support.examples import repetitions
from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres
from tests.support.robots import online_robot
from tests.support.sessions.fence_races import race
from tests.support.sessions.rows import NOW, after

SHARD = shard_of("giraff")


@pytest.fixture
def giraff(db):
    return online_robot()


@pytest.fixture
def owner(db):
    """The owner of every shard, by its rows."""
    rows.take_over([one.number for one in rows.holdings()], [""], "first")
    ownership = Ownership()
    ownership.become({one.number: one.epoch for one in rows.holdings()})
    ownership.wanted = frozenset(ownership.epochs)
    return ownership


@pytest.fixture
def session(giraff, owner):
    return store.take(giraff, User.objects.create(username="ana"), "peer-1", now=NOW).session


def take_away():
    rows.take_over([SHARD], ["first"], "second")


def lose(owner: Ownership) -> None:
    """Let the owner know that it has lost the shard of giraff."""
    owner.become({number: epoch for number, epoch in owner.epochs.items() if number != SHARD})


def state(session: str, seq: int) -> StateItem:
    published = words.state(seq, session=session, epoch=1)
    return StateItem("giraff", published, codec.encode(published), NOW.timestamp() + seq, None)


def test_takeover_increments_only_the_epochs_of_the_shards_it_takes(owner):
    before = {one.number: one.epoch for one in rows.holdings()}
    take_away()
    after = {one.number: one.epoch for one in rows.holdings()}
    assert after == before | {SHARD: before[SHARD] + 1}


def test_shards_that_another_process_has_just_created_are_read(owner, monkeypatch):
    there, read, before_it = rows.holdings(), Shard.objects.values_list, iter([True])
    monkeypatch.setattr(
        type(Shard.objects),
        "values_list",
        lambda _, *fields: [] if next(before_it, False) else read(*fields),
    )
    assert rows.holdings() == there
    assert list(before_it) == [], "holdings() has read the shards"
    assert Shard.objects.count() == len(ALL)


def test_only_the_owner_hands_over_a_shard(owner):
    before = rows.holdings()[SHARD]
    rows.hand_over([SHARD], "second", "third")
    assert rows.holdings()[SHARD] == before
    rows.hand_over([SHARD], "first", "third")
    assert rows.holdings()[SHARD] == Holding(SHARD, "third", before.epoch + 1)


def test_one_of_two_processes_that_take_a_slot_at_once_gets_it(db):
    assert rows.occupy(0, None, "first", NOW)
    assert not rows.occupy(0, None, "second", NOW)
    (member,) = rows.members()
    assert rows.beat(0, "first", member.beats + 1, NOW, {})
    assert not rows.dismiss(member), "it has beaten since"
    assert not rows.occupy(0, member, "second", NOW)
    (member,) = rows.members()
    assert rows.dismiss(member)
    (free,) = rows.members()
    assert rows.occupy(0, free, "second", NOW)
    assert [one.holder for one in rows.members()] == ["second"]


def test_last_time_of_a_session_manager_is_known_after_it_left(db):
    assert rows.last_alive() is None
    rows.occupy(0, None, "first", after(1))
    rows.occupy(1, None, "second", after(2))
    rows.give_back("second")
    assert rows.last_alive() == after(2)
    _, second = rows.members()
    rows.occupy(1, second, "third", after(3))
    rows.give_back("third")
    assert rows.last_alive() == after(3)
    ManagerBeat.objects.filter(name=rows.name_of(1)).update(report={})
    assert rows.last_alive() == after(1)


@pytest.mark.django_db(transaction=True)
def test_write_is_refused_when_the_shard_has_a_newer_epoch(session, owner):
    for expected in (1, 1):
        try:
            with owner.fenced(), owner.about("giraff"):
                Scheduler._note(session, "noted", NOW)
        except Fenced:
            assert Shard.objects.get(number=SHARD).owner == "second"
        assert SessionEvent.objects.filter(type="noted").count() == expected
        take_away()


@pytest.mark.django_db(transaction=True)
def test_write_about_no_robot_needs_every_shard_of_the_process(owner):
    with owner.fenced():
        ManagerBeat.objects.create(name="one", beat_at=NOW)
        take_away()
        with pytest.raises(Fenced):
            ManagerBeat.objects.create(name="two", beat_at=NOW)
        with owner.about("rhodon"):
            ManagerBeat.objects.create(name="three", beat_at=NOW)
    assert set(ManagerBeat.objects.values_list("name", flat=True)) == {"one", "three"}


@pytest.mark.django_db(transaction=True)
def test_process_without_shards_writes_nothing(owner):
    take_away()
    owner.become({})
    with owner.fenced(), pytest.raises(Fenced):
        ManagerBeat.objects.create(name="none", beat_at=NOW)
    assert not ManagerBeat.objects.filter(name="none").exists()


def test_reading_needs_no_additional_statement(owner):
    with CaptureQueriesContext(connection) as queries, owner.fenced():
        list(Robot.objects.all())
    assert len(queries) == 1


def test_scheduler_renews_leases_of_its_robots_only(giraff, session, owner):
    Session.objects.filter(pk=session).update(state="driving")
    scheduler = Scheduler(owner)
    assert scheduler.renew(after(1))
    take_away()
    scheduler.outbox.clear()
    assert not scheduler.renew(after(10)), "the write of the renewal's number is refused"
    assert Lease.objects.get(robot=giraff).renewal == 1


def test_only_the_present_owner_publishes_the_lease_of_a_robot(giraff, session, owner):
    Session.objects.filter(pk=session).update(state="driving")
    scheduler = Scheduler(owner)
    scheduler.begin()
    assert scheduler.renew(after(0))
    scheduler.outbox.clear()
    mine = dict(owner.epochs)
    lose(owner)
    store.end(session, "completed", "left", after(1))
    assert not scheduler.renew(after(2)), "only its new owner publishes the lease"
    owner.become(mine)
    assert scheduler.renew(after(3))
    assert [message.payload for message in scheduler.outbox] == [b""]


def test_robot_gained_while_the_database_failed_gets_its_lease(giraff, owner):
    mine = dict(owner.epochs)
    lose(owner)
    scheduler = Scheduler(owner)
    owner.become(mine)

    def away(*_):
        raise OperationalError("the database is away")

    with connection.execute_wrapper(away), pytest.raises(OperationalError):
        scheduler.renew(after(0))
    assert scheduler.renew(after(1))
    assert [message.payload for message in scheduler.outbox] == [b""], "it has no driver"


def test_robot_lost_during_the_read_of_leases_gets_no_empty_lease(giraff, session, owner):
    Session.objects.filter(pk=session).update(state="driving")
    scheduler = Scheduler(owner)
    assert scheduler.renew(after(0))
    scheduler.outbox.clear()

    def take_after_read(execute, sql, parameters, many, context):
        found = execute(sql, parameters, many, context)
        if "telepresence_sessions_lease" in sql:  # by another thread, after the query
            take_away()
            lose(owner)
        return found

    with connection.execute_wrapper(take_after_read):
        scheduler.renew(after(10))
    assert list(scheduler.outbox) == []


def test_queued_messages_of_a_robot_are_published_by_its_new_owner(giraff, session, owner):
    Session.objects.filter(pk=session).update(state="driving")
    scheduler = Scheduler(owner)
    assert scheduler.renew(after(0))
    config = ManagerMessage(topics.of("giraff", "config"), b"{}", retain=True)
    scheduler.outbox.append(config)
    lease, _ = scheduler.outbox
    lose(owner)
    store.end(session, "completed", "left", after(1))
    assert scheduler.tick({}, RobotLink(since=NOW.timestamp()), after(2)) == []
    assert not {lease, config} & set(scheduler.outbox)
    assert not SessionEvent.objects.filter(session=session, type="ended").exists()


@pytest.mark.django_db(transaction=True)
def test_record_of_an_owner_that_lost_a_robot_is_refused(session, owner):
    builder = RecordBuilder(RecordStore(owner), lambda *_: None)
    builder.take(state(session, 1))
    builder.close_all()
    take_away()
    with owner.fenced():
        builder.write()
    assert not StateChunk.objects.exists()
    assert builder.rows == []
    assert builder._store.counts["fenced"] == 1


def test_presence_of_robots_is_refused_if_the_writer_lost_one_of_them(giraff, owner):
    Robot.objects.create(name="rhodon", title="Rhodon")
    writer = PresenceWriter(fence=owner)
    for name in ("giraff", "rhodon"):
        writer.take(name, messages.Connection(boot="b", state="OFFLINE", stamp=0.0), NOW)
    with owner.fenced():
        writer.write(NOW)
    take_away()
    for name in ("giraff", "rhodon"):
        writer.take(name, messages.Connection(boot="b", state="ONLINE", stamp=0.0), NOW)
    with owner.fenced(), pytest.raises(Fenced):
        writer.write(NOW)
    lose(owner)
    with owner.fenced():
        writer.write(NOW)
    assert dict(Robot.objects.values_list("name", "presence__connection")) == {
        "giraff": "OFFLINE",
        "rhodon": "ONLINE",
    }, "once the owner knows, its own robot is written"


@pytest.mark.django_db(transaction=True)
def test_no_write_is_accepted_after_one_of_a_later_owner():
    races = race(repetitions(120, thorough=20_000))
    assert races.wrong == 0
    assert min(races.accepted, races.refused, races.taken) > 10, races


def raced(var, *arguments):
    """Return the result of races on a PostgreSQL server of their own."""
    with running_postgres() as server:
        environment = {**os.environ, "VAR_DIR": str(var), "DATABASE_URL": server.url}
        command = [sys.executable, "-m", "tests.support.sessions.fence_races", *map(str, arguments)]
        done = subprocess.run(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, check=True
        )
    found = json.loads(done.stdout)
    assert found["wrong"] == 0
    assert min(found["accepted"], found["refused"], found["taken"]) > 10, found
    return found


@pytest.mark.nightly
@pytest.mark.postgres
def test_stopped_process_does_not_block_the_writes_of_others_on_postgresql(tmp_path):
    found = raced(tmp_path, repetitions(300, thorough=100_000))
    assert found["waited"] < 4.0
    assert found["code"] != 0, "the server has ended its transaction"
    assert found["written"] != -1


@pytest.mark.parametrize(
    ("rounds", "stop"),
    [
        pytest.param(500, 3.0, marks=pytest.mark.nightly),
        pytest.param(350_000, 10.0, marks=pytest.mark.soak),
    ],
)
@pytest.mark.postgres
def test_stopped_process_writes_nothing_after_a_later_owner_on_postgresql(tmp_path, rounds, stop):
    found = raced(tmp_path, rounds, "--stop", stop)
    # PostgreSQL ends transactions of stopped processes: idle_in_transaction_session_timeout
    assert found["cut_off"] > 0 or stop < 10.0, found
