"""What came of a drive, from its stored record alone."""

import datetime
import random
from concurrent.futures import ThreadPoolExecutor

import msgspec
import numpy as np
import pytest
from django.db import connection
from django.utils import timezone

from experiments.extraction.build import dataset_of
from experiments.models import Drive, Participant, TaskEvent
from experiments.rehearsal.findings import discrepancies
from experiments.tasks import finalization
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import Finalizer, settle
from experiments.tasks.records import FirstFrame, PhotoAnswer, PhotoFailed, PhotoTaken, Record, Seen
from experiments.tasks.stored_records import stored, track_of
from robots.api import messages as m
from robots.models import RobotPresence
from sessions import system_log
from sessions.leases import store, terms
from sessions.leases.absences import note_manager_absence, note_page_closed
from sessions.models import Session, SessionEvent, StateChunk, SystemLog
from sessions.protocol import PageEvent
from tests.support.studies import participants as p
from tests.support.studies import task_drives
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.task_drives import BACK, SECOND, THERE
from tests.support.studies.task_session import (
    AHEAD,
    begin,
    cabin_robot,
    close,
    small_conditions,
    write,
    write_event,
)

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    return cabin_robot()


def whole(at: float) -> list[Record]:
    """The whole task with a photo that failed once, was taken again and kept."""
    drive = task_drives.Drive(at=at, frame=False)
    drive.say(FirstFrame(drive.at, repr(drive.at - 0.5)))
    drive.go(*THERE)
    drive.say(PhotoFailed(drive.at, "a1")).see()
    drive.say(PhotoTaken(drive.at, "a2")).see()
    drive.say(PhotoAnswer(drive.at, repr(drive.at), "again")).see()
    drive.say(PhotoTaken(drive.at, "a3")).see()
    drive.say(PhotoAnswer(drive.at, repr(drive.at), "keep")).see()
    return drive.go(*BACK).dock().records


def settled(drive: Drive) -> Drive:
    settle(drive, timezone.now())
    return Drive.objects.select_related("participant", "session").get(pk=drive.pk)


def task_events(drive: Drive) -> list[tuple]:
    rows = TaskEvent.objects.filter(drive=drive).exclude(type="cue").order_by("number")
    return [(row.type, row.data.get("name", row.data.get("number"))) for row in rows]


def test_the_record_of_a_whole_task_gives_events_result_and_outcome(robot):
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    drive = settled(close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5))
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
    assert (drive.result["photo"], drive.result["doors"], len(drive.result["checkpoints"])) == (
        "kept",
        ["door"],
        2,
    )
    assert drive.result["ended"] == pytest.approx(records[-1].at, abs=0.001)
    assert drive.participant.stage == "filled"


def test_stored_records_repeated_in_any_order_give_the_stored_events(
    robot,
):
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    drive = settled(close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5))
    fed = [*stored(drive, drive.clock_offset)] * 2
    random.Random(7).shuffle(fed)
    engine = TaskEngine(track_of(drive))
    for record in fed:
        engine.feed(record)
    assert [(event.at, event.type, event.data()) for event in engine.events] == list(
        TaskEvent.objects.order_by("number").values_list("stamp", "type", "data")
    )


def test_a_record_that_gives_something_else_than_is_stored_is_named(robot):
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    drive = settled(close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5))
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
    records = whole(timezone.now().timestamp())
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
    records = whole(timezone.now().timestamp())
    states = [record for record in records if isinstance(record, Seen)]
    lost = {record.seq for record in states[-8:]}
    write(
        drive,
        [record for record in records if not (isinstance(record, Seen) and record.seq in lost)],
    )
    drive = settled(
        close(drive, outcome="connection_lost", reason="visitor_silent", at=records[-1].at + 5.0)
    )
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
    records = task_drives.Drive(at=timezone.now().timestamp()).go(*THERE).records
    write(
        drive,
        [
            FirstFrame(record.at, "1.5") if isinstance(record, FirstFrame) else record
            for record in records
        ],
    )
    drive = settled(close(drive, outcome="completed", reason="left", at=records[-1].at + 1.0))
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
    still = [
        Seen(
            timezone.now().timestamp() + n / 4, "boot", n, 0.5, 2.0, 3.1, docked=True, contact=True
        )
        for n in range(8)
    ]
    write(drive, still)
    drive = settled(
        close(drive, outcome="connection_refused", reason="never_connected", at=still[-1].at)
    )
    assert (drive.outcome, drive.moved, drive.participant.stage, drive.mismatches) == (
        "connection_refused",
        False,
        "freed",
        [],
    )


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
    drive = begin(robot)
    now = timezone.now().timestamp()
    write(
        drive,
        [
            Seen(now, "boot", 0, 0.5, 2.0, 3.1, docked=True, contact=True),
            Seen(now + 0.25, "boot", 1, 0.6, 2.0, 3.1),
        ],
    )
    drive = settled(close(drive, outcome=outcome, reason="x", at=now + 1.0))
    assert (drive.outcome, drive.moved, drive.participant.stage) == (outcome, True, "filled")


