"""Every step of a study, interrupted in the middle and left until its time limit: no data is lost
or stored twice, and the outcome is right.

The other columns of this table, reload, back, a second tab and another device, are in
test_step_views.py.
"""

import datetime
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from django.conf import settings
from django.db import connection, transaction
from django.utils import timezone

from experiments.definition.steps.consent import Consent
from experiments.definition.steps.form import FormStep
from experiments.definition.steps.instructions import Instructions
from experiments.definition.steps.practice import Practice
from experiments.definition.steps.questionnaire import QuestionnaireStep
from experiments.definition.steps.task import TaskStep
from experiments.models import ConsentReceipt, Drive, StepVisit, Study
from experiments.participation import completion, progress
from experiments.participation.journey import JourneyPlace
from experiments.tasks.finalization import settle
from experiments.tasks.records import FirstFrame
from experiments.tasks.runner import PATIENCE, Runner
from robots.models import RobotPresence
from sessions.leases import store as leases
from sessions.models import Session
from surveys.models import Answer, Response
from surveys.questionnaires import store
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies import participants as p, task_drives
from tests.support.studies.questionnaires import defined, item
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_walk import Walker
from tests.support.studies.task_drives import FIRST
from tests.support.studies.task_session import cabin_robot, close, say, small_conditions, write

pytestmark = pytest.mark.django_db
WRITES = ("INSERT", "UPDATE", "DELETE")
EVERY_KIND = [
    {"kind": "consent", "key": "consent", "title": {"en": "C"}, "text": {"en": "Do you?"}},
    {
        "kind": "form",
        "key": "about_you",
        "title": {"en": "A"},
        "questionnaire": "ict",
        "version": 2,
    },
    {
        "kind": "instructions",
        "key": "instructions",
        "title": {"en": "I"},
        "leaves": [{"text": {"en": "Drive."}, "picture": "driving"}],
    },
    {"kind": "practice", "key": "try", "title": {"en": "T"}, "minutes": 2},
    *STUDY["steps"],
    {"kind": "debrief", "key": "thanks", "title": {"en": "D"}, "text": {"en": "Thanks."}},
]
PLACES = [JourneyPlace(1, 0, step["key"]) for step in EVERY_KIND]
DRIVEN = [place for place in PLACES if place.step in {"try", "task"}]
READ = [place for place in PLACES if place not in DRIVEN]
LIMIT = {"try": 120.0, "task": 300.0}  # seconds


@pytest.fixture
def walker() -> Walker:
    """A participant in a study with every kind of step, at a site whose robot is online."""
    robot = cabin_robot()
    study = p.published(small_study(steps=EVERY_KIND, conditions=[small_conditions()[0]]))
    found = Walker(study, person("ada"), robot)
    found.come()
    return found


def brought(walker: Walker, place: JourneyPlace) -> Walker:
    for one in PLACES[: PLACES.index(place)]:
        assert progress.place(walker.participant) == one
        walker.do()
    assert progress.place(walker.participant) == place, walker.look().text
    walker.look()
    return walker


def following(place: JourneyPlace) -> JourneyPlace:
    return PLACES[PLACES.index(place) + 1]


# --- the network is cut ---------------------------------------------------------------------------


class CutError(Exception):
    """What was asked for is done so far and no further."""


@contextmanager
def cut_at(number: int) -> Iterator[None]:
    """Within this the work ends before its so manieth write."""
    count = itertools.count(1)

    def write_or_fail(execute, sql, params, many, context):
        if sql.startswith(WRITES) and next(count) == number:
            raise CutError
        return execute(sql, params, many, context)

    with connection.execute_wrapper(write_or_fail):
        yield


def first_answers(walker: Walker, url: str) -> dict[str, list[str]]:
    """What a browser sends of a page of questions on which the first choice of each was taken."""
    data: dict[str, list[str]] = {}
    for element in read(walker.client.get(url)).elements:
        a = element.attributes
        if (
            element.tag == "input"
            and "name" in a
            and (a.get("type") != "radio" or a["name"] not in data)
            and a.get("type") not in {"submit", "checkbox"}
        ):
            data.setdefault(a["name"], []).append(a.get("value", ""))
    return data


def answer_all(walker: Walker) -> None:
    """Answer the questions of the step, page by page."""
    for _ in range(10):
        response = walker.client.get(walker.url(), follow=True)
        url = response.request["PATH_INFO"]
        if "/questions/" not in url:
            return
        walker.client.post(url, first_answers(walker, url))


def requests_at(walker: Walker, place: JourneyPlace) -> Callable[[], None]:
    """Return the request of a browser at a place; repeated, it is the same request, also when the
    participant has moved on.
    """
    answers = walker.answers()
    match walker.step:
        case Consent() | Instructions():
            return lambda: walker.client.post(walker.url(), answers) and None
        case FormStep() | QuestionnaireStep():
            return lambda: (
                answer_all(walker) if progress.place(walker.participant) == place else None
            )
    return lambda: None


