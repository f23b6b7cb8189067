"""The recorder and its database, when things go wrong."""

import hashlib
import itertools
import threading
import time
from dataclasses import replace
from unittest import mock

import msgspec
import pytest
from aiomqtt import Message, Topic
from django.db import IntegrityError, OperationalError, connection
from django.test.utils import CaptureQueriesContext
from django.utils import timezone

from accounts.models import User
from robots.api import codec, messages, topics
from robots.models import Robot
from sessions import protocol
from sessions.manager.ingest import Intake
from sessions.models import Session, SessionEvent, Snapshot, StateChunk, SystemLog
from sessions.recording import store as record_store
from sessions.recording.builder import GIVE_UP_SECONDS, RecordBuilder
from sessions.recording.items import (
    CloseItem,
    EventItem,
    PageItem,
    PhotoItem,
    ReleaseItem,
    StateItem,
)
from sessions.recording.recorder import BufferLimits, Recorder
from sessions.recording.store import RecordStore, new_key
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import Ownership
from tests.support.patience import patient

pytestmark = pytest.mark.django_db(transaction=True)
NOW = 1_700_000_000.0


@pytest.fixture
def session() -> Session:
    robot = Robot.objects.create(name="giraff", title="Giraff")
    visitor = User.objects.create(username="ana")
    return Session.objects.create(
        robot=robot, visitor=visitor, state="driving", live_key="k", queued_at=timezone.now()
    )


def state_item(
    session,
    seq: int,
    *,
    boot: str = "b",
    robot: str = "giraff",
    payload: bytes | None = None,
    **changes,
) -> StateItem:
    state = messages.State(
        stamp=NOW + seq * 0.25,
        boot=boot,
        seq=seq,
        session=None if session is None else str(session.pk),
        epoch=1,
        pose=messages.Pose(x=0, y=0, theta=0),
        velocity=messages.Velocity(linear=0, angular=0),
        battery=messages.Battery(charge=1),
        **changes,
    )
    return StateItem(robot, state, payload or codec.encode(state), NOW + seq * 0.25, 0.01)


def event_item(session, kind: str, seq: int = 1, **fields) -> EventItem:
    event = messages.Event(
        stamp=NOW, boot="b", seq=seq, session=str(session.pk), epoch=1, type=kind, **fields
    )
    return EventItem("giraff", event, NOW)


def stored(session) -> list[int]:
    return [
        state["seq"]
        for chunk in StateChunk.objects.filter(session=session).order_by("first_seq")
        for state in chunk.states
    ]


def builder() -> RecordBuilder:
    return RecordBuilder(RecordStore(), lambda *_: None)


def wait_until(condition, seconds: float = 10.0):
    deadline = time.monotonic() + patient(seconds)
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class Flaky:
    """A database that refuses every write while `away`."""

    def __init__(self, monkeypatch) -> None:
        self.away = threading.Event()
        self.refused = 0
        insert = RecordStore.insert

        def sometimes(store, rows, **words):
            if self.away.is_set():
                self.refused += 1
                raise OperationalError("the database is away")
            insert(store, rows, **words)

        monkeypatch.setattr(RecordStore, "insert", sometimes)


def test_rows_are_kept_while_the_database_is_away_and_written_when_it_is_back(session, monkeypatch):
    database = Flaky(monkeypatch)
    database.away.set()
    recorder = Recorder(lambda *_: None, clock=lambda: NOW + 1000)
    recorder.start()
    for seq in range(1, 101):
        assert recorder.put(state_item(session, seq))
    wait_until(lambda: database.refused >= 2)
    assert stored(session) == []
    database.away.clear()
    assert recorder.stop(patient(10))
    assert stored(session) == list(range(1, 101))


