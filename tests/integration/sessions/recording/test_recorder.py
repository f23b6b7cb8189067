"""The recorder, also when its database fails."""

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

from accounts.models import AuditEntry, User
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
from tests.support import words
from tests.support.patience import patient
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db(transaction=True)
NOW = 1_700_000_000.0


@pytest.fixture
def session() -> Session:
    robot = Robot.objects.create(name="giraff", title="Giraff")
    return session_row(robot, User.objects.create(username="ana"), state="driving")


def state_item(
    session,
    seq: int,
    *,
    boot: str = "b",
    robot: str = "giraff",
    payload: bytes | None = None,
) -> StateItem:
    own = {"session": None if session is None else str(session.pk), "epoch": 1}
    state = words.state(seq, stamp=NOW + seq * 0.25, boot=boot, **own)
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


def write_all(record: RecordBuilder) -> None:
    record.close_all()
    record.write()


def builder_with_requests() -> tuple[RecordBuilder, list[tuple]]:
    """Return a builder, and the requests for missing states that it makes."""
    requests = []
    return RecordBuilder(RecordStore(), lambda *words: requests.append(words)), requests


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


def test_rows_are_kept_while_the_database_is_unavailable(session, monkeypatch):
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


def test_full_buffer_counts_dropped_states_and_requests_them_again(session, monkeypatch, caplog):
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


def test_stopping_writes_all_rows(session):
    recorder = Recorder(lambda *_: None, clock=lambda: NOW)
    recorder.start()
    for seq in range(1, 4):
        recorder.put(state_item(session, seq))
    assert recorder.stop(patient(10))
    assert stored(session) == [1, 2, 3]


def test_delayed_session_manager_and_its_successor_store_each_state_once(session):
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


def test_batch_whose_commit_was_not_confirmed_is_not_written_twice(session, monkeypatch):
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


def test_restarted_recorder_does_not_store_states_again(session):
    first = builder()
    for seq in range(1, 10):
        first.take(state_item(session, seq))
    write_all(first)
    second = builder()
    for seq in range(5, 15):
        second.take(state_item(session, seq))
    write_all(second)
    assert stored(session) == list(range(1, 15))
    assert second.counts["duplicates"] == 5


def test_rows_of_a_deleted_session_do_not_affect_other_rows(session):
    other = session_row(session.robot, User.objects.create(username="ben"), state="driving")
    record = builder()
    for seq in range(1, 5):
        record.take(state_item(session, seq))
        record.take(state_item(other, seq + 10))
    session.delete()
    write_all(record)
    assert stored(other) == [11, 12, 13, 14]
    assert not StateChunk.objects.exclude(session=other).exists()


def test_states_of_unknown_sessions_and_of_other_robots_are_not_recorded(session):
    record = builder()
    record.take(state_item(session, 1, robot="rogue"))
    for name in ("not-a-uuid", "7d9f1c52-0000-4000-8000-000000000000"):
        state = msgspec.structs.replace(state_item(session, 2).state, session=name)
        record.take(StateItem("giraff", state, codec.encode(state), NOW, None))
    write_all(record)
    assert not StateChunk.objects.exists()
    assert record.counts["foreign_session"] == 3


def test_unknown_fields_are_stored_and_nul_characters_are_removed(session):
    newer = b',"newer":{"a\\u0000b":"c\\u0000d","n":[1]}}'
    payload = codec.encode(state_item(session, 1).state)[:-1] + newer
    assert isinstance(codec.decode("state", payload), messages.State)
    record = builder()
    record.take(state_item(session, 1, payload=payload))
    write_all(record)
    assert StateChunk.objects.get().states[0]["newer"] == {"ab": "cd", "n": [1]}


def test_mongodb_stores_values_instead_of_json_text(session, monkeypatch):
    monkeypatch.setattr(connection, "vendor", "mongodb")
    record = builder()
    record.take(state_item(session, 1))
    record.close_all()
    assert record.rows[0].states[0]["seq"] == 1


def test_repeated_event_is_stored_once_also_across_a_restart(session):
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
    lost = messages.Event(stamp=NOW, boot="b", seq=2, type="adapter_lost", detail="no ROS master")
    record.take(EventItem("giraff", lost, NOW))
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


def test_photo_is_stored_once_and_an_incomplete_one_is_logged(session):
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


def test_record_closes_when_no_states_are_missing_before_a_later_message(session):
    record = builder()
    record.take(event_item(session, "lease_taken"))
    for seq in (1, 2, 5):
        record.take(state_item(session, seq))
    record.take(end(session))
    record.close_sessions(NOW + 15)
    assert Session.objects.get().closed_at is None, "no later message has arrived"
    record.take(state_item(None, 41))
    record.close_sessions(NOW + 15)
    assert Session.objects.get().closed_at is None, "3 and 4 are missing"
    for seq in range(3, 41):
        record.take(state_item(session if seq < 5 else None, seq))
    write_all(record)
    record.close_sessions(NOW + 15)
    assert Session.objects.get().summary["states"] == 5


def test_record_of_a_silent_robot_closes_after_a_time_limit(session):
    record = builder()
    record.take(state_item(session, 1))
    record.take(end(session))
    record.write()
    ended = NOW + 10
    record.close_sessions(ended + GIVE_UP_SECONDS)
    assert Session.objects.get().closed_at is None
    record.close_sessions(ended + GIVE_UP_SECONDS + 1)
    assert Session.objects.get().summary["states"] == 1


def test_record_waits_for_missing_states_for_forty_seconds(session):
    record, asked = builder_with_requests()
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