def test_lost_states_count_as_motion_of_the_robot(robot):
    drive = begin(robot)
    drive = settled(
        close(
            drive,
            outcome="connection_lost",
            reason="visitor_silent",
            at=timezone.now().timestamp(),
            missing=12,
        )
    )
    assert (drive.moved, drive.participant.stage) == (True, "filled")


def test_a_place_of_a_technical_failure_is_refilled_as_often_as_the_rule_allows(robot):
    study = p.published(
        small_study(
            conditions=[small_conditions()[0]], refill={"outcomes": ["robot_fault"], "most": 1}
        )
    )
    for name, stage in (("ada", "refilled"), ("ben", "filled")):
        drive = begin(robot, name, study)
        now = timezone.now().timestamp()
        write(
            drive, [Seen(now, "boot", 0, 0.5, 2.0, 3.1), Seen(now + 0.25, "boot", 1, 0.6, 2.0, 3.1)]
        )
        drive = settled(close(drive, outcome="robot_fault", reason="robot_offline", at=now + 1.0))
        assert drive.participant.stage == stage
        RobotPresence.objects.update(turnaround="ready")


def test_a_practice_drive_fills_nothing_and_is_never_taken_for_the_task(robot):
    steps = [
        {"kind": "practice", "key": "try", "title": {"en": "Try"}, "minutes": 2},
        *STUDY["steps"],
    ]
    drive = begin(robot, steps=steps, refill={"outcomes": ["robot_fault"], "most": 5})
    now = timezone.now().timestamp()
    write(drive, [Seen(now, "boot", 0, 0.5, 2.0, 3.1), Seen(now + 0.25, "boot", 1, 0.6, 2.0, 3.1)])
    drive = settled(close(drive, outcome="robot_fault", reason="robot_offline", at=now + 1.0))
    assert (drive.outcome, drive.result, drive.moved, drive.participant.stage) == (
        "robot_fault",
        {},
        True,
        "under_way",
    )
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
    second = Drive.objects.get(session=again)
    now = timezone.now().timestamp()
    write(second, [Seen(now, "boot", 0, 0.5, 2.0, 3.1), Seen(now + 0.25, "boot", 1, 0.6, 2.0, 3.1)])
    second = settled(close(second, outcome="robot_fault", reason="robot_offline", at=now + 1.0))
    assert (second.outcome, second.number, Participant.objects.get().stage) == (
        "robot_fault",
        2,
        "filled",
    )


# --- what was in force ----------------------------------------------------------------------------


def test_differences_from_the_assignment_are_named(robot):
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    write_event(
        drive, m.ActionStatus(action_id="g1", status="FINISHED", stamp=1.0, type="goto"), 1.0
    )
    write_event(
        drive,
        m.ActionStatus(
            action_id="g2", status="FAILED", stamp=1.0, type="dock", reason="not_allowed"
        ),
        1.0,
    )
    write_event(
        drive,
        m.Event(stamp=2.0, boot="boot", seq=1, type="door_changed", detail="door closed"),
        2.0,
    )
    write_event(drive, PageEvent(stamp=3.0, type="layout", data={"interface": "standard"}), 3.0)
    write_event(drive, PageEvent(stamp=4.0, type="layout", data={"interface": "expert"}), 4.0)
    chunk = StateChunk.objects.order_by("first_seq").last()
    chunk.states[0]["assist"] = "steer"
    chunk.save()
    drive = settled(close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5))
    assert drive.mismatches == ["actions", "assist", "interface", "doors_closed"]
    assert drive.applied["interface"] == "expert standard"
    assert (drive.applied["methods"], drive.applied["ways"]) == (["keyboard"], ["datachannel"])
    assert (drive.applied["doors_closed"], drive.applied["actions"]) == (["door"], ["goto"])


def test_a_drive_as_assigned_differs_in_nothing(robot):
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    drive = settled(close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5))
    assert drive.mismatches == []
    assert drive.applied["robot"] == "giraff"