def test_a_full_buffer_counts_what_it_drops_and_the_record_misses_it(session, monkeypatch, caplog):
    database, asked = Flaky(monkeypatch), []
    database.away.set()
    clock = [NOW]
    recorder = Recorder(
        lambda *words: asked.append(words), limits=BufferLimits(items=20), clock=lambda: clock[0]
    )
    recorder.put(event_item(session, "lease_taken"))
    recorder.put(state_item(session, 1))
    recorder.start()
    wait_until(lambda: (clock.__setitem__(0, clock[0] + 1), database.refused)[1])
    kept = [seq for seq in range(2, 41) if recorder.put(state_item(session, seq))]
    assert kept == list(range(2, 22))
    assert recorder.counts["dropped"] == 19
    assert "record_buffer_full" in caplog.text
    database.away.clear()
    wait_until(lambda: recorder.put(state_item(session, 41)))
    clock[0] = NOW + 41 * 0.25 + 2.0
    wait_until(lambda: asked)
    assert asked[0] == ("giraff", "b", 22, 40)
    assert recorder.stop(patient(10))
    assert stored(session) == [*range(1, 22), 41]


def test_stopping_writes_what_is_there(session):
    recorder = Recorder(lambda *_: None, clock=lambda: NOW)
    recorder.start()
    for seq in range(1, 4):
        recorder.put(state_item(session, seq))
    assert recorder.stop(patient(10))
    assert stored(session) == [1, 2, 3]


def test_a_session_manager_that_was_held_up_while_another_took_over_doubles_nothing(session):
    one, other = builder(), builder()
    for seq in range(1, 21):
        one.take(state_item(session, seq))
    for seq in range(3, 31):
        other.take(state_item(session, seq))
    for each in (one, other):
        each.close_all()
    one.write()
    other.write(careful=True)
    assert sorted(stored(session)) == list(range(1, 31))


def test_a_batch_that_was_committed_although_it_seemed_to_fail_is_not_written_twice(
    session, monkeypatch
):
    record = builder()
    for seq in range(1, 9):
        record.take(state_item(session, seq))
    record.close_all()
    insert = RecordStore.insert

    def committed_but_the_answer_was_lost(store, rows, **words):
        insert(store, rows, **words)
        raise OperationalError("connection reset")

    monkeypatch.setattr(RecordStore, "insert", committed_but_the_answer_was_lost)
    with pytest.raises(OperationalError):
        record.write()
    monkeypatch.setattr(RecordStore, "insert", insert)
    record.write()
    assert stored(session) == list(range(1, 9))


def test_a_restarted_recorder_knows_what_is_stored(session):
    first = builder()
    for seq in range(1, 10):
        first.take(state_item(session, seq))
    first.close_all()
    first.write()
    second = builder()
    for seq in range(5, 15):
        second.take(state_item(session, seq))
    second.close_all()
    second.write()
    assert stored(session) == list(range(1, 15))
    assert second.counts["duplicates"] == 5


def test_a_session_that_was_deleted_meanwhile_spoils_nobody_elses_rows(session):
    other = Session.objects.create(
        robot=session.robot,
        visitor=User.objects.create(username="ben"),
        state="driving",
        live_key="k2",
        queued_at=timezone.now(),
    )
    record = builder()
    for seq in range(1, 5):
        record.take(state_item(session, seq))
        record.take(state_item(other, seq + 10))
    session.delete()
    record.close_all()
    record.write()
    assert stored(other) == [11, 12, 13, 14]
    assert StateChunk.objects.count() == len(
        {chunk.pk for chunk in StateChunk.objects.filter(session=other)}
    )


def test_states_of_a_session_of_another_robot_or_of_none_are_not_recorded(session):
    record = builder()
    record.take(state_item(session, 1, robot="rogue"))
    for name in ("not-a-uuid", "7d9f1c52-0000-4000-8000-000000000000"):
        state = msgspec.structs.replace(state_item(session, 2).state, session=name)
        record.take(StateItem("giraff", state, codec.encode(state), NOW, None))
    record.close_all()
    record.write()
    assert not StateChunk.objects.exists()
    assert record.counts["foreign_session"] == 3


