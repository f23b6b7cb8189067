"""The live view: what it tells of a study, who may see it, and what may be done to a session."""

import datetime

import pytest
from django.urls import reverse
from django.utils import timezone

from experiments.research import interventions, live
from robots.bridge import bridge as mqtt_bridge
from robots.models import Robot
from sessions.leases import store
from sessions.models import Session, SessionEvent, SystemLog
from sessions.protocol import OperatorMessage
from tests.support.people import person
from tests.support.robots import create_robot
from tests.support.sessions import replays
from tests.support.sessions.memory_bridge import MemoryBridge
from tests.support.studies.members import member
from tests.support.studies.studies import STUDY

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    report = {
        "stamp": 5.0,
        "pose": {"x": 1.0, "y": 2.0, "theta": 0.0},
        "battery": {"charge": 0.7},
        "docked": False,
    }
    return replays.cabin_robot(connection="ONLINE", last_seen_at=timezone.now(), report=report)


@pytest.fixture
def drive(robot):
    """A drive that began ten seconds ago."""
    session = replays.session(
        robot, person("ada"), granted=timezone.now() - datetime.timedelta(seconds=10)
    )
    replays.record(session, seconds=10)
    return replays.drive(replays.participant(replays.study(), session.visitor), session)


@pytest.fixture
def bridge():
    mqtt_bridge.use(MemoryBridge())
    yield mqtt_bridge._Process.bridge
    mqtt_bridge.use(None)


def seen(now: datetime.datetime | None = None):
    return live.now_in("cabin-study", now or timezone.now())


def act(client, **body):
    return client.post(reverse("study_live_act", args=["cabin-study"]), body)


def operators_acts():
    return list(
        SessionEvent.objects.filter(type__startswith="operator").values_list("type", "source")
    )


def test_a_drive_has_the_newest_state_and_network(drive):
    shown = seen()["drives"][0]
    x, y, _ = replays.place(9.75)
    assert (shown["pose"]["x"], shown["pose"]["y"]) == pytest.approx((x, y))
    assert shown["network"]["fps"] == 30.0
    assert shown["code"] == drive.participant.code
    assert (shown["robot"], shown["state"]) == ("giraff", "driving")


def test_errors_of_the_page_are_counted(drive):
    assert seen()["drives"][0]["script_errors"] == 0
    data = {"error": "TypeError: x is null", "times": 1}
    replays.told(drive.session, 2.0, "script_error", "page", **data)
    assert seen()["drives"][0]["script_errors"] == 1


def test_the_progress_of_a_task_follows_its_events(drive):
    replays.task_told(drive, 1.0, "task_started")
    replays.task_told(drive, 4.0, "checkpoint", number=1)
    replays.task_told(drive, 4.0, "cue", name="go_to_checkpoint", number=2)
    task = seen(drive.granted_at + datetime.timedelta(seconds=10))["drives"][0]["task"]
    assert (task["cue"], task["number"]) == ("go_to_checkpoint", 2)
    assert (task["passed"], task["checkpoints"]) == ([1], 2)
    assert task["remaining"] == pytest.approx(300.0 - 9.0)


def test_a_door_is_shown_as_set_and_as_confirmed_by_the_robot(drive, robot):
    Robot.objects.update(doors={"door": "closed"})
    assert [(door["set"], door["confirmed"]) for door in seen()["robots"][0]["doors"]] == [
        ("closed", None)
    ]
    replays.told(drive.session, 2.0, "door_changed", detail="door open")
    replays.told(drive.session, 3.0, "door_changed", detail="door closed")
    door = seen()["robots"][0]["doors"][0]
    assert door["confirmed"] == "closed"
    assert door["at"] == pytest.approx(drive.granted_at.timestamp() + 3.0)


