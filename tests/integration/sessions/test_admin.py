"""Sessions, leases and the system log in the administration."""

import csv
import io
import json
import re

import msgspec
import pytest
from asgiref.sync import async_to_sync
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
from tests.support.robots import create_robot

pytestmark = pytest.mark.django_db
LIST = "/admin/telepresence_sessions/session/"


@pytest.fixture
def researcher(client):
    user = User.objects.create(username="researcher", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def assistant(client):
    """A member of the staff who may only view sessions."""
    user = User.objects.create(username="assistant", is_staff=True)
    user.user_permissions.add(
        Permission.objects.get(
            codename="view_session", content_type__app_label="telepresence_sessions"
        )
    )
    client.force_login(user)
    return user


def state(seq: int, **changes) -> dict:
    command = messages.AppliedCommand(
        seq=seq, stamp=seq * 0.25, method="keyboard", way="mqtt", age=0.02, linear=0.3, angular=0.0
    )
    made = messages.State(
        stamp=1000.0 + seq * 0.25,
        boot="-boot;=1+1",
        seq=seq,
        pose=messages.Pose(x=1.5, y=-2.0, theta=0.1),
        velocity=messages.Velocity(linear=0.3, angular=0.0),
        battery=messages.Battery(charge=0.5),
        applied=(command,),
        **changes,
    )
    return msgspec.json.decode(codec.encode(made))


@pytest.fixture
def session(giraff):
    now = timezone.now()
    row = Session.objects.create(
        robot=giraff,
        visitor=User.objects.create(username="ana", display_name="Ana <i>"),
        state="ended",
        outcome="completed",
        live_key="k",
        queued_at=now,
        driving_at=now,
        ended_at=now + timezone.timedelta(minutes=3),
        device={"os": "Linux", "browser": "Firefox"},
        closed_at=now,
        summary={
            "states": 8,
            "distance": 12.34,
            "methods": {"keyboard": 3, "touch": 1},
            "ways": {"mqtt": 4},
            "missing": 0,
        },
    )
    for first in (0, 4):
        StateChunk.objects.create(
            session=row,
            boot="-boot;=1+1",
            first_seq=first,
            last_seq=first + 3,
            count=4,
            first_stamp=1000.0 + first / 4,
            last_stamp=1000.75 + first / 4,
            received_at=1.0,
            clock_offset=0.01,
            states=[state(seq) for seq in range(first, first + 4)],
        )
    return row


def test_the_list_shows_who_drove_what_how_long_how_far_and_with_what(client, researcher, session):
    page = client.get(LIST).content.decode()
    for shown in (
        "Ana &lt;i&gt;",
        "Giraff",
        "completed",
        "3.0",
        "12.3",
        "keyboard 75%, touch 25%",
        "Linux · Firefox",
    ):
        assert shown in page
    assert f"/admin/accounts/user/{session.visitor_id}/change/" in page
    assert f"/admin/robots/robot/{session.robot_id}/change/" in page


def test_the_list_costs_the_same_for_many_sessions_and_never_reads_states(
    client, researcher, giraff, session
):
    client.get(LIST)
    with CaptureQueriesContext(connection) as few:
        client.get(LIST)
    visitors = User.objects.bulk_create([User(username=f"v{n}") for n in range(40)])
    Session.objects.bulk_create(
        [
            Session(
                robot=giraff,
                visitor=visitor,
                state="ended",
                live_key=visitor.username,
                queued_at=timezone.now(),
            )
            for visitor in visitors
        ]
    )
    with CaptureQueriesContext(connection) as many:
        client.get(LIST)
    assert len(many) == len(few)
    assert not any("statechunk" in query["sql"] for query in many)


@pytest.mark.parametrize(
    ("term", "found"),
    [
        ("ana", True),
        ("giraff", True),
        ("nobody", False),
        ("7d9f1c52-0000-4000-8000-000000000000", False),
    ],
)
def test_sessions_are_found_by_visitor_and_robot(client, researcher, session, term, found):
    assert (str(session.pk) in client.get(LIST, {"q": term}).content.decode()) is found


def test_a_session_is_found_by_its_id(client, researcher, session):
    assert str(session.pk) in client.get(LIST, {"q": str(session.pk)}).content.decode()


def test_filters_narrow_the_list(client, researcher, session):
    assert str(session.pk) in client.get(LIST, {"outcome__exact": "completed"}).content.decode()
    assert (
        str(session.pk) not in client.get(LIST, {"outcome__exact": "robot_fault"}).content.decode()
    )


def test_the_page_of_a_session_shows_events_network_and_snapshots_escaped(
    client, researcher, session
):
    SessionEvent.objects.create(
        session=session,
        source="page",
        type="controller",
        stamp=1.0,
        received_at=1.0,
        data={"method": "<script>alert(1)</script>"},
    )
    for n in range(20):
        NetworkSample.objects.create(
            session=session,
            stamp=n,
            received_at=n,
            data={"way": "datachannel", "roundTrip": 0.01 * (n + 1), "fps": 30.0},
        )
    snapshot = Snapshot.objects.create(
        session=session, action_id="p1", stamp=2.0, sha256="0" * 64, jpeg=b"\xff\xd8jpeg"
    )
    page = client.get(f"{LIST}{session.pk}/change/").content.decode()
    assert "<script>alert(1)" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "0.105" in page
    assert "0.190" in page
    assert f"{LIST}snapshots/{snapshot.pk}.jpg" in page
    assert 'type="text"' not in re.sub(r'<input type="text"[^>]*name="q"', "", page), (
        "nothing can be edited"
    )


def test_pictures_are_for_staff_who_may_look_at_sessions(client, session, assistant):
    snapshot = Snapshot.objects.create(
        session=session, action_id="p1", stamp=2.0, sha256="0" * 64, jpeg=b"\xff\xd8jpeg"
    )
    answer = client.get(f"{LIST}snapshots/{snapshot.pk}.jpg")
    assert (answer.status_code, answer.content, answer["Content-Type"]) == (
        200,
        b"\xff\xd8jpeg",
        "image/jpeg",
    )
    client.force_login(User.objects.create(username="other", is_staff=True))
    assert client.get(f"{LIST}snapshots/{snapshot.pk}.jpg").status_code == 403
    client.force_login(session.visitor)
    assert client.get(f"{LIST}snapshots/{snapshot.pk}.jpg").status_code == 302


@async_to_sync
async def body(answer) -> bytes:
    return b"".join([part async for part in answer.streaming_content])


def test_the_csv_has_a_line_a_state_and_no_formulas(client, assistant, session):
    answer = client.get(f"{LIST}{session.pk}/states.csv")
    lines = list(csv.DictReader(io.StringIO(body(answer).decode())))
    assert [int(line["seq"]) for line in lines] == list(range(8))
    first = lines[0]
    assert (
        first["x"],
        first["y"],
        first["linear"],
        first["method"],
        first["way"],
        first["commands"],
    ) == (
        "1.5",
        "-2.0",
        "0.3",
        "keyboard",
        "mqtt",
        "1",
    )
    assert first["boot"] == "'-boot;'=1+1"
    assert "attachment" in answer["Content-Disposition"]


def test_the_json_has_the_states_as_the_robot_sent_them(client, assistant, session):
    SessionEvent.objects.create(
        session=session, source="server", type="driving", stamp=1.0, received_at=1.0
    )
    document = json.loads(body(client.get(f"{LIST}{session.pk}/states.json")))
    assert document[0]["session"] == str(session.pk)
    assert [one for chunk in document[0]["chunks"] for one in chunk["states"]] == [
        state(seq) for seq in range(8)
    ]
    assert document[0]["events"][0]["type"] == "driving"


def test_several_sessions_download_in_one_file_and_none_is_an_empty_list(
    client, researcher, giraff, session
):
    visitor = User.objects.create(username="ben")
    empty = Session.objects.create(
        robot=giraff, visitor=visitor, state="ended", live_key="e", queued_at=timezone.now()
    )
    answer = client.post(
        LIST, {"action": "download_json", "_selected_action": [str(session.pk), str(empty.pk)]}
    )
    document = json.loads(body(answer))
    assert [len(one["chunks"]) for one in document] == [2, 0]


def test_the_operator_stops_a_live_session(client, researcher, giraff):
    taken = store.take(giraff, User.objects.create(username="ben"), "peer", now=timezone.now())
    page = client.get(f"{LIST}{taken.session}/change/").content.decode()
    assert "Stop this session now" in page
    answer = client.post(f"{LIST}{taken.session}/stop/", follow=True)
    assert "One session was stopped." in answer.content.decode()
    stopped = Session.objects.get(pk=taken.session)
    assert (stopped.state, stopped.outcome, stopped.outcome_reason) == (
        "ended",
        "stopped_by_operator",
        "by an operator",
    )
    assert Lease.objects.get(robot=giraff).session is None
    assert SystemLog.objects.get(event="session_stopped").fields == {"user": str(researcher.pk)}
    noted = AuditEntry.objects.get(act="session_stopped")
    assert (noted.actor, noted.person, noted.robot, noted.thing) == (
        researcher.pk,
        stopped.visitor_id,
        "giraff",
        str(stopped.pk),
    )
    assert (
        "Stop this session now" not in client.get(f"{LIST}{taken.session}/change/").content.decode()
    )


def test_stopping_from_the_list_counts_only_live_ones(client, researcher, giraff, session):
    taken = store.take(giraff, User.objects.create(username="ben"), "peer", now=timezone.now())
    answer = client.post(
        LIST,
        {"action": "stop_sessions", "_selected_action": [taken.session, str(session.pk)]},
        follow=True,
    )
    assert "One session was stopped." in answer.content.decode()


def test_users_who_may_only_view_can_neither_stop_nor_change_nor_delete(client, assistant, giraff):
    taken = store.take(giraff, User.objects.create(username="ben"), "peer", now=timezone.now())
    assert "stop_sessions" not in client.get(LIST).content.decode()
    assert client.post(f"{LIST}{taken.session}/stop/").status_code == 403
    client.post(LIST, {"action": "stop_sessions", "_selected_action": [taken.session]})
    assert (
        client.post(f"{LIST}{taken.session}/change/", {"outcome": "completed"}).status_code == 403
    )
    assert client.post(f"{LIST}{taken.session}/delete/", {"post": "yes"}).status_code == 403
    assert Session.objects.get(pk=taken.session).state == "connecting"


def test_a_get_stops_nobody(client, researcher, giraff):
    taken = store.take(giraff, User.objects.create(username="ben"), "peer", now=timezone.now())
    assert client.get(f"{LIST}{taken.session}/stop/").status_code == 403


def test_a_session_that_is_over_can_be_deleted_with_its_record_and_a_live_one_cannot(
    client, researcher, giraff, session
):
    page = client.get(f"{LIST}{session.pk}/delete/").content.decode()
    assert "2" in page
    assert client.post(f"{LIST}{session.pk}/delete/", {"post": "yes"}).status_code == 302
    assert not StateChunk.objects.exists()
    taken = store.take(giraff, User.objects.create(username="ben"), "peer", now=timezone.now())
    assert client.post(f"{LIST}{taken.session}/delete/", {"post": "yes"}).status_code == 403


def test_the_lease_names_the_driver_and_hides_the_pages_secret(client, researcher, giraff):
    store.take(giraff, User.objects.create(username="ben"), "secret-peer", now=timezone.now())
    listed = client.get("/admin/telepresence_sessions/lease/").content.decode()
    page = client.get(f"/admin/telepresence_sessions/lease/{giraff.pk}/change/").content.decode()
    assert "ben" in listed
    assert "secret-peer" not in listed + page


def test_the_system_log_is_listed_with_its_fields(client, researcher, giraff, session):
    system_log.log(
        "robot_offline", "warning", robot=giraff, session=session, state="CONNECTIONBROKEN"
    )
    page = client.get(
        "/admin/telepresence_sessions/systemlog/", {"level__exact": "warning"}
    ).content.decode()
    assert "robot_offline" in page
    assert "state=CONNECTIONBROKEN" in page
    entry = SystemLog.objects.get()
    assert (
        client.get(f"/admin/telepresence_sessions/systemlog/{entry.pk}/change/").status_code == 200
    )


def test_the_session_managers_beat_tells_whether_it_runs(client, researcher):
    ManagerBeat.objects.create(holder="here:1", beat_at=timezone.now())
    assert "icon-yes" in client.get("/admin/telepresence_sessions/managerbeat/").content.decode()
    ManagerBeat.objects.update(beat_at=timezone.now() - timezone.timedelta(seconds=60))
    assert "icon-no" in client.get("/admin/telepresence_sessions/managerbeat/").content.decode()


def test_the_list_of_session_managers_is_spanish_too(client, researcher):
    ManagerBeat.objects.create(holder="here:1", beat_at=timezone.now())
    address = "/admin/telepresence_sessions/managerbeat/"
    text = client.get(address, headers={"accept-language": "es"}).content.decode()
    for column in ("nombre", "equipo y proceso", "última señal de vida"):
        assert column in text.lower()
    assert "beat at" not in text.lower()


def test_sessions_that_are_over_are_stopped_by_nobody_and_this_is_said(client, researcher, session):
    answer = client.post(
        LIST, {"action": "stop_sessions", "_selected_action": [str(session.pk)]}, follow=True
    )
    assert "None of these sessions was running." in answer.content.decode()
    assert Session.objects.get().outcome == "completed"
    assert not SystemLog.objects.exists()


def test_a_session_that_ends_while_it_is_stopped_is_not_counted(
    client, researcher, giraff, monkeypatch
):
    taken = store.take(giraff, User.objects.create(username="ben"), "peer", now=timezone.now())
    end = store.end

    def too_late(*values):
        end(taken.session, "completed", "left", timezone.now())
        return end(*values)

    monkeypatch.setattr(store, "end", too_late)
    answer = client.post(f"{LIST}{taken.session}/stop/", follow=True)
    assert "None of these sessions was running." in answer.content.decode()
    assert Session.objects.get().outcome == "completed"
    assert not SystemLog.objects.exists()


def test_several_sessions_download_as_one_table_and_this_is_noted(client, researcher, session):
    answer = client.post(LIST, {"action": "download_csv", "_selected_action": [str(session.pk)]})
    assert len(list(csv.DictReader(io.StringIO(body(answer).decode())))) == 8
    assert AuditEntry.objects.get(act="sessions_exported").detail == "csv of 1"


@pytest.fixture
def owner(client, giraff):
    """The owner of one robot."""
    user = User.objects.create(username="owner", is_staff=True)
    Robot.objects.update(owner=user)
    client.force_login(user)
    return user


def test_an_owner_sees_what_their_robot_did_and_not_who_drove_it(client, owner, session):
    page = client.get(f"{LIST}{session.pk}/change/").content.decode()
    assert "12.3" in page
    for hidden in ("Ana", "Firefox", "Device and network", "Photos"):
        assert hidden not in page
    assert client.get(f"{LIST}{session.pk}/states.csv").status_code == 403
    assert not AuditEntry.objects.exists()


def test_a_practice_robot_is_named_without_a_page(client, researcher, giraff, session):
    Robot.objects.update(practice=True)
    page = client.get(f"{LIST}{session.pk}/change/").content.decode()
    assert "Giraff" in page
    assert f"/admin/robots/robot/{giraff.pk}/change/" not in page


def test_a_robot_that_nobody_drives_has_a_lease_of_nobody(client, researcher, giraff):
    Lease.objects.create(robot=giraff, epoch=3, changed_at=timezone.now())
    assert "nobody" in client.get("/admin/telepresence_sessions/lease/").content.decode()


def test_log_entries_outside_of_sessions_are_listed_without_one(client, researcher, giraff):
    system_log.log("robot_offline", "warning", robot=giraff)
    page = client.get("/admin/telepresence_sessions/systemlog/").content.decode()
    assert "robot_offline" in page
    assert "telepresence_sessions/session/" not in page.partition('id="result_list"')[2]