def test_fields_that_nobody_knows_yet_are_kept_and_nul_characters_are_not(session):
    payload = (
        codec.encode(state_item(session, 1).state)[:-1]
        + b',"newer":{"a\\u0000b":"c\\u0000d","n":[1]}}'
    )
    assert isinstance(codec.decode("state", payload), messages.State)
    record = builder()
    record.take(state_item(session, 1, payload=payload))
    record.close_all()
    record.write()
    assert StateChunk.objects.get().states[0]["newer"] == {"ab": "cd", "n": [1]}


def test_on_mongodb_the_values_themselves_are_stored(session, monkeypatch):
    monkeypatch.setattr(connection, "vendor", "mongodb")
    record = builder()
    record.take(state_item(session, 1))
    record.close_all()
    assert record.rows[0].states[0]["seq"] == 1


def test_events_that_come_twice_also_across_a_restart_are_one_row(session):
    for _ in range(2):
        record = builder()
        record.take(event_item(session, "collision", detail="left"))
        record.take(event_item(session, "collision", detail="left"))
        record.take(event_item(session, "collision", seq=2))
        record.write()
    assert sorted(SessionEvent.objects.values_list("data__seq", flat=True)) == [1, 2]


def test_events_of_general_importance_are_also_in_the_system_log(session):
    record = builder()
    record.take(event_item(session, "estop", detail="button"))
    record.take(
        EventItem(
            "giraff",
            messages.Event(stamp=NOW, boot="b", seq=2, type="adapter_lost", detail="no ROS master"),
            NOW,
        )
    )
    record.write()
    logged = {
        entry.event: (entry.level, entry.session_id, entry.fields["detail"])
        for entry in SystemLog.objects.all()
    }
    assert logged == {
        "estop": ("warning", session.pk, "button"),
        "adapter_lost": ("error", None, "no ROS master"),
    }
    assert SessionEvent.objects.get().type == "estop"


def test_half_a_photo_is_noted_and_a_whole_one_kept_once(session):
    record, jpeg = builder(), b"\xff\xd8"
    sha256 = hashlib.sha256(jpeg).hexdigest()
    record.take(PhotoItem("giraff", "lost", jpeg, NOW))
    for _ in range(2):
        record.take(PhotoItem("giraff", "a", jpeg, NOW))
        record.take(event_item(session, "photo", action_id="a", sha256=sha256))
    record.settle(NOW + 100)
    record.write()
    assert [snapshot.sha256 for snapshot in Snapshot.objects.all()] == [sha256]
    assert SystemLog.objects.get(event="photo_incomplete").fields == {"action": "lost"}


def end(session: Session) -> CloseItem:
    Session.objects.filter(pk=session.pk).update(state="ended", ended_at=timezone.now())
    return CloseItem("giraff", str(session.pk), NOW + 10)


def test_a_record_is_closed_when_something_later_was_heard_and_nothing_is_owed(session):
    record = builder()
    record.take(event_item(session, "lease_taken"))
    for seq in (1, 2, 5):
        record.take(state_item(session, seq))
    record.take(end(session))
    record.close_sessions(NOW + 15)
    assert Session.objects.get().closed_at is None, "nothing later was heard"
    record.take(state_item(None, 41))
    record.close_sessions(NOW + 15)
    assert Session.objects.get().closed_at is None, "3 and 4 are owed"
    for seq in range(3, 41):
        record.take(state_item(session if seq < 5 else None, seq))
    record.close_all()
    record.write()
    record.close_sessions(NOW + 15)
    assert Session.objects.get().summary["states"] == 5


def test_a_record_of_a_robot_that_is_gone_is_closed_after_a_while(session):
    record = builder()
    record.take(state_item(session, 1))
    record.take(end(session))
    record.write()
    ended = NOW + 10
    record.close_sessions(ended + GIVE_UP_SECONDS)
    assert Session.objects.get().closed_at is None
    record.close_sessions(ended + GIVE_UP_SECONDS + 1)
    assert Session.objects.get().summary["states"] == 1


