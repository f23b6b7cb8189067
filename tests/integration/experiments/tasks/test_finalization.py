"""The outcome of a drive, from its stored record alone."""

import datetime
import random
from concurrent.futures import ThreadPoolExecutor

import msgspec
import numpy as np
import pytest
from django.db import connection
from django.utils import timezone

from experiments.dataset.counting import attempted, counting, with_reasons
from experiments.extraction.build import dataset_of
from experiments.models import Drive, Participant, TaskEvent
from experiments.participation import progress
from experiments.participation.drive_status import status_at
from experiments.rehearsal.findings import discrepancies
from experiments.tasks import finalization
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import Finalizer, settle
from experiments.tasks.records import FirstFrame, Record, Seen
from experiments.tasks.stored_records import stored, track_of
from robots.api import messages as m
from robots.models import RobotPresence
from sessions import system_log
from sessions.leases import store, terms
from sessions.leases.absences import note_manager_absence, note_page_closed
from sessions.models import Session, SessionEvent, StateChunk, SystemLog
from sessions.protocol import PageEvent
from tests.support.studies import participants as p, task_drives
from tests.support.studies.studies import PRACTICE, STUDY, small_study
from tests.support.studies.task_drives import SECOND, THERE
from tests.support.studies.task_session import (
    AHEAD,
    begin,
    cabin_robot,
    close,
    photographed,
    small_conditions,
    write,
    write_event,
)

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    return cabin_robot()


def settled(drive: Drive) -> Drive:
    settle(drive, timezone.now())
    return Drive.objects.select_related("participant", "session").get(pk=drive.pk)


def recorded(drive: Drive) -> float:
    """Store the record of the whole task, and return when it ended."""
    records = photographed(timezone.now().timestamp())
    write(drive, records)
    return records[-1].at


def completed(drive: Drive) -> Drive:
    """Store the record of the whole task, end its session and settle the drive."""
    at = recorded(drive) + 0.5
    return settled(close(drive, outcome="completed", reason="task", at=at))


def moved(drive: Drive, outcome: str, reason: str = "robot_offline") -> Drive:
    """Store that the robot just moved, end the session with an outcome and settle the drive."""
    now = timezone.now().timestamp()
    docked = Seen(now, "boot", 0, 0.5, 2.0, 3.1, docked=True, contact=True)
    write(drive, [docked, Seen(now + 0.25, "boot", 1, 0.6, 2.0, 3.1)])
    return settled(close(drive, outcome=outcome, reason=reason, at=now + 1.0))


def task_events(drive: Drive) -> list[tuple]:
    rows = TaskEvent.objects.filter(drive=drive).exclude(type="cue").order_by("number")
    return [(row.type, row.data.get("name", row.data.get("number"))) for row in rows]


def test_the_record_of_a_whole_task_gives_events_result_and_outcome(robot):
    drive = begin(robot)
    ended = recorded(drive)
    drive = settled(close(drive, outcome="completed", reason="task", at=ended + 0.5))
    assert task_events(drive) == [
        ("task_started", None),
        ("left_station", 0),
        ("checkpoint", 1),
        ("door_passed", "door"),
        ("checkpoint", 2),
        ("photo_prompt", 2),
        ("photo_failed", "a1"),
        ("photo_taken", "a2"),
        ("photo_again", "a2"),
        ("photo_taken", "a3"),
        ("photo_kept", "a3"),
        ("dock_contact", 1),
        ("docked", 0),
        ("task_ended", "completed"),
    ]
    assert (drive.outcome, drive.moved, drive.clock_offset) == ("completed", True, AHEAD)
    result = drive.result
    assert (result["photo"], result["doors"], len(result["checkpoints"])) == ("kept", ["door"], 2)
    assert result["ended"] == pytest.approx(ended, abs=0.001)
    assert drive.participant.stage == "filled"


def test_stored_records_repeated_in_any_order_give_the_stored_events(
    robot,
):
    drive = completed(begin(robot))
    fed = [*stored(drive, drive.clock_offset)] * 2
    random.Random(7).shuffle(fed)
    engine = TaskEngine(track_of(drive))
    for record in fed:
        engine.feed(record)
    assert [(event.at, event.type, event.data()) for event in engine.events] == list(
        TaskEvent.objects.order_by("number").values_list("stamp", "type", "data")
    )


