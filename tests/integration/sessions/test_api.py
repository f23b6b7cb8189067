"""The JSON API: what is public, what a key adds, and that no key can drive."""

import asyncio
import io
import re
import threading
from pathlib import Path

import pytest
from asgiref.sync import sync_to_async
from django.conf import settings as site
from django.core.management import CommandError, call_command
from django.db import connection
from django.test import AsyncClient, Client
from django.test.utils import CaptureQueriesContext
from django.utils import timezone

from accounts.attempts import Attempts
from robots.api.messages import EStop, Stop
from robots.models import Robot, RobotPresence
from sessions.api.keys import key_of
from sessions.api.views import READ
from sessions.models import ApiKey, Lease, SystemLog
from tests.support.loop_gap import longest_gap
from tests.support.patience import patient
from tests.support.people import person
from tests.support.robots import floor_plan, online_robot, update_robots
from tests.support.sessions.query_plans import session_reads
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db(transaction=True)
PLACES = {"places": [{"name": "kitchen", "x": 1.0, "y": 2.0, "theta": 0.0}]}
REPORT = {
    "battery": {"charge": 0.5, "charging": True},
    "docked": True,
    "pose": {"x": 1.0, "y": 2.0, "theta": 0.1},
    "mode": "manual",
    "safety": {"estop": False},
    "velocity": {"linear": 0.0, "angular": 0.0},
    "errors": [],
}


@pytest.fixture
def giraff():
    plan = floor_plan("office", plan=PLACES)
    factsheet = {"series": "Giraff", "capabilities": ["velocity", "dock"]}
    return online_robot(floor_plan=plan, report=REPORT, factsheet=factsheet)


def command(*arguments):
    out = io.StringIO()
    call_command("api_key", *arguments, stdout=out)
    return out.getvalue().strip()


@pytest.fixture
def bearer(giraff):
    return {"authorization": f"Bearer {command('giraff', 'home')}"}


def at(giraff, state):
    return session_row(giraff, person(f"visitor-{state}"), state=state, seen_at=timezone.now())


def read(robot="giraff", **options):
    return Client().get(f"/api/v1/robots/{robot}/", **options).json()["robot"]


async def act(kind, headers, robot="giraff", **more):
    answer = await AsyncClient().post(
        f"/api/v1/robots/{robot}/actions/",
        {"type": kind, **more},
        content_type="application/json",
        headers=headers,
    )
    return answer.status_code, answer.json()


def test_public_data_is_that_of_the_site(giraff):
    at(giraff, "driving"), at(giraff, "waiting")
    Robot.objects.create(name="practice-1", title="Practice", practice=True)
    answer = Client().get("/api/v1/robots/").json()
    (robot,) = answer["robots"]
    assert answer["apiVersion"] == 1
    traffic = {"name": "giraff", "state": "busy", "driven": True, "waiting": 1}
    assert robot.items() >= (traffic | {"charge": 0.5, "docked": True}).items()
    assert robot["places"] == [{"name": "kitchen", "x": 1.0, "y": 2.0}]
    assert robot["page"] == "http://testserver/robots/giraff/"
    assert "pose" not in robot
    assert read() == robot


def test_list_of_robots_names_no_visitor(giraff):
    session = at(giraff, "driving")
    text = Client().get("/api/v1/robots/").content.decode()
    assert session.visitor.username not in text
    assert str(session.pk) not in text


@pytest.mark.parametrize(
    ("change", "state"),
    [
        ({}, "available"),
        ({"connection": "OFFLINE"}, "offline"),
        ({"report": {"safety": {"estop": True}}}, "stopped"),
        ({"turnaround": "returning"}, "busy"),
        ({"report": {"errors": ["adapter_lost: no ROS master"]}}, "stopped"),
    ],
)
def test_state_of_a_robot_is_one_word(giraff, change, state):
    update_robots(**change)
    assert read()["state"] == state


def test_last_report_of_an_offline_robot_is_left_out(giraff, bearer):
    RobotPresence.objects.update(connection="OFFLINE")
    robot = read(headers=bearer)
    assert (robot["charge"], robot["docked"], robot["pose"]) == (None, None, None)