def test_a_record_waits_for_states_that_a_robot_hears_of_only_after_forty_seconds(session):
    asked = []
    record = RecordBuilder(RecordStore(), lambda *words: asked.append(words))
    record.take(state_item(session, 0))
    record.take(state_item(session, 3))
    record.take(end(session))
    for seconds in range(1, 40):
        record.take(replace(state_item(None, 3 + seconds), received_at=NOW + seconds))
        record.settle(NOW + seconds)
        record.write()
        record.close_sessions(NOW + seconds)
    assert set(asked) == {("giraff", "b", 1, 2)}
    assert Session.objects.get().closed_at is None
    for seq in (1, 2):
        record.take(replace(state_item(session, seq), received_at=NOW + 39.9))
    record.settle(NOW + 40)
    record.write()
    record.close_sessions(NOW + 40)
    assert Session.objects.get().summary["states"] == 4
    assert stored(session) == [0, 1, 2, 3]


def test_states_that_a_former_manager_could_not_store_are_asked_for_by_the_next(session):
    """The database was away when the first one was replaced, and the session was over by then."""
    former = builder()
    former.take(event_item(session, "lease_taken", seq=0))
    for seq in range(10):
        former.take(state_item(session, seq))
    former.close_all()
    former.write()
    for seq in range(10, 20):
        former.take(state_item(session, seq))  # and never written
    asked = []
    following = RecordBuilder(RecordStore(), lambda *words: asked.append(words))
    following.take(state_item(None, 25))
    following.take(end(session))
    following.settle(NOW + 8)
    following.settle(NOW + 10)
    assert asked == [("giraff", "b", 10, 24)]
    following.take(state_item(None, 50))
    following.close_sessions(NOW + 13)
    assert Session.objects.get().closed_at is None
    for seq in range(10, 25):
        following.take(state_item(session if seq < 20 else None, seq))
    following.settle(NOW + 14)
    following.write()
    following.close_sessions(NOW + 14)
    assert stored(session) == list(range(20))
    assert Session.objects.get().summary["states"] == 20


@pytest.mark.parametrize(("granted", "asked_for"), [(True, [(260, 499)]), (False, [])])
def test_a_session_of_which_nothing_was_stored_is_looked_for_if_it_had_the_robot(
    session, granted, asked_for
):
    asked = []
    record = RecordBuilder(RecordStore(), lambda *words: asked.append(words[2:]))
    record.take(state_item(None, 500))
    record.take(replace(end(session), granted=granted))
    last = NOW + 500 * 0.25
    record.settle(last)
    record.settle(last + 2)
    assert asked == asked_for


def test_a_closed_record_is_opened_again_when_states_come_late(session):
    record = builder()
    record.take(state_item(session, 1))
    record.take(end(session))
    record.write()
    record.close_sessions(NOW + 100)
    assert Session.objects.get().closed_at is not None
    later = builder()
    later.take(state_item(session, 2))
    later.close_all()
    later.write()
    assert Session.objects.get().closed_at is None
    later.take(end(session))
    later.close_sessions(NOW + 200)
    assert Session.objects.get().summary["states"] == 2


def test_an_error_that_is_not_the_databases_is_noticed(session, monkeypatch):
    monkeypatch.setattr(RecordBuilder, "take", lambda *_: 1 / 0)
    recorder, silenced = Recorder(lambda *_: None), threading.excepthook
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    recorder.start()
    recorder.put(state_item(session, 1))
    wait_until(lambda: not recorder.is_alive)
    assert silenced is not None


def test_keys_sort_by_time_and_never_repeat():
    keys = [new_key(NOW + second) for second in range(100)]
    assert sorted(keys) == keys
    assert {key.version for key in keys} == {7}
    assert len({new_key(NOW) for _ in range(1000)}) == 1000


def test_a_row_that_no_database_takes_is_counted_and_dropped(session, monkeypatch, caplog):
    record = builder()
    record.take(event_item(session, "collision"))
    record.take(event_item(session, "docked"))
    monkeypatch.setattr(record_store, "BATCH", 10)
    save = SessionEvent.save

    def picky(row, **words):
        if row.type == "collision":
            raise IntegrityError("no")
        save(row, **words)

    monkeypatch.setattr(SessionEvent, "save", picky)
    monkeypatch.setattr(
        type(SessionEvent.objects),
        "bulk_create",
        lambda *_, **__: (_ for _ in ()).throw(IntegrityError("a batch")),
    )
    record.write()
    assert [event.type for event in SessionEvent.objects.all()] == ["docked"]
    assert "record_row_refused" in caplog.text


