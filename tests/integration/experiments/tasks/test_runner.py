"""Living drives: what the page is shown, when the session ends, and that a runner that is killed is
missed by no page.
"""

import datetime
from contextlib import suppress

import pytest
from django.db import OperationalError
from django.db.models import QuerySet
from django.utils import timezone

from experiments.models import Drive, TaskEvent
from experiments.tasks.finalization import settle
from experiments.tasks.records import FirstFrame, Record, Seen
from experiments.tasks.runner import PATIENCE, Runner
from robots.models import RobotPresence
from sessions import protocol
from sessions.leases import store
from sessions.manager import notices
from sessions.models import Session
from tests.support.studies import task_drives
from tests.support.studies.studies import PRACTICE, STUDY
from tests.support.studies.task_drives import BACK, FIRST, THERE
from tests.support.studies.task_session import (
    AHEAD,
    begin,
    cabin_robot,
    close,
    message_of,
    photographed,
    say,
    state_of,
    write,
)

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    notices.drain()
    yield cabin_robot()
    notices.drain()


def shown() -> list[protocol.Task]:
    """The tasks that the page received since the last call."""
    return notices.drain()


def ended() -> tuple[str, str]:
    session = Session.objects.get()
    return session.outcome, session.outcome_reason


def stored_events() -> list[tuple]:
    return list(TaskEvent.objects.order_by("number").values_list("number", "stamp", "type", "data"))


def at(seconds: float) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC)


def started_drive(start: float) -> task_drives.Drive:
    drive = task_drives.Drive(at=start, frame=False)
    return drive.say(FirstFrame(drive.at, repr(drive.at - 3600.0)))


def hear(runner: Runner, drive: Drive, records: list[Record], **more) -> None:
    for record in records:
        say(runner, drive, record, **more)


def test_the_page_is_shown_how_the_task_goes_and_docking_ends_the_session(robot):
    drive, runner = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    hear(runner, drive, records)
    frames = shown()
    assert [frames[0].cue, frames[-1].cue] == ["wait_for_picture", "completed"]
    assert "photo_review" in [one.cue for one in frames]
    assert [one.photo for one in frames if one.window == "review"] == ["a2", "a3"]
    last = frames[-1]
    assert (last.passed, last.outcome, last.doors) == ((1, 2), "completed", ("door",))
    targets = [(one.cue, one.number, one.x, one.y) for one in frames]
    assert ("go_to_checkpoint", 1, *FIRST) in targets
    assert ended() == ("completed", "task")
    assert Session.objects.get().state == "ended"
    assert Drive.objects.get().shown["outcome"] == "completed"
    assert Drive.objects.get().clock_offset == AHEAD


def test_events_of_a_live_task_equal_those_of_the_record(robot):
    drive, runner = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    hear(runner, drive, records)
    live = stored_events()
    write(drive, records)
    settle(close(drive, at=records[-1].at + 1.0), timezone.now())
    assert stored_events() == live
    assert Drive.objects.get().outcome == "completed"


def test_a_frame_is_sent_only_when_something_has_changed(robot):
    drive, runner = begin(robot), Runner()
    start = timezone.now().timestamp()
    hear(runner, drive, started_drive(start).records)
    count = len(shown())
    docked = {"docked": True, "contact": True}
    times = [start + 1.0 + n / 4 for n in range(20)]
    still = [Seen(t, "boot", 2 + n, 0.5, 2.0, 3.1, **docked) for n, t in enumerate(times)]
    hear(runner, drive, still)
    runner.tick(now=at(start + 7.0))
    assert count > 0
    assert shown() == []