def test_key_adds_the_pose_of_its_robot_only(giraff, bearer):
    online_robot("rhodon", report=REPORT)
    listed = Client().get("/api/v1/robots/", headers=bearer).json()["robots"]
    robots = {robot["name"]: robot for robot in listed}
    assert robots["giraff"]["pose"] == REPORT["pose"]
    assert "pose" not in robots["rhodon"]


def test_unknown_robot_is_not_found(giraff):
    answer = Client().get("/api/v1/robots/unknown/")
    assert (answer.status_code, answer.json()["error"]) == (404, "no_such_robot")


@pytest.mark.parametrize(
    "header",
    ["Bearer x", "Bearer " + "0" * 32 + ".token", "Basic dTpw", "Bearer " + "x" * 500, "nonsense"],
)
def test_wrong_key_is_refused_even_for_public_data(giraff, header, monkeypatch):
    monkeypatch.setattr("sessions.api.views.time.time", lambda: 1e9)  # all within one minute
    for _ in range(20):
        assert Client().get("/api/v1/robots/", headers={"authorization": header}).status_code == 401
    refused = Client().get("/api/v1/robots/", headers={"authorization": header})
    assert (refused.status_code, refused.json()["error"]) == (429, "too_many_attempts")
    assert 60 <= int(refused["Retry-After"]) <= 66


def test_revoked_key_and_key_of_a_disabled_robot_are_refused(giraff, bearer):
    Robot.objects.update(enabled=False)
    assert key_of(bearer["authorization"]) is None
    Robot.objects.update(enabled=True)
    assert key_of(bearer["authorization"]) is not None
    assert command("giraff", "home", "--revoke") == "Revoked."
    assert key_of(bearer["authorization"]) is None


def test_key_is_shown_once_and_stored_as_a_hash(giraff, bearer):
    token = bearer["authorization"].partition(".")[2]
    assert token not in ApiKey.objects.get().token_hash
    assert command("giraff", "--list").startswith("home ")
    for arguments in (
        ("giraff", "home"),
        ("giraff",),
        ("unknown", "home"),
        ("giraff", "x" * 61),
        ("giraff", "none", "--revoke"),
    ):
        with pytest.raises(CommandError):
            command(*arguments)


@pytest.mark.parametrize(("kind", "message"), [("stop", Stop), ("estop", EStop)])
async def test_key_stops_its_robot_during_a_session(bridge, giraff, bearer, kind, message):
    await sync_to_async(at)(giraff, "driving")
    status, answer = await act(kind, bearer)
    ((robot, sent),) = bridge.stops
    assert (status, robot, type(sent)) == (202, "giraff", message)
    assert (sent.action_id, sent.role, sent.user) == (answer["actionId"], "owner", "home")
    assert (await SystemLog.objects.aget()).fields == {"type": kind, "key": "home", "answer": 202}


async def test_stop_that_cannot_be_sent_is_an_error(bridge, giraff, bearer):
    bridge.connected = False
    assert (await act("stop", bearer))[0] == 503


async def test_free_robot_is_sent_to_its_dock(bridge, giraff, bearer):
    assert (await act("dock", bearer))[0] == 202
    assert (await Robot.objects.aget()).presence.turnaround == "returning"
    assert (await act("dock", bearer))[0] == 202, "while it is returning"


@pytest.mark.parametrize("state", ["waiting", "connecting", "driving", "reconnecting"])
async def test_robot_of_a_session_is_not_sent_to_its_dock(bridge, giraff, bearer, state):
    session = await sync_to_async(at)(giraff, state)
    await Lease.objects.acreate(robot=giraff, session=session, changed_at=timezone.now())
    status, answer = await act("dock", bearer)
    assert (status, answer["error"]) == (409, "driven")
    assert (await Robot.objects.aget()).presence.turnaround == "ready"


async def test_robot_that_does_not_return_is_not_sent_to_its_dock(bridge, giraff, bearer):
    await Robot.objects.aupdate(returns_home=False)
    status, answer = await act("dock", bearer)
    assert (status, answer["error"]) == (409, "cannot_go_home")


