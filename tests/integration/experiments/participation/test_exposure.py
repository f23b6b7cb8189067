"""Who is exposed to a condition, and who is drawn again: the page's first frame decides."""

import datetime

import pytest
from django.utils import timezone

from experiments.analysis.tables.flow import FLOW, flow
from experiments.dataset.counting import attempted, counting
from experiments.extraction.build import dataset_of
from experiments.models import Draw, Drive, Participant
from experiments.participation import grants, places
from experiments.participation.withdrawal.deletion import withdraw
from experiments.tasks.finalization import settle
from experiments.tasks.records import FirstFrame, Seen
from experiments.tasks.runner import Runner
from robots.models import RobotPresence
from sessions.leases import store
from sessions.models import SessionEvent
from sessions.protocol import PageEvent
from telepresence import __version__
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.studies import PRACTICE, STUDY, small_study
from tests.support.studies.task_session import begin, cabin_robot, close, small_conditions, write

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    return cabin_robot()


def docked(at: float) -> list[Seen]:
    return [Seen(at + n / 4, "boot", n, 0.5, 2.0, 3.1, docked=True, contact=True) for n in range(8)]


def ended(drive: Drive, at: float, outcome: str = "cancelled") -> Drive:
    drive = close(drive, outcome=outcome, reason="left", at=at)
    settle(drive, timezone.now())
    return Drive.objects.select_related("participant", "session").get(pk=drive.pk)


def come_back(robot, participant: Participant) -> Drive:
    RobotPresence.objects.update(turnaround="ready")
    taken = store.take(robot, participant.user, "again", now=timezone.now())
    return Drive.objects.get(session=taken.session)


def test_participant_who_saw_video_and_never_moved_keeps_the_condition(robot):
    drive = begin(robot)
    at = timezone.now().timestamp()
    write(drive, [FirstFrame(at, repr(at)), *docked(at)])
    drive = ended(drive, at + 40.0)
    assert (drive.moved, drive.exposed_at.timestamp()) == (False, pytest.approx(at, abs=1e-3))
    assert (drive.outcome, drive.participant.stage) == ("cancelled", "filled")
    again = come_back(robot, drive.participant)
    assert again.condition == drive.condition
    assert Draw.objects.count() == 1


def test_participant_without_video_is_drawn_again_and_both_draws_are_stored(robot):
    study = p.published(small_study(allocation={"best_probability": 1.0}))
    drive = begin(robot, "ada", study)
    at = timezone.now().timestamp()
    write(drive, docked(at))
    drive = ended(drive, at + 5.0, "connection_refused")
    assert (drive.exposed_at, drive.moved, drive.participant.stage) == (None, False, "freed")
    again = come_back(robot, drive.participant)
    first, second = Draw.objects.order_by("number")
    assert (first.cell, first.reason, first.counts) == (
        drive.condition,
        "first",
        {"all_open": 0, "shut": 0},
    )
    assert (second.cell, second.reason, second.nth) == (again.condition, "again", 2)
    assert (first.number, second.number, second.counts) == (1, 2, {"all_open": 0, "shut": 0})


@pytest.mark.parametrize("field", ["interface", "controllers", "actions"])
def test_condition_that_the_page_shows_before_any_video_is_never_drawn_again(robot, field):
    other = {"interface": "expert", "controllers": ["mouse"], "actions": ["places"]}
    conditions = [*small_conditions()]
    conditions[1] = {**conditions[1], field: other[field]}
    drive = begin(robot, "ada", p.published(small_study(conditions=conditions)))
    drive = ended(drive, timezone.now().timestamp() + 5.0, "connection_refused")
    assert (drive.exposed_at, drive.participant.stage) == (None, "under_way")
    later = timezone.now() + datetime.timedelta(hours=25)
    (place,) = places.held(drive.participant.study, "participant", later)
    assert place.stage == "left"
    assert come_back(robot, drive.participant).condition == drive.condition


def test_video_of_practice_shows_the_condition_and_fills_no_place(robot):
    steps = [PRACTICE, *STUDY["steps"]]
    study = p.published(small_study(steps=steps, allocation={"quota": 1}))
    drive = begin(robot, "ada", study)
    at = timezone.now().timestamp()
    write(drive, [FirstFrame(at, repr(at)), *docked(at)])
    drive = ended(drive, at + 5.0)
    assert (drive.step, drive.participant.stage) == ("try", "under_way")
    later = timezone.now() + datetime.timedelta(hours=25)
    for when, stage in ((timezone.now(), "under_way"), (later, "left")):
        assert [one.stage for one in places.held(study, "participant", when)] == [stage]
    assert not attempted(counting(dataset_of(study))), "the analysis does not count it either"
    Participant.objects.update(step="task")
    assert come_back(robot, drive.participant).condition == drive.condition
    withdraw(drive.participant, timezone.now())
    assert Participant.objects.get().stage == "freed"