def test_states_that_the_previous_manager_lost_are_requested_by_the_next(session):
    """The database was unavailable when the first one was replaced, after the session."""
    former = builder()
    former.take(event_item(session, "lease_taken", seq=0))
    for seq in range(10):
        former.take(state_item(session, seq))
    write_all(former)
    for seq in range(10, 20):
        former.take(state_item(session, seq))  # and never written
    following, asked = builder_with_requests()
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
def test_states_of_an_empty_record_are_requested_if_it_had_the_robot(session, granted, asked_for):
    record, asked = builder_with_requests()
    record.take(state_item(None, 500))
    record.take(replace(end(session), granted=granted))
    last = NOW + 500 * 0.25
    record.settle(last)
    record.settle(last + 2)
    assert [request[2:] for request in asked] == asked_for


def test_late_states_open_a_closed_record_again(session):
    record = builder()
    record.take(state_item(session, 1))
    record.take(end(session))
    record.write()
    record.close_sessions(NOW + 100)
    assert Session.objects.get().closed_at is not None
    later = builder()
    later.take(state_item(session, 2))
    write_all(later)
    assert Session.objects.get().closed_at is None
    later.take(end(session))
    later.close_sessions(NOW + 200)
    assert Session.objects.get().summary["states"] == 2


def test_recorder_ends_on_a_programming_error(session, monkeypatch):
    monkeypatch.setattr(RecordBuilder, "take", lambda *_: 1 / 0)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    recorder = Recorder(lambda *_: None)
    recorder.start()
    recorder.put(state_item(session, 1))
    wait_until(lambda: not recorder.is_alive)


def test_keys_are_unique_and_sort_by_time():
    keys = [new_key(NOW + second) for second in range(100)]
    assert sorted(keys) == keys
    assert {key.version for key in keys} == {7}
    assert len({new_key(NOW) for _ in range(1000)}) == 1000


def test_row_that_the_database_refuses_is_dropped_and_logged(session, monkeypatch, caplog):
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


def test_released_robot_is_written_and_read_again_when_it_returns(session):
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
    write_all(other)
    ownership.become({shard_of("rhodon"): 1, shard_of("giraff"): 3})
    for seq in (1, 2, 3):
        record.take(state_item(session, seq))
    assert record.counts["duplicates"] == 2
    write_all(record)
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


def test_photo_of_another_robots_session_is_not_stored(session):
    record, jpeg = builder(), b"\xff\xd8"
    event = event_item(session, "photo", action_id="a", sha256=hashlib.sha256(jpeg).hexdigest())
    record.take(PhotoItem("rogue", "a", jpeg, NOW))
    record.take(EventItem("rogue", event.event, NOW))
    assert record.rows == []
    assert record.counts["foreign_session"] == 2


def test_only_the_last_three_runs_of_a_robot_are_tracked(session):
    record, asked = builder_with_requests()
    for number in range(1, 11):
        record.take(state_item(session, 0, boot=f"run-{number}"))
    assert list(record._runs._trackers["giraff"]) == ["run-8", "run-9", "run-10"]
    record.take(state_item(session, 4, boot="run-10"))
    record.settle(NOW + 3)
    assert asked == [("giraff", "run-10", 1, 3)]


def test_states_before_the_number_of_the_last_state_are_requested(session):
    record, asked = builder_with_requests()
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


def test_number_of_logged_emergency_stops_is_limited(session, caplog):
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
        payload = codec.encode(event)
        intake.receive(Message(topic, payload, 1, retain=False, mid=1, properties=None))
    record.write()
    assert SystemLog.objects.filter(event="estop").count() == 30
    assert record.counts["unlogged"] == 1970
    record.take(EventItem("giraff", event, NOW + 11.0))
    record.write()
    assert SystemLog.objects.filter(event="estop").count() == 31, "one more after ten seconds"


def test_closed_records_leave_nothing_in_memory(session):
    record = builder()
    rows = [
        session_row(session.robot, session.visitor, state="ended", live_key=f"k{n}")
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


def test_rows_of_a_deleted_session_cause_no_check_of_the_whole_database(session):
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


def interventions() -> list[tuple]:
    return list(AuditEntry.objects.order_by("act").values_list("act", "role", "robot", "thing"))


def test_stops_and_releases_are_in_the_log_of_interventions_without_names(session):
    record = builder()
    record.take(event_item(session, "stopped", detail="driver"))
    record.take(event_item(session, "estop", 2, detail="owner:Eve a child"))
    record.take(event_item(session, "estop_cleared", 3, detail="staff:Ada"))
    record.take(event_item(session, "released", 4, detail="driver"))
    record.take(event_item(session, "charging", 5))
    write_all(record)
    key = str(session.pk)
    assert interventions() == [
        ("estop", "owner", "giraff", key),
        ("estop_cleared", "staff", "giraff", key),
        ("released", "driver", "giraff", key),
        ("stopped", "driver", "giraff", key),
    ]
    assert "Eve" not in str(list(AuditEntry.objects.values()))


def test_a_stop_between_two_visits_is_noted_once_although_it_arrives_twice(session):
    event = messages.Event(stamp=NOW, boot="b", seq=9, type="stopped", detail="screen")
    for record in (builder(), builder()):
        record.take(EventItem("giraff", event, NOW))
        write_all(record)
    assert interventions() == [("stopped", "screen", "giraff", "")]


def test_a_flood_of_stops_does_not_fill_the_log_of_interventions_and_hides_no_emergency(session):
    record = builder()
    for seq in range(200):
        record.take(event_item(session, "stopped", seq, detail="observer"))
    record.take(event_item(session, "estop", 200, detail="screen"))
    write_all(record)
    noted = [act for act, *_ in interventions()]
    assert (noted.count("stopped"), noted.count("estop")) == (100, 1)