def test_robots_that_most_participants_cannot_use_come_last_and_say_so(robot):
    def version(number, *accesses, status="published"):
        series = ("giraff", "rhodon")
        conditions = [
            {**STUDY["conditions"][0], "key": f"c{n}", "robot": series[n], "access": access}
            for n, access in enumerate(accesses)
        ]
        definition = {**STUDY, "version": number, "conditions": conditions, "courses": []}
        replays.study(version=number, definition=definition, status=status)

    other = replays.cabin_robot("a-rhodon")
    other.presence.factsheet["series"] = "rhodon"
    other.presence.save()
    version(1, "open", "open")
    assert [(one["name"], one["use"]) for one in seen()["robots"]] == [
        (other.name, "open"),
        ("giraff", "open"),
    ]
    version(2, "open", "invitation")
    assert [(one["name"], one["use"]) for one in seen()["robots"]] == [
        ("giraff", "open"),
        (other.name, "invitation"),
    ]
    version(3, "open")
    assert [one["use"] for one in seen()["robots"]] == ["open", "none"]
    version(4, "invitation", "open", status="draft")
    assert [one["use"] for one in seen()["robots"]] == ["open", "none"], "a draft changes nothing"


def test_the_page_has_the_course_of_each_robot_in_each_version(client, drive):
    replays.study(version=2, definition={**STUDY, "version": 2, "courses": []})
    client.force_login(member("viewer"))
    config = client.get(reverse("study_live", args=["cabin-study"])).context["config"]
    (course,) = STUDY["courses"]
    assert config["version"] == 2
    assert config["courses"].keys() == {"giraff"}
    assert config["courses"]["giraff"].keys() == {1}
    shown = config["courses"]["giraff"][1]
    assert [stop["number"] for stop in shown["checkpoints"]] == [0, 1, 2]
    assert [list(point) for point in shown["path"]] == course.get("path", [])
    assert seen()["drives"][0]["version"] == 1


def test_participants_of_the_last_hour_are_shown_with_their_step(drive):
    replays.participant(
        drive.participant.study, person("old"), seen_at=timezone.now() - datetime.timedelta(hours=2)
    )
    people = seen()["participants"]
    assert [(one["code"], one["step"], one["condition"]) for one in people] == [
        (drive.participant.code, "Task", "Open")
    ]


def test_the_queue_shows_codes_of_participants_and_no_names_of_others(drive, robot):
    of_the_study = replays.participant(drive.participant.study, person("bob"))
    for number, user in enumerate((of_the_study.user, person("stranger"))):
        at = timezone.now() + datetime.timedelta(seconds=number)
        Session.objects.create(
            robot=robot, visitor=user, state="waiting", live_key=f"w{number}", queued_at=at
        )
    assert seen()["queues"] == {"giraff": [of_the_study.code, ""]}


def test_a_robot_that_never_reported_is_shown_without_values(drive):
    replays.cabin_robot("silent")
    silent = next(robot for robot in seen()["robots"] if robot["name"] == "silent")
    assert (silent["online"], silent["pose"], silent["heard"]) == (False, None, None)


def test_the_number_of_queries_does_not_grow_with_the_participants(
    drive, django_assert_max_num_queries
):
    for number in range(20):
        replays.participant(drive.participant.study, person(f"p{number}"))
    with django_assert_max_num_queries(15):
        seen()


# --- who may --------------------------------------------------------------------------------------


def test_only_members_of_the_study_see_it(client, drive):
    addresses = [
        reverse("study_live", args=["cabin-study"]),
        reverse("study_live_data", args=["cabin-study"]),
    ]
    assert [client.get(address).status_code for address in addresses] == [404, 404]
    client.force_login(member("owner", "another"))
    assert [client.get(address).status_code for address in addresses] == [404, 404]
    client.force_login(member("viewer"))
    assert [client.get(address).status_code for address in addresses] == [200, 200]


def test_a_study_that_does_not_exist_is_not_found(admin_client):
    assert admin_client.get(reverse("study_live", args=["nothing"])).status_code == 404


def test_viewers_cannot_intervene(client, drive):
    client.force_login(member("viewer"))
    assert b'name="act"' not in client.get(reverse("study_live", args=["cabin-study"])).content
    assert act(client, act="end", session=str(drive.session_id), text="no").status_code == 404
    assert operators_acts() == []


def test_the_session_of_another_study_is_not_found(client, drive):
    replays.study(slug="other")
    client.force_login(member("owner", "other"))
    body = {"act": "end", "session": str(drive.session_id), "text": "mine"}
    assert client.post(reverse("study_live_act", args=["other"]), body).status_code == 404
    assert Session.objects.get().state == "driving"