# --- robots that are shared among session managers ------------------------------------------------


def owning(*robots: str) -> Ownership:
    ownership = Ownership()
    ownership.become({shard_of(robot): 1 for robot in robots})
    return ownership


def page_item(session, at: float, kind: str = "blur") -> PageItem:
    message = msgspec.Raw(codec.encode(protocol.PageEvent(stamp=1.0, type=kind)))
    report = protocol.PageReport(suffix="page/event", session=str(session), message=message)
    return PageItem(report, at)


def kinds(record: RecordBuilder) -> list[str]:
    return [row.type for row in record.rows if isinstance(row, SessionEvent)]


def test_recent_page_reports_are_recorded_when_their_robot_becomes_ours(session):
    ownership = owning()
    record = RecordBuilder(RecordStore(ownership), lambda *_: None)
    for at, kind in ((NOW, "long_ago"), (NOW + 8, "first"), (NOW + 9, "second")):
        record.take(page_item(session.pk, at, kind))
    record.settle(NOW + 10)
    assert record.rows == []
    ownership.become({shard_of("giraff"): 1})
    record.settle(NOW + 10)
    assert kinds(record) == ["first", "second"]
    record.settle(NOW + 11)
    assert len(record.rows) == 2


def test_a_robot_that_is_given_away_is_written_down_and_read_anew_when_it_is_back(session):
    ownership, done = owning("giraff", "rhodon"), []
    record = RecordBuilder(RecordStore(ownership), lambda *_: None)
    record.take(state_item(session, 1))
    record.take(state_item(None, 7, robot="rhodon"))
    record.take(end(session))
    record.take(ReleaseItem(lambda robot: robot == "giraff", lambda: done.append(True)))
    assert [row.last_seq for row in record.rows] == [1]
    ownership.become({shard_of("rhodon"): 1})
    ownership.leaving = {shard_of("giraff"): 1}
    record.close_sessions(NOW + 1000)
    assert Session.objects.get().closed_at is None, "its next session manager does that"
    assert done == []
    record.write()
    record.tell_released()
    record.tell_released()
    assert done == [True]
    other = builder()  # of the process that has it now
    other.take(state_item(session, 2))
    other.close_all()
    other.write()
    ownership.become({shard_of("rhodon"): 1, shard_of("giraff"): 3})
    for seq in (1, 2, 3):
        record.take(state_item(session, seq))
    assert record.counts["duplicates"] == 2
    record.close_all()
    record.write()
    assert stored(session) == [1, 2, 3]


def test_reports_of_unknown_sessions_and_malformed_ones_are_counted(session):
    record = builder()
    record.take(page_item("7d9f1c52-0000-4000-8000-000000000000", NOW))
    for junk in (b'{"stamp":1}', b'"\xff"'):
        report = protocol.PageReport(
            suffix="page/event", session=str(session.pk), message=msgspec.Raw(junk)
        )
        record.take(PageItem(report, NOW))
    assert (record.counts["unknown_session"], record.counts["malformed_report"]) == (1, 2)
    assert record.rows == []


def test_a_photo_of_another_robots_session_is_not_kept(session):
    record, jpeg = builder(), b"\xff\xd8"
    event = event_item(session, "photo", action_id="a", sha256=hashlib.sha256(jpeg).hexdigest())
    record.take(PhotoItem("rogue", "a", jpeg, NOW))
    record.take(EventItem("rogue", event.event, NOW))
    assert record.rows == []
    assert record.counts["foreign_session"] == 2


def test_of_a_robot_that_restarts_again_and_again_the_last_runs_are_followed(session):
    asked = []
    record = RecordBuilder(RecordStore(), lambda *words: asked.append(words))
    for number in range(1, 11):
        record.take(state_item(session, 0, boot=f"run-{number}"))
    assert list(record._runs._trackers["giraff"]) == ["run-8", "run-9", "run-10"]
    record.take(state_item(session, 4, boot="run-10"))
    record.settle(NOW + 3)
    assert asked == [("giraff", "run-10", 1, 3)]


