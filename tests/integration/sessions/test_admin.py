"""Sessions, leases and the system log in the administration."""

import csv
import io
import json
import re

import msgspec
import pytest
from django.contrib.auth.models import Permission
from django.db import connection
from django.test.utils import CaptureQueriesContext
from django.utils import timezone

from accounts.models import AuditEntry, User
from robots.api import codec, messages
from robots.models import Robot
from sessions import system_log
from sessions.leases import store
from sessions.models import (
    Lease,
    ManagerBeat,
    NetworkSample,
    Session,
    SessionEvent,
    Snapshot,
    StateChunk,
    SystemLog,
)
from tests.support import words
from tests.support.sessions.rows import chunk_row, session_row
from tests.support.streamed import body_of

pytestmark = pytest.mark.django_db
ADMIN = "/admin/telepresence_sessions/"
LIST = f"{ADMIN}session/"


@pytest.fixture
def researcher(client):
    user = User.objects.create(username="researcher", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def assistant(client):
    """A staff user who may only view sessions."""
    user = User.objects.create(username="assistant", is_staff=True)
    app = {"content_type__app_label": "telepresence_sessions"}
    user.user_permissions.add(Permission.objects.get(codename="view_session", **app))
    client.force_login(user)
    return user


def state(seq: int, **changes) -> dict:
    moving = {
        "pose": messages.Pose(x=1.5, y=-2.0, theta=0.1),
        "velocity": messages.Velocity(linear=0.3, angular=0.0),
        "applied": (words.applied(seq, way="mqtt"),),
    }
    made = words.state(seq, boot="-boot;=1+1", **moving | changes)
    return msgspec.json.decode(codec.encode(made))


@pytest.fixture
def session(giraff):
    now = timezone.now()
    summary = {"states": 8, "distance": 12.34, "methods": {"keyboard": 3, "touch": 1}}
    row = session_row(
        giraff,
        User.objects.create(username="ana", display_name="Ana <i>"),
        state="ended",
        outcome="completed",
        driving_at=now,
        ended_at=now + timezone.timedelta(minutes=3),
        device={"os": "Linux", "browser": "Firefox"},
        closed_at=now,
        summary=summary | {"ways": {"mqtt": 4}, "missing": 0},
    )
    for first in (0, 4):
        chunk_row(row, [state(seq) for seq in range(first, first + 4)], clock_offset=0.01)
    return row


@pytest.fixture
def ben(giraff):
    """The driver of a live session; its id is `ben.session`."""
    user = User.objects.create(username="ben")
    user.session = store.take(giraff, user, "secret-peer", now=timezone.now()).session
    return user


def page(client, address, **query):
    return client.get(address, query).content.decode()


def act(client, action, *sessions):
    chosen = {"action": action, "_selected_action": [str(one) for one in sessions]}
    return client.post(LIST, chosen, follow=True)


def test_list_shows_visitor_robot_outcome_duration_distance_and_devices(
    client, researcher, session
):
    text = page(client, LIST)
    shown = ("Ana &lt;i&gt;", "Giraff", "completed", "3.0", "12.3", "keyboard 75%, touch 25%")
    for part in (*shown, "Linux · Firefox"):
        assert part in text
    assert f"/admin/accounts/user/{session.visitor_id}/change/" in text
    assert f"/admin/robots/robot/{session.robot_id}/change/" in text


def test_number_of_queries_of_the_list_does_not_grow_and_no_states_are_read(
    client, researcher, giraff, session
):
    client.get(LIST)
    with CaptureQueriesContext(connection) as few:
        client.get(LIST)
    visitors = User.objects.bulk_create([User(username=f"v{n}") for n in range(40)])
    for visitor in visitors:
        session_row(giraff, visitor, state="ended")
    with CaptureQueriesContext(connection) as many:
        client.get(LIST)
    assert len(many) == len(few)
    assert not any("statechunk" in query["sql"] for query in many)


@pytest.mark.parametrize(
    ("query", "found"),
    [
        ({"q": "ana"}, True),
        ({"q": "giraff"}, True),
        ({"q": "unknown"}, False),
        ({"q": "ID"}, True),
        ({"q": "7d9f1c52-0000-4000-8000-000000000000"}, False),
        ({"outcome__exact": "completed"}, True),
        ({"outcome__exact": "robot_fault"}, False),
    ],
)
def test_sessions_are_searched_and_filtered(client, researcher, session, query, found):
    values = {name: value.replace("ID", str(session.pk)) for name, value in query.items()}
    assert (str(session.pk) in page(client, LIST, **values)) is found


def snapshot_of(session):
    image = {"sha256": "0" * 64, "jpeg": b"\xff\xd8jpeg"}
    return Snapshot.objects.create(session=session, action_id="p1", stamp=2.0, **image)


def test_page_of_a_session_shows_events_network_and_snapshots_escaped(client, researcher, session):
    event = {"source": "page", "type": "controller", "stamp": 1.0, "received_at": 1.0}
    method = {"method": "<script>alert(1)</script>"}
    SessionEvent.objects.create(session=session, data=method, **event)
    for n in range(20):
        data = {"way": "datachannel", "roundTrip": 0.01 * (n + 1), "fps": 30.0}
        NetworkSample.objects.create(session=session, stamp=n, received_at=n, data=data)
    snapshot = snapshot_of(session)
    text = page(client, f"{LIST}{session.pk}/change/")
    assert "<script>alert(1)" not in text
    for shown in ("&lt;script&gt;alert(1)", "0.105", "0.190", f"snapshots/{snapshot.pk}.jpg"):
        assert shown in text
    assert 'type="text"' not in re.sub(r'<input type="text"[^>]*name="q"', "", text), "editable"


def test_snapshots_are_for_staff_who_may_view_sessions(client, session, assistant):
    address = f"{LIST}snapshots/{snapshot_of(session).pk}.jpg"
    answer = client.get(address)
    assert (answer.status_code, answer.content) == (200, b"\xff\xd8jpeg")
    assert answer["Content-Type"] == "image/jpeg"
    client.force_login(User.objects.create(username="other", is_staff=True))
    assert client.get(address).status_code == 403
    client.force_login(session.visitor)
    assert client.get(address).status_code == 302


def test_csv_has_one_line_per_state_and_no_formulas(client, assistant, session):
    answer = client.get(f"{LIST}{session.pk}/states.csv")
    lines = list(csv.DictReader(io.StringIO(body_of(answer).decode())))
    assert [int(line["seq"]) for line in lines] == list(range(8))
    pose = {"x": "1.5", "y": "-2.0"}
    command = {"linear": "0.3", "method": "keyboard", "way": "mqtt", "commands": "1"}
    assert lines[0].items() >= (pose | command).items()
    assert lines[0]["boot"] == "'-boot;'=1+1"
    assert "attachment" in answer["Content-Disposition"]


def test_json_contains_the_states_as_the_robot_sent_them(client, assistant, session):
    SessionEvent.objects.create(
        session=session, source="server", type="driving", stamp=1.0, received_at=1.0
    )
    (record,) = json.loads(body_of(client.get(f"{LIST}{session.pk}/states.json")))
    assert record["session"] == str(session.pk)
    states = [one for chunk in record["chunks"] for one in chunk["states"]]
    assert states == [state(seq) for seq in range(8)]
    assert record["events"][0]["type"] == "driving"


def test_several_sessions_are_downloaded_in_one_file(client, researcher, giraff, session):
    empty = session_row(giraff, User.objects.create(username="ben"), state="ended")
    document = json.loads(body_of(act(client, "download_json", session.pk, empty.pk)))
    assert [len(one["chunks"]) for one in document] == [2, 0]


def test_operator_stops_a_live_session(client, researcher, giraff, ben):
    change = f"{LIST}{ben.session}/change/"
    assert "Stop this session now" in page(client, change)
    answer = client.post(f"{LIST}{ben.session}/stop/", follow=True)
    assert "One session was stopped." in answer.content.decode()
    stopped = Session.objects.get(pk=ben.session)
    assert (stopped.state, stopped.outcome) == ("ended", "stopped_by_operator")
    assert stopped.outcome_reason == "by an operator"
    assert Lease.objects.get(robot=giraff).session is None
    assert SystemLog.objects.get(event="session_stopped").fields == {"user": str(researcher.pk)}
    noted = AuditEntry.objects.get(act="session_stopped")
    assert (noted.actor, noted.person) == (researcher.pk, stopped.visitor_id)
    assert (noted.robot, noted.thing) == ("giraff", str(stopped.pk))
    assert "Stop this session now" not in page(client, change)


def test_stopping_from_the_list_counts_only_live_sessions(client, researcher, session, ben):
    answer = act(client, "stop_sessions", ben.session, session.pk)
    assert "One session was stopped." in answer.content.decode()


def test_user_who_may_only_view_can_neither_stop_nor_change_nor_delete(client, assistant, ben):
    assert "stop_sessions" not in page(client, LIST)
    act(client, "stop_sessions", ben.session)
    for view, form in (
        ("stop", {}),
        ("change", {"outcome": "completed"}),
        ("delete", {"post": "yes"}),
    ):
        assert client.post(f"{LIST}{ben.session}/{view}/", form).status_code == 403
    assert Session.objects.get(pk=ben.session).state == "connecting"


def test_get_request_does_not_stop_a_session(client, researcher, ben):
    assert client.get(f"{LIST}{ben.session}/stop/").status_code == 403


def test_only_an_ended_session_can_be_deleted_with_its_record(client, researcher, session, ben):
    assert "2" in page(client, f"{LIST}{session.pk}/delete/")
    assert client.post(f"{LIST}{session.pk}/delete/", {"post": "yes"}).status_code == 302
    assert not StateChunk.objects.exists()
    assert client.post(f"{LIST}{ben.session}/delete/", {"post": "yes"}).status_code == 403


def test_lease_shows_the_driver_and_not_the_pages_secret(client, researcher, giraff, ben):
    listed = page(client, f"{ADMIN}lease/")
    assert "ben" in listed
    assert "secret-peer" not in listed + page(client, f"{ADMIN}lease/{giraff.pk}/change/")


def test_system_log_is_listed_with_its_fields(client, researcher, giraff, session):
    where = {"robot": giraff, "session": session}
    system_log.log("robot_offline", "warning", state="CONNECTIONBROKEN", **where)
    text = page(client, f"{ADMIN}systemlog/", level__exact="warning")
    assert "robot_offline" in text
    assert "state=CONNECTIONBROKEN" in text
    entry = SystemLog.objects.get()
    assert client.get(f"{ADMIN}systemlog/{entry.pk}/change/").status_code == 200


def test_list_of_session_managers_shows_whether_one_runs_in_both_languages(client, researcher):
    address = f"{ADMIN}managerbeat/"
    ManagerBeat.objects.create(holder="here:1", beat_at=timezone.now())
    assert "icon-yes" in page(client, address)
    ManagerBeat.objects.update(beat_at=timezone.now() - timezone.timedelta(seconds=60))
    assert "icon-no" in page(client, address)
    text = client.get(address, headers={"accept-language": "es"}).content.decode()
    for column in ("nombre", "equipo y proceso", "última señal de vida"):
        assert column in text.lower()
    assert "beat at" not in text.lower()


def test_ended_sessions_cannot_be_stopped(client, researcher, session):
    answer = act(client, "stop_sessions", session.pk)
    assert "None of these sessions was running." in answer.content.decode()
    assert Session.objects.get().outcome == "completed"
    assert not SystemLog.objects.exists()


def test_session_that_ends_while_it_is_stopped_is_not_counted(client, researcher, ben, monkeypatch):
    end = store.end

    def too_late(*values):
        end(ben.session, "completed", "left", timezone.now())
        return end(*values)

    monkeypatch.setattr(store, "end", too_late)
    answer = client.post(f"{LIST}{ben.session}/stop/", follow=True)
    assert "None of these sessions was running." in answer.content.decode()
    assert Session.objects.get().outcome == "completed"
    assert not SystemLog.objects.exists()


def test_download_as_one_table_is_audited(client, researcher, session):
    answer = act(client, "download_csv", session.pk)
    assert len(list(csv.DictReader(io.StringIO(body_of(answer).decode())))) == 8
    assert AuditEntry.objects.get(act="sessions_exported").detail == "csv of 1"


@pytest.fixture
def owner(client, giraff):
    user = User.objects.create(username="owner", is_staff=True)
    Robot.objects.update(owner=user)
    client.force_login(user)
    return user


def test_owner_sees_a_session_without_its_visitor(client, owner, session):
    text = page(client, f"{LIST}{session.pk}/change/")
    assert "12.3" in text
    for hidden in ("Ana", "Firefox", "Device and network", "Photos"):
        assert hidden not in text
    assert client.get(f"{LIST}{session.pk}/states.csv").status_code == 403
    assert not AuditEntry.objects.exists()


def test_practice_robot_is_shown_without_a_link(client, researcher, giraff, session):
    Robot.objects.update(practice=True)
    text = page(client, f"{LIST}{session.pk}/change/")
    assert "Giraff" in text
    assert f"/admin/robots/robot/{giraff.pk}/change/" not in text


def test_lease_of_a_free_robot_has_no_driver(client, researcher, giraff):
    Lease.objects.create(robot=giraff, epoch=3, changed_at=timezone.now())
    assert "nobody" in page(client, f"{ADMIN}lease/")


def test_log_entry_without_a_session_is_listed(client, researcher, giraff):
    system_log.log("robot_offline", "warning", robot=giraff)
    text = page(client, f"{ADMIN}systemlog/")
    assert "robot_offline" in text
    assert "telepresence_sessions/session/" not in text.partition('id="result_list"')[2]
