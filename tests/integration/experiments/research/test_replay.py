"""The replay of a session: what it is made of, and who may see it."""

import gzip
import json
import re
import uuid
from typing import get_args, get_type_hints

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse

from experiments.models import Participant
from experiments.research.event_text import in_words
from experiments.research.replay import replay
from experiments.tasks.progress import EventType
from robots.api.messages import Event
from sessions.models import NetworkSample, StateChunk
from sessions.protocol import NOTICES
from tests.support.browsers.html_page import read
from tests.support.paths import ROOT
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies.members import member

pytestmark = pytest.mark.django_db


@pytest.fixture
def drive():
    """A minute that was driven in a study."""
    # a name of three hexadecimal digits might occur in an address by chance
    ada = person("ada", display_name="Ada L.")
    session = replays.session(replays.cabin_robot(), ada, seconds=60)
    replays.record(session)
    return replays.drive(replays.participant(replays.study(), session.visitor), session)


def data_of(client, session, **headers):
    return client.get(reverse("replay_data", args=[session.pk]), headers=headers)


def test_states_have_seconds_since_the_grant_by_the_servers_clock(drive):
    record = replay(drive.session, drive)
    assert record["duration"] == 60.0
    states = record["states"]
    assert len(states["t"]) == 240
    assert states["t"][:3] == [0.0, 0.25, 0.5]
    x, y, theta = replays.place(30.0)
    assert (states["x"][120], states["y"][120], states["theta"][120]) == pytest.approx(
        (x, y, theta), abs=1e-3
    )


def test_states_that_were_sent_again_later_are_in_order(drive):
    late = StateChunk.objects.order_by("first_seq")[10]
    StateChunk.objects.filter(pk=late.pk).update(received_at=late.received_at + 500.0)
    times = replay(drive.session, drive)["states"]["t"]
    assert times == sorted(times)
    assert len(times) == 240


def test_commands_come_one_after_the_other_before_their_state(drive):
    StateChunk.objects.all().delete()
    replays.record(drive.session, seconds=2, applied=5)
    record = replay(drive.session, drive)
    commands = record["commands"]
    assert len(commands["t"]) == 40
    assert commands["t"][5:10] == pytest.approx([0.05, 0.10, 0.15, 0.20, 0.25], abs=2e-3)
    assert [record["words"][commands[name][0]] for name in ("method", "way")] == [
        "keyboard",
        "datachannel",
    ]


def test_events_of_all_sources_are_in_one_order_of_time(drive):
    replays.told(drive.session, 20.0, "collision")
    replays.told(drive.session, 10.0, "map", source="page", open=True)
    replays.told(drive.session, -300.0, "offered", source="server")
    replays.task_told(drive, 15.0, "checkpoint", number=1, pose={"x": 1.0, "y": 2.0, "theta": 0.0})
    events = replay(drive.session, drive)["events"]
    assert [(event[0], event[1], event[2]) for event in events] == [
        (0.0, "server", "offered"),
        (10.0, "page", "map"),
        (15.0, "task", "checkpoint"),
        (20.0, "robot", "collision"),
    ]
    assert events[2][3] == "number 1"


def test_unknown_values_of_the_network_stay_unknown(drive):
    NetworkSample.objects.filter(session=drive.session).update(
        data={"way": "mqtt", "roundTrip": None}
    )
    network = replay(drive.session, drive)["network"]
    assert network["roundTrip"] == [None] * 60
    assert network["loss"] == [None] * 60


def test_an_empty_session_has_an_empty_record():
    session = replays.session(replays.cabin_robot(), person("ada"), seconds=0, granted_at=None)
    record = replay(session, None)
    assert record["duration"] == 0.0
    assert all(
        column == []
        for name in ("states", "commands", "network")
        for column in record[name].values()
    )


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (
            {"name": "door", "pose": {"x": 1.0}, "sight": {"bearing": 0.123456, "sees": True}},
            "door · the mirror: bearing (rad) 0.123, in view yes",
        ),
        ({"name": "go_to_checkpoint", "number": 2}, "next: go to checkpoint 2"),
        (
            {"word": "cue.dock_now", "number": None, "seconds": 4.0},
            "next: dock · duration 4 s",
        ),
        ({"outcome": "timed_out", "reason": ""}, "timed out"),
        ({"reason": "start: not_docked"}, "it is not docked"),
        ({"method": "keyboard"}, "keyboard"),
        ({"detail": "lab_door closed"}, "lab door closed"),
        ({"on": False, "why": ""}, "on no"),
        ({"detail": "(participant)"}, "Participant"),
        ({"actionId": "a1", "status": "FINISHED", "type": "goto"}, "finished · drive to a point"),
    ],
)
def test_the_data_of_an_event_are_shown_in_words(data, told):
    assert in_words(data) == told