def counted(walker: Walker) -> dict[str, object]:
    """Everything that must be there once."""
    visits = StepVisit.objects.order_by("began_at")
    return {
        "place": progress.place(walker.participant).word,
        "status": walker.participant.status,
        "visits": [(row.visit, row.round, row.step, row.finished_at is not None) for row in visits],
        "receipts": ConsentReceipt.objects.count(),
        "responses": sorted(Response.objects.values_list("context", flat=True)),
        "answers": sorted(Answer.objects.values_list("item", "value")),
        "drives": Drive.objects.count(),
    }


def go_on(walker: Walker, ask: Callable[[], None]) -> dict[str, object]:
    ask()
    walker.look()
    return counted(walker)


def at_a_drive(walker: Walker) -> bool:
    return isinstance(walker.step, Practice | TaskStep)


def comes_out_right(
    walker: Walker, ask: Callable[[], None], number: int, expected: dict[str, object]
) -> bool:
    """Cut a step off at a write, ask for it again, and tell whether there was such a write; all of
    it is taken back.
    """
    was_cut = False
    with transaction.atomic():
        try:
            with cut_at(number):
                go_on(walker, ask)
        except CutError:
            was_cut = True
            transaction.set_rollback(False)  # outside of tests, each request has its own
        assert go_on(walker, ask) == expected, f"cut at write {number}"
        transaction.set_rollback(True)
    return was_cut


@pytest.mark.nightly
def test_a_step_interrupted_anywhere_and_requested_again_gives_the_same_result(
    walker,
):
    for slug, version in (("ict", 2), ("experience", 1)):
        questions = [item("single", "a"), item("likert", "b")]
        store(defined(questions, slug=slug, version=version), timezone.now())
    for place in PLACES[:-1]:
        assert progress.place(walker.participant) == place
        walker.drive() if at_a_drive(walker) else walker.look()
        ask = requests_at(walker, place)
        with transaction.atomic():
            expected = go_on(walker, ask)
            transaction.set_rollback(True)
        assert expected["place"] == following(place).word
        writes = next(
            n for n in itertools.count() if not comes_out_right(walker, ask, n + 1, expected)
        )
        assert writes > 2, f"{place.word}: hardly anything was written"
        assert go_on(walker, ask) == expected
    assert walker.participant.status == "finished"
    assert [finished for *_, finished in expected["visits"]] == [True] * (len(PLACES) - 1) + [False]


@pytest.mark.parametrize("place", DRIVEN, ids=lambda place: place.step)
def test_a_drive_continues_when_its_network_returns(walker, place):
    drive, runner, records = driving(brought(walker, place))
    hear(runner, drive, records)
    before = counted(walker)
    Session.objects.filter(pk=drive.session_id).update(state="reconnecting", lost_at=timezone.now())
    assert "Back to the robot" in walker.look().text
    walker.client.post(walker.url(), {"place": place.word, "go": "without"})
    assert walker.client.get(walker.url("study_drive")).status_code == 200
    again = leases.take(walker.robot, walker.user, "another-peer", now=timezone.now())
    assert again.session == str(drive.session_id)
    assert counted(walker) == before
    assert Session.objects.count() == 1 + place_number(place)


@pytest.mark.parametrize("place", DRIVEN, ids=lambda place: place.step)
def test_a_drive_whose_network_stays_away_is_lost_once_and_its_late_states_are_kept(walker, place):
    drive, runner, records = driving(brought(walker, place))
    hear(runner, drive, records[:-8])
    at = records[-1].at + 120.0
    leases.end(str(drive.session_id), "connection_lost", "visitor_silent", moment(at))
    over(runner, drive, moved=True)
    page = walker.look()
    assert progress.place(walker.participant) == following(place), page.text
    before = counted(walker)
    write(drive, records)  # with those that the robot had kept for itself
    settle(close(drive, at=at), timezone.now())
    over(runner, drive, moved=True)
    walker.look()
    assert counted(walker) == before
    ended = Drive.objects.get(pk=drive.pk)
    assert (ended.outcome, ended.moved) == ("connection_lost", True)
    assert walker.participant.stage == ("filled" if place.step == "task" else "under_way")


@pytest.mark.parametrize("place", DRIVEN, ids=lambda place: place.step)
def test_a_step_can_be_repeated_after_a_network_failure_before_motion(walker, place):
    drive, runner, _records = driving(brought(walker, place))
    leases.end(str(drive.session_id), "connection_lost", "visitor_silent", timezone.now())
    over(runner, drive, moved=False)
    settle(close(drive, at=timezone.now().timestamp()), timezone.now())
    assert "Try again" in walker.look().text
    assert progress.place(walker.participant) == place
    RobotPresence.objects.update(turnaround="ready")
    second, _runner, _more = driving(walker)
    assert (second.pk != drive.pk, second.number) == (True, drive.number + 1)
    assert StepVisit.objects.filter(step=place.step).count() == 1