def test_video_of_the_task_fills_the_place_whether_or_not_the_robot_moved(robot):
    conditions = [*small_conditions()]
    conditions[1] = {**conditions[1], "interface": "expert"}
    drive = begin(robot, "ada", p.published(small_study(conditions=conditions)))
    at = timezone.now().timestamp()
    write(drive, [FirstFrame(at, repr(at)), *docked(at)])
    drive = ended(drive, at + 40.0)
    later = timezone.now() + datetime.timedelta(hours=25)
    (place,) = places.held(drive.participant.study, "participant", later)
    assert (drive.moved, place.stage) == (False, "filled")
    assert attempted(counting(dataset_of(drive.participant.study)))


@pytest.mark.parametrize(("moving", "stage"), [(False, "exposed"), (True, "ended")])
def test_withdrawal_leaves_the_participant_at_the_stage_of_the_flow(robot, moving, stage):
    drive = begin(robot)
    at = timezone.now().timestamp()
    away = Seen(at + 3.0, "boot", 8, 0.7, 2.0, 3.1)
    write(drive, [FirstFrame(at, repr(at)), *docked(at), *([away] if moving else [])])
    participant = ended(drive, at + 40.0).participant

    def reached() -> dict[str, int]:
        rows = flow(counting(dataset_of(participant.study))).rows
        return {row[1].text: row[3].value for row in rows if row[1].text in FLOW[:5]}

    before = reached()
    assert [name for name in FLOW[:5] if before[name]][-1] == stage
    withdraw(participant, timezone.now())
    assert reached() == before


def test_exposure_is_known_while_the_drive_lives(robot):
    drive = begin(robot)
    runner, at = Runner(), timezone.now().timestamp()
    event = PageEvent(stamp=at - 3600.0, type="first_frame", data={"way": "direct"})
    about = {"robot": "", "session": str(drive.session_id), "clock_offset": None}
    runner.on_message(**about, message=event, received_at=at)
    runner.on_message(**about, message=event, received_at=at + 2.0)
    drive.refresh_from_db()
    assert drive.exposed_at.timestamp() == pytest.approx(at, abs=1e-3)


def test_frame_that_a_killed_session_manager_stored_exposes_the_participant(robot):
    drive = begin(robot)
    at = timezone.now().timestamp()
    SessionEvent.objects.create(
        session=drive.session, source="page", type="first_frame", stamp=at, received_at=at, data={}
    )
    Runner().tick(now=timezone.now())
    drive.refresh_from_db()
    assert drive.exposed_at is not None


def test_draw_that_was_decided_before_a_process_died_is_applied_and_not_repeated(robot):
    study = p.published(small_study())
    participant = p.comer(study, person("ada"))
    decided = grants._new_draw(participant, timezone.now())
    (place,) = places.held(study, "participant", timezone.now())
    assert (place.cell, place.stage) == (decided.cell, "under_way")
    condition = grants.draw(participant, timezone.now())
    participant.refresh_from_db()
    assert (condition.key, participant.cell, participant.draws_applied) == (
        decided.cell,
        decided.cell,
        1,
    )
    assert Draw.objects.count() == 1


def test_assignment_is_balanced_by_an_answer_stored_with_the_draw(robot):
    steps = [
        {
            "kind": "form",
            "key": "you",
            "title": {"en": "You"},
            "questionnaire": "ict",
            "version": 2,
        },
        *STUDY["steps"],
    ]
    balance = [{"item": "ict.games"}]
    allocation = {"best_probability": 1.0, "balancing": "strata", "balance": balance}
    study = p.published(small_study(steps=steps, allocation=allocation))
    for name, games in (("ada", 4), ("ben", 4), ("cyn", 0), ("dan", 0)):
        participant = p.answered(p.comer(study, person(name)), "you", {"games": games})
        grants.draw(participant, timezone.now())
    for level in ("4", "0"):
        rows = [row for row in Draw.objects.all() if row.levels == {"ict.games": level}]
        assert {row.cell for row in rows} == {"all_open", "shut"}


def test_drive_keeps_the_versions_of_what_it_was_made_with(robot):
    RobotPresence.objects.update(
        factsheet=robot.presence.factsheet
        | {"agent_version": "1.4", "adapter": "ros2 1.4", "driver": "base 2.0"}
    )
    robot.refresh_from_db()
    drive = begin(robot)
    at = timezone.now().timestamp()
    write(drive, [FirstFrame(at, repr(at)), *docked(at)])
    versions = ended(drive, at + 5.0).versions
    assert (versions["agent"], versions["adapter"], versions["driver"]) == (
        "1.4",
        "ros2 1.4",
        "base 2.0",
    )
    assert versions["definition"] == drive.participant.study.sha256
    assert versions["server"].partition("+")[0] == __version__
    assert versions["metrics"].isdecimal()