def drive_over_network(robot, *, reported: bool) -> Drive:
    """A drive in a condition with a network, which the robot did put on the visitor's commands, or
    did not.
    """
    network = {"control": {"delay": 0.15, "loss": 0.02}, "video": {"bitrate": 400_000.0}}
    drive = begin(
        robot,
        study=p.published(small_study(conditions=[{**small_conditions()[0], "network": network}])),
    )
    fixed = terms.of(drive.session)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    if reported:
        for chunk in StateChunk.objects.all():
            control, video = (
                m.LabReport(lab=fixed.control_network, taken=9, lost=1),
                m.LabReport(lab=fixed.video_network, overflowed=4),
            )
            networks = {
                "controlNetwork": msgspec.to_builtins(control),
                "videoNetwork": msgspec.to_builtins(video),
            }
            chunk.states = [state | networks for state in chunk.states]
            chunk.save()
    return settled(close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5))


def test_the_network_that_the_robot_applied_is_stored_beside_the_assigned_one(
    robot,
):
    drive = drive_over_network(robot, reported=True)
    assert drive.mismatches == []
    report = msgspec.convert(drive.applied["control_network"], m.LabReport)
    assert report == m.LabReport(
        lab=m.NetworkLab(delay=0.15, loss=0.02, seed=drive.seed), taken=9, lost=1
    )
    session = dataset_of(drive.participant.study).sessions[0]
    assert (session.control_network, session.video_network) == ("delay=150,loss=2", "rate=400")
    assert (session.control_applied, session.video_applied) == ("delay=150,loss=2", "rate=400")


def test_a_network_that_the_robot_has_not_put_on_flags_the_drive(robot):
    drive = drive_over_network(robot, reported=False)
    assert drive.mismatches == ["network"]
    session = dataset_of(drive.participant.study).sessions[0]
    assert (session.mismatch, session.control_network, session.control_applied) == (
        "network",
        "delay=150,loss=2",
        "",
    )


# --- a little at each look ------------------------------------------------------------------------


def test_the_settler_does_a_little_at_each_look_and_all_in_the_end(robot):
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5)
    settler, looks = Finalizer(), 0
    while not Drive.objects.filter(settled_at__isnull=False).exists():
        settler.tick(timezone.now(), share=1e-9)
        looks += 1
        assert looks < 1000
    assert looks > 3
    assert Drive.objects.get().outcome == "completed"


@pytest.mark.django_db(transaction=True)
def test_half_way_through_a_long_record_everybody_else_may_write(robot):
    """A drive of a quarter of an hour is read at many looks, between which the recorder writes in
    another process and the scheduler here.
    """
    drive = begin(robot)
    records = whole(timezone.now().timestamp())
    write(drive, records)
    chunk = StateChunk.objects.first()
    StateChunk.objects.bulk_create(
        StateChunk(
            session=chunk.session,
            boot="later",
            first_seq=n,
            last_seq=n,
            count=1,
            first_stamp=n,
            last_stamp=n,
            received_at=2e9 + n,
            states=[],
        )
        for n in range(900)
    )
    close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5)
    settler, looks = Finalizer(), 0
    while not Drive.objects.filter(settled_at__isnull=False).exists():
        settler.tick(timezone.now(), share=1e-9)
        with ThreadPoolExecutor(1) as elsewhere:  # a connection of its own, like another process
            elsewhere.submit(note_elsewhere, looks).result()
        system_log.log("here", at=timezone.now(), number=looks)
        looks += 1
        assert looks < 1000
    assert (
        SystemLog.objects.filter(event="here").count()
        == SystemLog.objects.filter(event="elsewhere").count()
        == looks
        > 3
    )
    assert Drive.objects.get().outcome == "completed"


def note_elsewhere(number):
    try:
        system_log.log("elsewhere", at=timezone.now(), number=number)
    finally:
        connection.close()


def test_a_drive_that_cannot_be_read_is_told_once_and_keeps_no_other_waiting(robot, caplog):
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
    records = whole(timezone.now().timestamp())
    write(drive, records)
    drive = close(drive, outcome="completed", reason="task", at=records[-1].at + 0.5)
    with monkeypatch.context() as cut_off:
        cut_off.setattr(
            finalization, "settle_place", lambda _drive: (_ for _ in ()).throw(KeyboardInterrupt)
        )
        with pytest.raises(KeyboardInterrupt):
            settle(drive, timezone.now())
    assert list(finalization.due()) == [drive]
    assert settled(drive).participant.stage == "filled"