def test_a_record_that_gives_something_else_than_is_stored_is_named(robot):
    drive = completed(begin(robot))
    rng = np.random.default_rng(7)
    assert discrepancies([drive], rng) == []
    event = TaskEvent.objects.filter(drive=drive, type="checkpoint").first()
    TaskEvent.objects.filter(pk=event.pk).update(stamp=event.stamp - 1.0)
    (sentence,) = discrepancies([drive], rng)
    assert "differ from the stored ones" in sentence
    drive.outcome = "timed_out"
    (sentence,) = discrepancies([drive], rng)
    assert "a replay ends as completed, but timed_out is stored" in sentence


def test_a_lost_connection_ends_the_task_when_it_was_lost_and_names_the_side(robot):
    drive = begin(robot)
    records = photographed(timezone.now().timestamp())
    write(drive, records[: len(records) // 2])
    lost = records[len(records) // 2].at
    key = drive.session_id
    Session.objects.filter(pk=key).update(
        state="reconnecting",
        seen_at=None,
        lost_at=datetime.datetime.fromtimestamp(lost, datetime.UTC),
    )
    note_page_closed(str(key), 1001, timezone.now())
    closed = close(drive, outcome="connection_lost", reason="visitor_silent", at=lost + 120.0)
    drive = settled(closed)
    assert task_events(drive)[-1] == ("task_ended", "connection_lost")
    assert drive.result["ended"] == pytest.approx(lost, abs=0.001)
    (session,) = dataset_of(drive.participant.study).sessions
    assert session.ended == pytest.approx(lost - drive.granted_at.timestamp(), abs=0.001)
    assert (session.outcome, session.fault_side) == ("connection_lost", "visitor")
    SessionEvent.objects.filter(session=key).delete()
    note_manager_absence(
        datetime.datetime.fromtimestamp(lost - 30.0, datetime.UTC),
        datetime.datetime.fromtimestamp(lost - 1.0, datetime.UTC),
    )
    (session,) = dataset_of(drive.participant.study).sessions
    assert (session.fault_side, session.fault_part) == ("platform", "session_manager")
    assert session.fault == "platform fault: session manager away"


def test_settling_again_changes_nothing_and_late_states_change_what_they_must(robot):
    drive = begin(robot)
    records = photographed(timezone.now().timestamp())
    states = [record for record in records if isinstance(record, Seen)]
    lost = {record.seq for record in states[-8:]}
    write(drive, [one for one in records if not (isinstance(one, Seen) and one.seq in lost)])
    ending = {"outcome": "connection_lost", "reason": "visitor_silent"}
    drive = settled(close(drive, at=records[-1].at + 5.0, **ending))
    first = list(TaskEvent.objects.values_list("number", "stamp", "type"))
    assert drive.outcome == "connection_lost"
    assert finalization.due().count() == 0
    assert list(settled(drive).events.values_list("number", "stamp", "type")) == first
    write(drive, [record for record in states if record.seq in lost])
    Session.objects.update(closed_at=timezone.now() + datetime.timedelta(minutes=5))
    assert list(finalization.due()) == [drive]
    assert settled(close(drive, at=records[-1].at + 300.0)).outcome == "completed"
    assert task_events(drive)[-1] == ("task_ended", "completed")


def test_a_visitor_who_leaves_in_the_middle_has_cancelled_the_task(robot):
    drive = begin(robot)
    start = timezone.now().timestamp()
    route = task_drives.Drive(at=start, frame=False).say(FirstFrame(start, "1.5")).go(*THERE)
    write(drive, route.records)
    drive = settled(close(drive, outcome="completed", reason="left", at=route.at + 1.0))
    assert (drive.outcome, drive.moved, drive.participant.stage) == ("cancelled", True, "filled")
    assert task_events(drive)[-1] == ("task_ended", "cancelled")


def test_a_task_whose_time_is_over_is_timed_out_at_its_limit(robot):
    drive = begin(robot)
    start = timezone.now().timestamp()
    route = task_drives.Drive(at=start, frame=False).say(FirstFrame(start, "1.5")).go(SECOND)
    while route.at < start + 301.0:
        route.see()
    write(drive, route.records)
    drive = settled(close(drive, outcome="timed_out", reason="task", at=route.at))
    assert drive.outcome == "timed_out"
    assert drive.result["ended"] == pytest.approx(start + 300.0)


# --- the place in the cell ------------------------------------------------------------------------


def test_participant_whose_page_showed_no_frame_gives_the_place_back(robot):
    drive = begin(robot)
    now, dock = timezone.now().timestamp(), {"docked": True, "contact": True}
    write(drive, [Seen(now + n / 4, "boot", n, 0.5, 2.0, 3.1, **dock) for n in range(8)])
    drive = settled(close(drive, outcome="connection_refused", reason="x", at=now + 2.0))
    found = (drive.outcome, drive.moved, drive.participant.stage, drive.mismatches)
    assert found == ("connection_refused", False, "freed", [])


def test_a_reader_of_texts_of_one_condition_keeps_the_place(robot):
    page = {"text": {"en": "Mind the door."}, "conditions": ["all_open"]}
    read = {"kind": "instructions", "key": "read", "title": {"en": "Read"}, "leaves": [page]}
    drive = begin(robot, steps=[*STUDY["steps"], read])
    at = timezone.now().timestamp()
    drive = settled(close(drive, outcome="connection_refused", reason="never_connected", at=at))
    assert (drive.moved, drive.participant.stage) == (False, "under_way")


@pytest.mark.parametrize(
    "outcome", ["robot_fault", "connection_lost", "cancelled", "stopped_by_operator"]
)
def test_whatever_comes_after_the_first_velocity_fills_the_place(robot, outcome):
    drive = moved(begin(robot), outcome)
    assert (drive.outcome, drive.moved, drive.participant.stage) == (outcome, True, "filled")


def test_lost_states_show_neither_motion_nor_exposure(robot):
    drive = begin(robot)
    ending = {"outcome": "connection_lost", "reason": "visitor_silent", "missing": 12}
    drive = settled(close(drive, at=timezone.now().timestamp(), **ending))
    assert (drive.moved, drive.exposed_at, drive.participant.stage) == (False, None, "freed")
    dataset = counting(dataset_of(drive.participant.study))
    assert attempted(dataset) == ()
    assert [one.counts_why for one in dataset.others] == ["not_exposed"]


def by_itself(drive: Drive, records: list[Record], mode: m.Mode) -> Drive:
    """Settle a drive in which no velocity of the driver was applied, because the robot drove by
    itself in this mode wherever it was not docked.
    """
    write(drive, records, moving=False)
    for chunk in StateChunk.objects.all():
        chunk.states = [
            state if state.get("docked") else {**state, "mode": mode} for state in chunk.states
        ]
        chunk.save()
    return settled(close(drive, outcome="connection_lost", reason="x", at=records[-1].at + 0.5))


def counted(drive: Drive) -> tuple[bool, str, str]:
    """Whether the robot moved, why the drive does not count, and the status of its step."""
    participant = drive.participant
    (one,) = with_reasons(dataset_of(participant.study)).sessions
    status = status_at(participant, progress.place(participant)).state
    return one.drove, one.counts_why, status


def test_a_robot_that_went_where_its_driver_sent_it_has_moved(robot):
    records = photographed(timezone.now().timestamp())
    drive = by_itself(begin(robot), records, "goto")
    assert (drive.moved, counted(drive)) == (True, (True, "", "moved"))


def test_a_robot_that_only_left_its_dock_by_itself_has_not_moved(robot):
    start = timezone.now().timestamp()
    route = task_drives.Drive(at=start, frame=False).say(FirstFrame(start, "1.5")).go(SECOND)
    drive = by_itself(begin(robot), route.records, "docking")
    assert (drive.moved, counted(drive)) == (False, (False, "not_driven", "unmoved"))
    assert drive.exposed_at is not None


def test_a_drive_without_a_note_of_motion_began_to_move_when_its_states_show_it(robot):
    drive = by_itself(begin(robot), photographed(timezone.now().timestamp()), "goto")
    for offset in (AHEAD, AHEAD - 1e9):  # of a clock that was never set
        StateChunk.objects.update(clock_offset=offset)
        (one,) = dataset_of(drive.participant.study).sessions
        assert one.first_motion == pytest.approx(one.first_frame, abs=1.0)


def test_a_place_of_a_technical_failure_is_refilled_as_often_as_the_rule_allows(robot):
    refill = {"outcomes": ["robot_fault"], "most": 1}
    study = p.published(small_study(conditions=[small_conditions()[0]], refill=refill))
    for name, stage in (("ada", "refilled"), ("ben", "filled")):
        assert moved(begin(robot, name, study), "robot_fault").participant.stage == stage
        RobotPresence.objects.update(turnaround="ready")


def test_a_practice_drive_fills_nothing_and_is_never_taken_for_the_task(robot):
    steps = [PRACTICE, *STUDY["steps"]]
    drive = begin(robot, steps=steps, refill={"outcomes": ["robot_fault"], "most": 5})
    drive = moved(drive, "robot_fault")
    found = (drive.outcome, drive.result, drive.moved, drive.participant.stage)
    assert found == ("robot_fault", {}, True, "under_way")
    assert not TaskEvent.objects.exists()


def test_a_second_visit_frees_and_refills_nothing(robot):
    drive = begin(robot, refill={"outcomes": ["robot_fault"], "most": 5})
    Participant.objects.update(stage="filled")
    Drive.objects.filter(pk=drive.pk).update(
        moved=True, exposed_at=timezone.now(), settled_at=timezone.now()
    )
    store.end(str(drive.session_id), "completed", "task", timezone.now())
    RobotPresence.objects.update(turnaround="ready")
    Participant.objects.update(visit=2)
    participant = Participant.objects.get()
    again = store.take(robot, participant.user, "p2", now=timezone.now()).session
    second = moved(Drive.objects.get(session=again), "robot_fault")
    assert (second.outcome, second.number) == ("robot_fault", 2)
    assert Participant.objects.get().stage == "filled"


# --- what was in force ----------------------------------------------------------------------------


def test_differences_from_the_assignment_are_named(robot):
    drive = begin(robot)
    ended = recorded(drive)
    refused = {"status": "FAILED", "type": "dock", "reason": "not_allowed"}
    for event in (
        m.ActionStatus(action_id="g1", status="FINISHED", stamp=1.0, type="goto"),
        m.ActionStatus(action_id="g2", stamp=1.0, **refused),
        m.Event(stamp=2.0, boot="boot", seq=1, type="door_changed", detail="door closed"),
        PageEvent(stamp=3.0, type="layout", data={"interface": "standard"}),
        PageEvent(stamp=4.0, type="layout", data={"interface": "expert"}),
    ):
        write_event(drive, event, event.stamp)
    chunk = StateChunk.objects.order_by("first_seq").last()
    chunk.states[0]["assist"] = "steer"
    chunk.save()
    drive = settled(close(drive, outcome="completed", reason="task", at=ended + 0.5))
    assert drive.mismatches == ["actions", "assist", "interface", "doors_closed"]
    assert drive.applied["interface"] == "expert standard"
    assert (drive.applied["methods"], drive.applied["ways"]) == (["keyboard"], ["datachannel"])
    assert (drive.applied["doors_closed"], drive.applied["actions"]) == (["door"], ["goto"])


def test_a_drive_as_assigned_differs_in_nothing(robot):
    drive = completed(begin(robot))
    assert drive.mismatches == []
    assert drive.applied["robot"] == "giraff"


def drive_over_network(robot, *, reported: bool) -> Drive:
    """A drive in a condition with a network, which the robot applied to the visitor's commands if
    it is `reported`.
    """
    network = {"control": {"delay": 0.15, "loss": 0.02}, "video": {"bitrate": 400_000.0}}
    condition = {**small_conditions()[0], "network": network}
    drive = begin(robot, study=p.published(small_study(conditions=[condition])))
    fixed = terms.of(drive.session)
    ended = recorded(drive)
    applied = {
        "controlNetwork": m.LabReport(lab=fixed.control_network, taken=9, lost=1),
        "videoNetwork": m.LabReport(lab=fixed.video_network, overflowed=4),
    }
    for chunk in StateChunk.objects.all() if reported else ():
        chunk.states = [state | msgspec.to_builtins(applied) for state in chunk.states]
        chunk.save()
    return settled(close(drive, outcome="completed", reason="task", at=ended + 0.5))


def test_applied_network_is_stored_beside_the_assigned_one(robot):
    drive = drive_over_network(robot, reported=True)
    assert drive.mismatches == []
    report = msgspec.convert(drive.applied["control_network"], m.LabReport)
    lab = m.NetworkLab(delay=0.15, loss=0.02, seed=drive.seed)
    assert report == m.LabReport(lab=lab, taken=9, lost=1)
    session = dataset_of(drive.participant.study).sessions[0]
    assert (session.control_network, session.video_network) == ("delay=150,loss=2", "rate=400")
    assert (session.control_applied, session.video_applied) == ("delay=150,loss=2", "rate=400")


def test_network_that_the_robot_did_not_apply_flags_the_drive(robot):
    drive = drive_over_network(robot, reported=False)
    assert drive.mismatches == ["network"]
    session = dataset_of(drive.participant.study).sessions[0]
    networks = (session.mismatch, session.control_network, session.control_applied)
    assert networks == ("network", "delay=150,loss=2", "")


# --- a little at each look ------------------------------------------------------------------------


@pytest.mark.django_db(transaction=True)
def test_long_record_is_settled_bit_by_bit_while_other_processes_write(robot):
    """A drive of a quarter of an hour is read at many ticks, between which the recorder writes in
    another process and the scheduler here.
    """
    drive = begin(robot)
    ended = recorded(drive)
    empty = {"boot": "later", "count": 1, "states": []}
    StateChunk.objects.bulk_create(
        StateChunk(
            **empty,
            session_id=drive.session_id,
            **dict.fromkeys(("first_seq", "last_seq", "first_stamp", "last_stamp"), n),
            received_at=2e9 + n,
        )
        for n in range(900)
    )
    close(drive, outcome="completed", reason="task", at=ended + 0.5)
    settler, ticks = Finalizer(), 0
    while not Drive.objects.filter(settled_at__isnull=False).exists():
        settler.tick(timezone.now(), share=1e-9)
        with ThreadPoolExecutor(1) as elsewhere:  # a connection of its own, like another process
            elsewhere.submit(note_elsewhere, ticks).result()
        system_log.log("here", at=timezone.now(), number=ticks)
        ticks += 1
        assert ticks < 1000
    written = {word: SystemLog.objects.filter(event=word).count() for word in ("here", "elsewhere")}
    assert ticks > 3
    assert written == {"here": ticks, "elsewhere": ticks}
    assert Drive.objects.get().outcome == "completed"


def note_elsewhere(number):
    try:
        system_log.log("elsewhere", at=timezone.now(), number=number)
    finally:
        connection.close()


def test_unreadable_drive_is_logged_once_and_does_not_delay_others(robot, caplog):
    broken = begin(robot)
    Drive.objects.update(assigned={"track": {"dock": "nonsense"}})
    close(broken, outcome="cancelled", reason="left", at=timezone.now().timestamp())
    RobotPresence.objects.update(turnaround="ready")
    good = begin(robot, "ben", broken.participant.study)
    close(good, outcome="cancelled", reason="left", at=timezone.now().timestamp())
    settler = Finalizer()
    for _ in range(20):  # a look may see little of its time
        settler.tick(timezone.now(), share=0.5)
    assert list(finalization.due()) == [broken]
    assert [
        record.message.split()[0] for record in caplog.records if "not_finalized" in record.message
    ] == ["drive_not_finalized"]


def test_a_drive_whose_settling_was_cut_off_is_settled_again(robot, monkeypatch):
    drive = begin(robot)
    drive = close(drive, outcome="completed", reason="task", at=recorded(drive) + 0.5)
    with monkeypatch.context() as cut_off:
        cut_off.setattr(
            finalization, "settle_place", lambda _drive: (_ for _ in ()).throw(KeyboardInterrupt)
        )
        with pytest.raises(KeyboardInterrupt):
            settle(drive, timezone.now())
    assert list(finalization.due()) == [drive]
    assert settled(drive).participant.stage == "filled"