async def test_only_the_robots_key_acts_on_it(bridge, giraff, bearer):
    await Robot.objects.acreate(name="rhodon", title="Rhodon")
    assert (await act("stop", bearer, robot="rhodon"))[0] == 403
    assert (await act("stop", {}))[0] == 403
    assert (await act("stop", {"authorization": "Bearer x"}))[0] == 401
    assert bridge.stops == []


@pytest.mark.parametrize("kind", ["goto", "velocity", "clear_estop", "", None, ["stop"]])
async def test_key_cannot_drive_or_clear_a_stop(bridge, giraff, bearer, kind):
    status, answer = await act(kind, bearer)
    assert (status, answer["error"], bridge.stops, bridge.sent) == (400, "unknown_action", [], [])


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"\xff", b'{"type": "stop"}' + b" " * 2000])
async def test_malformed_body_is_refused(bridge, giraff, bearer, body):
    answer = await AsyncClient().generic(
        "POST", "/api/v1/robots/giraff/actions/", body, "application/json", headers=bearer
    )
    assert (answer.status_code, bridge.stops) == (400, [])


async def test_stopped_robot_is_available_and_not_sent_to_its_dock(bridge, giraff, bearer):
    await RobotPresence.objects.aupdate(turnaround="paused", turnaround_reason="stopped")
    robot = await sync_to_async(read)(headers=bearer)
    assert (robot["state"], robot["turnaround"]) == ("available", "paused")
    assert robot["reason"] == "stopped"
    status, answer = await act("dock", bearer)
    assert (status, answer["error"]) == (409, "stopped")
    presence = await RobotPresence.objects.aget()
    assert (presence.turnaround, presence.turnaround_reason) == ("paused", "stopped")


async def test_key_acts_at_most_thirty_times_a_minute(bridge, giraff, bearer, monkeypatch):
    monkeypatch.setattr("sessions.api.views.time.time", lambda: 1e9)
    assert [(await act("stop", bearer))[0] for _ in range(31)] == [202] * 30 + [429]


def test_reference_explains_every_field_and_error(giraff, bearer):
    reference = (Path(site.BASE_DIR) / "docs/reference/json-api.md").read_text()
    explained = set(re.findall(r"`([A-Za-z_]+)`", reference))
    assert set(read(headers=bearer)) <= explained
    source = (Path(site.BASE_DIR) / "sessions/api/views.py").read_text()
    assert set(re.findall(r'_problem\(\d+, "(\w+)"', source)) <= explained


@pytest.mark.parametrize("address", ["/api/v1/robots/", "/api/v1/robots/giraff/"])
def test_reading_robots_reads_only_live_sessions(giraff, address):
    at(giraff, "driving")
    with CaptureQueriesContext(connection) as asked:
        assert Client().get(address).status_code == 200
    reads = session_reads(asked)
    assert reads
    assert all("state=?" in line for line in reads), reads
    assert len(asked) <= 3


def test_reading_robots_is_rate_limited(giraff):
    reader = Client()
    codes = [reader.get("/api/v1/robots/").status_code for _ in range(READ.limit)]
    assert codes == [200] * READ.limit
    refused = reader.get("/api/v1/robots/giraff/")
    assert refused.status_code == 429
    assert int(refused["Retry-After"]) > 0
    assert refused.json()["error"] == "too_many_attempts"


async def test_hung_cache_does_not_block_the_event_loop(giraff, bridge, bearer, monkeypatch):
    """As with Redis when it hangs."""
    right, called, answers = Attempts.count, threading.Event(), threading.Event()

    def hangs(*arguments):
        called.set()
        answers.wait(patient(20))
        return right(*arguments)

    monkeypatch.setattr(Attempts, "count", hangs)
    async with longest_gap() as gap:
        acting = asyncio.create_task(act("stop", bearer))
        assert await asyncio.to_thread(called.wait, patient(10))
        await asyncio.sleep(0.1)
        assert not acting.done()
        answers.set()
        assert (await asyncio.wait_for(acting, patient(10)))[0] == 202
    assert gap() < patient(0.5)