# --- acts -----------------------------------------------------------------------------------------


def test_ending_a_session_needs_a_reason_and_is_recorded(client, drive):
    client.force_login(member("researcher"))
    assert act(client, act="end", session=str(drive.session_id), text=" ").status_code == 409
    assert Session.objects.get().state == "driving"
    assert (
        act(client, act="end", session=str(drive.session_id), text="smoke in the room").status_code
        == 200
    )
    ended = Session.objects.get()
    assert (ended.outcome, ended.outcome_reason) == ("stopped_by_operator", "smoke in the room")
    assert operators_acts() == [("operator_end", "server")]
    assert act(client, act="end", session=str(drive.session_id), text="again").status_code == 409


def test_a_message_reaches_the_visitor_and_is_recorded(client, drive, monkeypatch):
    sent = []
    monkeypatch.setattr(interventions, "send_notice", lambda *said: sent.append(said) or True)
    researcher = member("researcher")
    client.force_login(researcher)
    assert (
        act(
            client, act="message", session=str(drive.session_id), text="Turn round, please."
        ).status_code
        == 200
    )
    assert sent == [
        ("giraff", OperatorMessage(session=str(drive.session_id), text="Turn round, please."))
    ]
    assert operators_acts() == [("operator_message", "server")]
    assert SessionEvent.objects.get(type="operator_message").data == {
        "text": "Turn round, please.",
        "user": str(researcher.pk),
    }


def test_a_message_that_cannot_be_sent_is_reported(client, drive, monkeypatch):
    monkeypatch.setattr(interventions, "send_notice", lambda *_said: False)
    client.force_login(member("researcher"))
    response = act(client, act="message", session=str(drive.session_id), text="Hello?")
    assert response.status_code == 409
    assert "could not be sent" in response.json()["problem"]
    assert operators_acts() == []


def test_a_paused_queue_lets_the_driver_continue_and_starts_no_other_drive(client, drive, robot):
    client.force_login(member("researcher"))
    assert act(client, act="hold", robot="giraff", text="a new carpet").status_code == 200
    assert Session.objects.get().state == "driving"
    assert store.pause_of(robot) == "held: a new carpet"
    store.end(str(drive.session_id), "completed", "", timezone.now())
    waiting = store.take(Robot.objects.get(), person("bob"), "peer", now=timezone.now())
    assert isinstance(waiting, store.Queued)
    assert waiting.reason == "held: a new carpet"
    assert act(client, act="release", robot="giraff").status_code == 200
    assert store.pause_of(robot) == ""
    assert act(client, act="release", robot="giraff").status_code == 409
    assert list(
        SystemLog.objects.filter(event__startswith="queue_")
        .order_by("at")
        .values_list("event", flat=True)
    ) == [
        "queue_held",
        "queue_released",
    ]


def test_a_robot_of_another_site_is_not_held(client, drive):
    create_robot(name="elsewhere", title="Elsewhere", factsheet={"series": "giraff"})
    client.force_login(member("owner"))
    assert act(client, act="hold", robot="elsewhere", text="no").status_code == 404
    assert act(client, act="dance", robot="giraff", text="no").status_code == 409
    assert act(client, act="end", session="not-an-id", text="no").status_code == 404


def test_the_page_calls_study_and_doors_by_their_names_in_its_language(drive, robot, client):
    study, plan = drive.participant.study, robot.floor_plan
    study.definition = study.definition | {"title": {"en": "Cabin", "es": "Cabaña"}}
    study.save()
    plan.plan = plan.plan | {"translations": {"es": {"Door": "Puerta"}}}
    plan.save()
    client.force_login(member("viewer"))
    for language, title, door in (("en", "Cabin", "Door"), ("es", "Cabaña", "Puerta")):
        client.cookies["django_language"] = language
        page = client.get(reverse("study_live", args=["cabin-study"])).content.decode()
        assert f"<h1>{title}</h1>" in page
        data = client.get(reverse("study_live_data", args=["cabin-study"])).json()
        assert [one["title"] for one in data["robots"][0]["doors"]] == [door]