@pytest.mark.parametrize("refuses", ["bulk_create", "update"])
def test_refused_writes_are_repeated_and_published_at_the_next_tick(robot, monkeypatch, refuses):
    drive, runner = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    half = len(records) // 2
    hear(runner, drive, records[:half])
    before = [frame.cue for frame in shown()]

    def locked(*_arguments, **_more):
        raise OperationalError("database is locked")

    with monkeypatch.context() as away:
        away.setattr(QuerySet, refuses, locked)
        for record in records[half:-1]:
            with suppress(OperationalError):
                hear(runner, drive, [record])
    assert {frame.cue for frame in shown()} <= {before[-1]}, "repeated without changes"
    runner.tick(now=at(records[-2].at))
    (frame,) = shown()
    assert frame.cue not in before, "published although no message follows"
    hear(runner, drive, records[-1:])
    assert shown()[-1].cue == "completed"
    write(drive, records)
    live = stored_events()
    settle(close(drive, at=records[-1].at + 1.0), timezone.now())
    assert stored_events() == live


def test_the_time_limit_ends_the_session_though_nothing_comes_any_more(robot):
    drive, runner = begin(robot), Runner()
    start = timezone.now().timestamp()
    hear(runner, drive, started_drive(start).records)
    limit = 300.0 + start + 0.25
    runner.tick(now=at(limit + PATIENCE - 0.2))
    assert Session.objects.get().state == "driving"
    runner.tick(now=at(limit + PATIENCE + 0.1))
    assert ended() == ("timed_out", "task")
    last = shown()[-1]
    assert (last.cue, last.outcome) == ("timed_out", "timed_out")


def test_docking_at_the_last_moment_counts_though_the_state_comes_late(robot):
    drive, runner = begin(robot), Runner()
    start = timezone.now().timestamp()
    hear(runner, drive, started_drive(start).go(*THERE, *BACK).records)
    limit = 300.0 + start + 0.25
    rests = [
        Seen(limit - 2.1 + n / 4, "boot", 4000 + n, 0.5, 2.0, 3.1, contact=True) for n in range(8)
    ]
    hear(runner, drive, rests)
    runner.tick(now=at(limit + 0.5))
    late = Seen(limit - 0.1, "boot", 5000, 0.5, 2.0, 3.1, docked=True, contact=True)
    about = {"session": str(drive.session_id), "received_at": limit + 0.6, "clock_offset": AHEAD}
    runner.on_state(robot="giraff", state=state_of(late, drive), **about)
    assert ended() == ("completed", "task")


def test_missed_notice_is_repeated_within_ten_seconds(robot):
    drive, runner = begin(robot), Runner()
    start = timezone.now().timestamp()
    hear(runner, drive, started_drive(start).records)
    cue = shown()[-1].cue  # and the page did not receive it
    for second in range(40, 75):
        runner.tick(now=at(start + second))
    again = [one.cue for one in shown()]
    assert set(again) == {cue}
    assert 3 <= len(again) <= 4


def test_the_time_left_is_published_in_the_last_minutes_and_repeated(robot):
    drive, runner = begin(robot), Runner()
    start = timezone.now().timestamp()
    hear(runner, drive, started_drive(start).records)
    shown()
    for second in range(170, 230):
        runner.tick(now=at(start + second))
    seconds = [one.remaining for one in shown() if one.remaining is not None]
    assert 5 <= len(seconds) <= 7
    assert seconds[0] == pytest.approx(120.0, abs=1.5)


def test_another_session_manager_continues_the_task_of_a_killed_one(robot):
    drive, first = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    half = len(records) // 2 - 6  # on the way to the second checkpoint
    hear(first, drive, records[:half])
    before = len(shown())
    write(drive, records[: half - 3])  # the last second had not reached the database
    second = Runner()
    second.tick(now=at(records[half].at))
    assert [one.cue for one in shown()] == []  # the page knows all of it
    hear(second, drive, records[half - 3 :])  # the broker delivers what was not acknowledged
    assert Session.objects.get().outcome == "completed"
    assert before > 0
    types = list(TaskEvent.objects.order_by("number").values_list("type", flat=True))
    assert types.count("checkpoint") == 2
    assert types.count("task_started") == types.count("docked") == 1