# --- the time is over -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "outcome"), [(DRIVEN[0], "completed"), (DRIVEN[1], "timed_out")], ids=["try", "task"]
)
def test_the_time_limit_of_a_drive_ends_it_once_and_leads_on_with_its_outcome(
    walker, place, outcome
):
    drive, runner, records = driving(brought(walker, place))
    hear(runner, drive, records)
    limit = records[0].at + LIMIT[place.step] + PATIENCE + 1.0
    for manager in (runner, runner, Runner()):  # the last one was started after it
        manager.tick(now=moment(limit))
    session = Session.objects.get(pk=drive.session_id)
    assert (session.state, session.outcome) == ("ended", outcome)
    over(runner, drive, moved=True)
    for client in (walker.client, walker.browser()):
        walker.look(client)
    assert progress.place(walker.participant) == following(place)
    write(drive, records)
    settle(close(drive, at=limit), timezone.now())
    assert Drive.objects.get(pk=drive.pk).outcome == outcome
    if place.step == "task":
        asked = Response.objects.get(questionnaire__slug="experience")
        assert asked.outcome == "timed_out"
        Response.objects.update(finished_at=timezone.now())
        assert completion.code(walker.study, "done") in walker.look().text
    visits = StepVisit.objects.values_list("step", flat=True)
    assert len(visits) == len(set(visits))


@pytest.mark.parametrize("place", DRIVEN, ids=lambda place: place.step)
def test_a_drive_without_a_picture_ends_with_its_turn_and_may_be_tried_again(walker, place):
    drive, runner, _records = driving(brought(walker, place))
    runner.tick(now=drive.granted_at + datetime.timedelta(seconds=LIMIT[place.step] + 181.0))
    session = Session.objects.get(pk=drive.session_id)
    assert (session.outcome, session.outcome_reason) == ("timed_out", "no_picture")
    over(runner, drive, moved=False)
    assert "Try again" in walker.look().text
    assert progress.place(walker.participant) == place


@pytest.mark.parametrize("place", READ, ids=lambda place: place.step)
def test_participants_whose_login_expires_continue_where_they_were(walker, place):
    brought(walker, place)
    before = counted(walker)
    walker.client.cookies.pop(settings.SESSION_COOKIE_NAME)
    sent = walker.client.post(walker.url(), {"place": place.word, "age": "30", "agree": "on"})
    assert sent.status_code == 302
    assert "/studies/" in walker.client.get(sent.url, follow=True).request["PATH_INFO"], (
        "to where one signs in"
    )
    assert counted(walker) == before
    walker.client.force_login(walker.user)
    walker.look()
    assert counted(walker) == before
    if place != PLACES[-1]:
        walker.do()
        assert progress.place(walker.participant) == following(place)


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.step)
def test_participants_keep_their_place_when_the_study_closes(walker, place):
    brought(walker, place)
    before = counted(walker)
    tomorrow = [{"days": [(timezone.now().weekday() + 2) % 7], "start": "09:00", "end": "10:00"}]
    for change in ({"opening_hours": tomorrow}, {"status": Study.Status.CLOSED}):
        Study.objects.update(**change)
        walker.look()
        assert counted(walker) == before
    walker.send(go="without") if place in DRIVEN else walker.do() if place != PLACES[-1] else None
    walker.look()
    expected = place if place == PLACES[-1] else following(place)
    assert progress.place(walker.participant) == expected


def driving(walker: Walker) -> tuple[Drive, Runner, list]:
    """Take the robot at the participant's step; return the drive, a runner, and the records of a
    drive to the first checkpoint.
    """
    granted = leases.take(walker.robot, walker.user, "peer", now=timezone.now())
    assert isinstance(granted, leases.TakeGranted)
    Session.objects.filter(pk=granted.session).update(state="driving", driving_at=timezone.now())
    drive = Drive.objects.select_related("session__robot", "participant__study").get(
        session=granted.session
    )
    start = timezone.now().timestamp()
    route = task_drives.Drive(at=start, frame=False).say(FirstFrame(start, repr(start - 3600.0)))
    return drive, Runner(), list(route.go(FIRST).records)


def hear(runner: Runner, drive: Drive, records: list) -> None:
    for record in records:
        say(runner, drive, record)


def over(runner: Runner, drive: Drive, *, moved: bool) -> None:
    """A session has ended, and the session manager hears so."""
    if moved:
        Session.objects.filter(pk=drive.session_id).update(first_motion_at=timezone.now())
    runner.on_end(session=Session.objects.get(pk=drive.session_id))


def moment(seconds: float) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC)


def place_number(place: JourneyPlace) -> int:
    """How many drives came before it."""
    return DRIVEN.index(place)