def test_a_long_text_is_cut():
    assert len(in_words({"text": "x" * 500})) == 160


def events_of_the_site() -> set[str]:
    """Every event that robot, server, page and task may tell."""
    scripts = "".join(path.read_text() for path in (ROOT / "static/js").rglob("*.js"))
    reference = (ROOT / "docs/reference/studies.md").read_text()
    of_the_page = reference.partition("## Events of the page")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]*`) \|", of_the_page, re.MULTILINE)
    return {
        *get_args(get_type_hints(Event)["type"]),
        *get_args(EventType),
        *re.findall(r"\breport\(\s*\"([a-z_]+)\"", scripts),
        *(name for row in rows for name in re.findall(r"`([a-z_]+)`", row)),
        *(NOTICES.keys() - {"task"}),
        *("action", "states_missing", "robot_not_ready", "robot_ready", "staff_called"),
        *("operator_message", "operator_end"),
    }


def test_every_event_type_of_the_site_has_a_text():
    words = (ROOT / "templates/experiments/research/_replay_words.html").read_text()
    names = events_of_the_site()
    assert {"lease_taken", "cue_shown", "offered", "link_lost"} <= names
    assert [name for name in sorted(names) if f'"event.{name}"' not in words] == []


# --- who may see it -------------------------------------------------------------------------------


@pytest.mark.parametrize("role", ["owner", "researcher", "viewer"])
def test_researchers_of_the_study_see_it(client, drive, role):
    client.force_login(member(role))
    assert client.get(reverse("replay", args=[drive.session_id])).status_code == 200
    assert len(data_of(client, drive.session).json()["states"]["t"]) == 240


def test_the_readings_have_plain_labels(client, drive):
    client.force_login(member("viewer"))
    page = read(client.get(reverse("replay", args=[drive.session.pk])))
    names = [one.text for one in page.all("dt")]
    places = [one.attributes["id"] for one in page.all("dd")]
    called = dict(zip(places, names, strict=True))
    # m/s and rad/s: static/js/pages/replay/readings.js
    assert called["reading-driven"] == "Speed"


def test_other_users_find_no_replay(client, drive):
    addresses = [
        reverse("replay", args=[drive.session_id]),
        reverse("replay_data", args=[drive.session_id]),
    ]
    for user in (
        None,
        drive.participant.user,
        member("owner", "another-study"),
        person("staff", is_staff=True),
    ):
        if user is not None:
            client.force_login(user)
        assert [client.get(address).status_code for address in addresses] == [404, 404]


def test_staff_who_may_see_sessions_see_one_without_a_study(client):
    session = replays.session(replays.cabin_robot(), person("ada"), seconds=1)
    staff = person("staff", is_staff=True)
    staff.user_permissions.add(
        Permission.objects.get(
            codename="view_session", content_type__app_label="telepresence_sessions"
        )
    )
    client.force_login(staff)
    assert client.get(reverse("replay", args=[session.pk])).status_code == 200
    assert data_of(client, session).json()["states"]["t"] == []


def test_a_session_that_does_not_exist_is_not_found(client, admin_client):
    assert admin_client.get(reverse("replay", args=[uuid.uuid4()])).status_code == 404
    assert admin_client.get("/studies/replay/not-an-id/").status_code == 404


def test_researchers_cannot_see_the_drive_of_a_withdrawn_participant(client, drive):
    Participant.objects.update(status="withdrawn")
    client.force_login(member("owner"))
    assert client.get(reverse("replay", args=[drive.session_id])).status_code == 404


def test_viewers_see_no_photos_and_no_role_sees_a_visitors_name(client, drive):
    snapshot = replays.photo(drive.session, 30.0)
    address = reverse("replay_photo", args=[drive.session_id, snapshot.pk])
    client.force_login(member("viewer"))
    assert client.get(address).status_code == 404
    assert address.encode() not in client.get(reverse("replay", args=[drive.session_id])).content
    client.force_login(member("researcher"))
    page = client.get(reverse("replay", args=[drive.session_id])).content.decode()
    assert address in page
    assert '"t": 30.0' in page
    assert drive.participant.code in page
    assert drive.session.visitor.shown_name not in page
    assert client.get(address).content == b"\xff\xd8jpeg"


def test_a_photo_of_another_session_is_not_given_out(client, drive):
    other = replays.session(drive.session.robot, person("bob"), seconds=1)
    snapshot = replays.photo(other, 0.0)
    client.force_login(member("owner"))
    assert (
        client.get(reverse("replay_photo", args=[drive.session_id, snapshot.pk])).status_code == 404
    )


def test_the_record_is_sent_compressed(client, drive):
    client.force_login(member("viewer"))
    response = data_of(client, drive.session, **{"Accept-Encoding": "gzip"})
    assert response["Content-Encoding"] == "gzip"
    assert json.loads(gzip.decompress(response.content))["duration"] == 60.0