def test_the_number_of_the_last_state_tells_of_those_that_never_came(session):
    asked = []
    record = RecordBuilder(RecordStore(), lambda *words: asked.append(words))
    record.take(event_item(session, "lease_taken"))
    record.settle(NOW)  # a robot without states gets no requests
    record.take(state_item(session, 1))
    record.take(event_item(session, "session_closed", seq=2))  # of an agent that does not know it
    record.settle(NOW + 3)
    assert asked == []
    record.take(event_item(session, "session_closed", seq=3, last_seq=5))
    record.settle(NOW + 3)
    assert asked == [("giraff", "b", 2, 5)]


def test_photos_of_one_robot_leave_room_for_the_record_of_others(session, monkeypatch):
    database = Flaky(monkeypatch)
    database.away.set()
    recorder = Recorder(lambda *_: None, clock=lambda: NOW)
    photo = bytes(512 * 1024)
    sent = [PhotoItem("rhodon", f"a{number}", photo, NOW) for number in range(300)]
    kept = [item for item in sent if recorder.put(item)]
    assert len(kept) * len(photo) <= BufferLimits().each
    others = [PhotoItem(f"robot-{n % 20}", f"b{n}", photo, NOW) for n in range(1000)]
    kept += [item for item in others if recorder.put(item)]
    assert len(kept) * len(photo) <= BufferLimits().total
    assert recorder.counts["dropped"] == 1300 - len(kept)


def test_a_robot_that_reports_emergency_stops_without_end_fills_no_log(session, caplog):
    record = builder()
    milliseconds = itertools.count()
    intake = Intake(
        mock.Mock(put=record.take),
        lambda: NOW + next(milliseconds) / 1000,
        wake_signals=lambda: None,
        wake_scheduler=lambda: None,
    )
    topic = Topic(topics.of("giraff", "event"))
    for seq in range(2000):
        event = messages.Event(stamp=NOW, boot="b", seq=seq, type="estop")
        said = codec.encode(event)
        intake.receive(Message(topic, said, 1, retain=False, mid=1, properties=None))
    record.write()
    assert SystemLog.objects.filter(event="estop").count() == 30
    assert record.counts["unlogged"] == 1970
    record.take(EventItem("giraff", event, NOW + 11.0))
    record.write()
    assert SystemLog.objects.filter(event="estop").count() == 31, "one more after ten seconds"


def test_of_sessions_whose_records_are_closed_nothing_is_kept_in_memory(session):
    record = builder()
    rows = [
        Session.objects.create(
            robot=session.robot,
            visitor=session.visitor,
            state="ended",
            live_key=f"k{n}",
            queued_at=timezone.now(),
        )
        for n in range(3)
    ]
    for seq, row in enumerate([*rows, session], start=1):
        record.take(event_item(row, "lease_taken", seq))
        record.take(state_item(row, seq))
        record.take(CloseItem("giraff", str(row.pk), NOW))
        record.settle(NOW + 1.0)
        record.write()
        record.close_sessions(NOW + GIVE_UP_SECONDS + 1.0)
    assert not Session.objects.filter(closed_at=None).exists()
    parts = repr([vars(part) for part in (record, record._store, record._runs)])
    assert not [row for row in rows if str(row.pk) in parts]


def test_rows_of_a_deleted_session_cost_no_check_of_the_whole_database(session):
    record = builder()
    for seq in range(1, 200, 10):
        record.take(state_item(session, seq))
        record.take(event_item(session, "docked", seq))
    record.close_all()
    session.delete()
    with CaptureQueriesContext(connection) as asked:
        record.write()
    assert record.counts["refused"] + record._store.counts["refused"] > 20
    assert not SessionEvent.objects.exists()
    assert not [query["sql"] for query in asked if "foreign_key_check" in query["sql"]]