def test_messages_that_a_killed_process_lost_count_when_they_are_sent_again(robot):
    """Without the states around the first checkpoint the visitor would be sent back to it."""
    drive, first = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    half = len(records) // 2
    hear(first, drive, records[:half])
    write(drive, records[:5])
    second = Runner()
    hear(second, drive, records[half:-1])
    assert Drive.objects.get().shown["passed"] == []
    hear(second, drive, records[5:half])
    assert Drive.objects.get().shown["passed"] == [1, 2]
    hear(second, drive, records[-1:])
    assert Session.objects.get().outcome == "completed"


def test_a_time_limit_that_passed_without_a_session_manager_is_applied_later(robot):
    drive = begin(robot)
    start = timezone.now().timestamp()
    write(drive, started_drive(start).go(FIRST).records)
    Runner().tick(now=at(start + 400.0))
    assert Session.objects.get().outcome == "timed_out"


def test_another_robot_and_another_session_have_no_say(robot):
    drive, runner = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    for record in records:
        if isinstance(record, Seen):
            say(runner, drive, record, robot="rhodon")
    assert TaskEvent.objects.count() == 0
    runner.on_message(
        robot="",
        session="no session at all",
        message=message_of(records[1]),
        received_at=1.0,
        clock_offset=None,
    )
    assert shown() == []


def test_a_drive_that_never_sees_a_picture_ends_when_its_turn_would_be_over(robot):
    drive, runner = begin(robot), Runner()
    granted = drive.granted_at.timestamp()
    runner.tick(now=at(granted + 470.0))
    assert Session.objects.get().state == "driving"
    runner.tick(now=at(granted + 481.0))
    assert ended() == ("timed_out", "no_picture")


def test_a_practice_drive_ends_after_its_minutes(robot):
    steps = [PRACTICE, *STUDY["steps"]]
    drive, runner = begin(robot, steps=steps), Runner()
    start = timezone.now().timestamp()
    hear(runner, drive, started_drive(start).go(FIRST).records)
    assert [one.cue for one in shown()] == ["practice"]
    runner.tick(now=at(start + 80.0))
    assert [one.remaining for one in shown()] == [pytest.approx(40.2, abs=0.2)]
    runner.tick(now=at(start + 121.0))
    assert ended() == ("completed", "time_over")
    runner.on_end(session=Session.objects.get())
    assert Drive.objects.get().outcome == "completed"


# --- other ends -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outcome", "reason", "task"),
    [
        ("connection_lost", "visitor_silent", "connection_lost"),
        ("robot_fault", "robot_offline", "robot_fault"),
        ("completed", "left", "cancelled"),
        ("cancelled", "left", "cancelled"),
        ("stopped_by_operator", "stopped", "stopped_by_operator"),
        ("timed_out", "turn_over", "timed_out"),
    ],
)
def test_a_session_that_ends_otherwise_gives_its_outcome_at_once_and_loses_nothing(
    robot, outcome, reason, task
):
    """The page gone, the robot gone, the visitor gone, an operator, a turn."""
    drive, runner = begin(robot), Runner()
    records = started_drive(timezone.now().timestamp()).go(FIRST).records
    hear(runner, drive, records)
    store.end(str(drive.session_id), outcome, reason, at(records[-1].at + 1.0))
    Session.objects.update(first_motion_at=timezone.now())
    runner.on_end(session=Session.objects.get())
    stored = Drive.objects.get()
    assert (stored.outcome, stored.moved, stored.settled_at) == (task, True, None)
    write(drive, records)
    settle(close(drive, at=records[-1].at + 2.0), timezone.now())
    stored = Drive.objects.get()
    assert (stored.outcome, stored.moved, stored.participant.stage) == (task, True, "filled")


def test_the_runner_settles_what_is_over_beside_what_lives(robot):
    drive, runner = begin(robot), Runner()
    records = photographed(timezone.now().timestamp())
    hear(runner, drive, records)
    write(drive, records)
    close(drive, at=records[-1].at + 1.0)
    RobotPresence.objects.update(turnaround="ready")
    other = begin(robot, "ben", drive.participant.study)
    for _ in range(40):
        runner.tick(now=timezone.now())
    assert Drive.objects.get(pk=drive.pk).settled_at is not None
    assert Drive.objects.get(pk=other.pk).settled_at is None
