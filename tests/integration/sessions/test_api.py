"""The JSON API: what everybody may read, what a key adds, and that no key drives."""

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
from robots.models import FloorPlan, Robot, RobotPresence
from sessions.api.keys import key_of
from sessions.api.views import READ
from sessions.models import ApiKey, Lease, Session, SystemLog
from tests.support.loop_gap import longest_gap
from tests.support.patience import patient
from tests.support.people import person
from tests.support.robots import create_robot, update_robots
from tests.support.sessions.query_plans import session_reads

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
    plan = FloorPlan.objects.create(
        name="office",
        title="Office",
        resolution=0.05,
        origin_x=0,
        origin_y=0,
        width=1,
        height=1,
        image=b"",
        plan=PLACES,
    )
    return create_robot(
        name="giraff",
        title="Giraff",
        floor_plan=plan,
        connection="ONLINE",
        last_seen_at=timezone.now(),
        report=REPORT,
        factsheet={"series": "Giraff", "capabilities": ["velocity", "dock"]},
    )


def command(*arguments):
    out = io.StringIO()
    call_command("api_key", *arguments, stdout=out)
    return out.getvalue().strip()


@pytest.fixture
def bearer(giraff):
    return {"authorization": f"Bearer {command('giraff', 'home')}"}


def at(giraff, state):
    user, now = person(f"visitor-{state}"), timezone.now()
    return Session.objects.create(
        robot=giraff, visitor=user, state=state, live_key=str(user.pk), queued_at=now, seen_at=now
    )


async def act(kind, headers, robot="giraff", **more):
    answer = await AsyncClient().post(
        f"/api/v1/robots/{robot}/actions/",
        {"type": kind, **more},
        content_type="application/json",
        headers=headers,
    )
    return answer.status_code, answer.json()


def test_everybody_reads_what_the_site_shows(giraff):
    at(giraff, "driving"), at(giraff, "waiting")
    Robot.objects.create(name="practice-1", title="Practice", practice=True)
    answer = Client().get("/api/v1/robots/").json()
    (told,) = answer["robots"]
    assert answer["apiVersion"] == 1
    assert (
        told["name"],
        told["state"],
        told["driven"],
        told["waiting"],
        told["charge"],
        told["docked"],
    ) == ("giraff", "busy", True, 1, 0.5, True)
    assert told["places"] == [{"name": "kitchen", "x": 1.0, "y": 2.0}]
    assert told["page"] == "http://testserver/robots/giraff/"
    assert "pose" not in told
    assert Client().get("/api/v1/robots/giraff/").json()["robot"] == told


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
def test_a_robots_state_is_one_word(giraff, change, state):
    update_robots(**change)
    assert Client().get("/api/v1/robots/giraff/").json()["robot"]["state"] == state


def test_last_report_of_an_offline_robot_is_left_out(giraff, bearer):
    RobotPresence.objects.update(connection="OFFLINE")
    told = Client().get("/api/v1/robots/giraff/", headers=bearer).json()["robot"]
    assert (told["charge"], told["docked"], told["pose"]) == (None, None, None)


def test_a_key_tells_more_of_its_own_robot_alone(giraff, bearer):
    create_robot(
        name="rhodon",
        title="Rhodon",
        connection="ONLINE",
        last_seen_at=timezone.now(),
        report=REPORT,
    )
    told = {
        robot["name"]: robot
        for robot in Client().get("/api/v1/robots/", headers=bearer).json()["robots"]
    }
    assert told["giraff"]["pose"] == REPORT["pose"]
    assert "pose" not in told["rhodon"]


def test_there_is_nothing_to_find_of_a_robot_that_does_not_exist(giraff):
    answer = Client().get("/api/v1/robots/nobody/")
    assert (answer.status_code, answer.json()["error"]) == (404, "no_such_robot")


@pytest.mark.parametrize(
    "header",
    ["Bearer x", "Bearer " + "0" * 32 + ".token", "Basic dTpw", "Bearer " + "x" * 500, "nonsense"],
)
def test_a_wrong_key_opens_nothing_not_even_what_is_open(giraff, header, monkeypatch):
    monkeypatch.setattr("sessions.api.views.time.time", lambda: 1e9)  # all within one minute
    for _ in range(20):
        assert Client().get("/api/v1/robots/", headers={"authorization": header}).status_code == 401
    refused = Client().get("/api/v1/robots/", headers={"authorization": header})
    assert (refused.status_code, refused.json()["error"]) == (429, "too_many_attempts")
    assert 60 <= int(refused["Retry-After"]) <= 66


def test_a_revoked_key_and_that_of_a_disabled_robot_are_worthless(giraff, bearer):
    Robot.objects.update(enabled=False)
    assert key_of(bearer["authorization"]) is None
    Robot.objects.update(enabled=True)
    assert key_of(bearer["authorization"]) is not None
    assert command("giraff", "home", "--revoke") == "Revoked."
    assert key_of(bearer["authorization"]) is None


def test_a_key_is_shown_once_and_kept_as_a_hash(giraff, bearer):
    token = bearer["authorization"].partition(".")[2]
    assert token not in ApiKey.objects.get().token_hash
    assert command("giraff", "--list").startswith("home ")
    for arguments in (
        ("giraff", "home"),
        ("giraff",),
        ("nobody", "home"),
        ("giraff", "x" * 61),
        ("giraff", "none", "--revoke"),
    ):
        with pytest.raises(CommandError):
            command(*arguments)


@pytest.mark.parametrize(("kind", "message"), [("stop", Stop), ("estop", EStop)])
async def test_a_key_stops_its_robot_whoever_drives(bridge, giraff, bearer, kind, message):
    await sync_to_async(at)(giraff, "driving")
    status, answer = await act(kind, bearer)
    ((robot, sent),) = bridge.stops
    assert (status, robot, type(sent)) == (202, "giraff", message)
    assert (sent.action_id, sent.role, sent.user) == (answer["actionId"], "owner", "home")
    assert (await SystemLog.objects.aget()).fields == {"type": kind, "key": "home", "answer": 202}


async def test_a_stop_that_cannot_be_sent_says_so(bridge, giraff, bearer):
    bridge.connected = False
    assert (await act("stop", bearer))[0] == 503


async def test_a_free_robot_is_sent_home(bridge, giraff, bearer):
    assert (await act("dock", bearer))[0] == 202
    assert (await Robot.objects.aget()).presence.turnaround == "returning"
    assert (await act("dock", bearer))[0] == 202, "it is on its way"


@pytest.mark.parametrize("state", ["waiting", "connecting", "driving", "reconnecting"])
async def test_a_robot_that_is_somebodys_is_not_taken_away(bridge, giraff, bearer, state):
    session = await sync_to_async(at)(giraff, state)
    await Lease.objects.acreate(robot=giraff, session=session, changed_at=timezone.now())
    status, answer = await act("dock", bearer)
    assert (status, answer["error"], (await Robot.objects.aget()).presence.turnaround) == (
        409,
        "driven",
        "ready",
    )


async def test_a_robot_that_does_not_dock_is_not_sent_home(bridge, giraff, bearer):
    await Robot.objects.aupdate(returns_home=False)
    status, answer = await act("dock", bearer)
    assert (status, answer["error"]) == (409, "cannot_go_home")


async def test_only_the_robots_own_key_acts(bridge, giraff, bearer):
    await Robot.objects.acreate(name="rhodon", title="Rhodon")
    assert (await act("stop", bearer, robot="rhodon"))[0] == 403
    assert (await act("stop", {}))[0] == 403
    assert (await act("stop", {"authorization": "Bearer x"}))[0] == 401
    assert bridge.stops == []


@pytest.mark.parametrize("kind", ["goto", "velocity", "clear_estop", "", None, ["stop"]])
async def test_no_key_drives_or_lifts_a_stop(bridge, giraff, bearer, kind):
    status, answer = await act(kind, bearer)
    assert (status, answer["error"], bridge.stops, bridge.sent) == (400, "unknown_action", [], [])


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"\xff", b'{"type": "stop"}' + b" " * 2000])
async def test_a_body_that_is_none_is_refused(bridge, giraff, bearer, body):
    answer = await AsyncClient().generic(
        "POST", "/api/v1/robots/giraff/actions/", body, "application/json", headers=bearer
    )
    assert (answer.status_code, bridge.stops) == (400, [])


async def test_a_robot_that_was_stopped_is_free_and_not_sent_home(bridge, giraff, bearer):
    await RobotPresence.objects.aupdate(turnaround="paused", turnaround_reason="stopped")
    told = await AsyncClient().get("/api/v1/robots/giraff/", headers=bearer)
    robot = told.json()["robot"]
    assert (robot["state"], robot["turnaround"], robot["reason"]) == (
        "available",
        "paused",
        "stopped",
    )
    status, answer = await act("dock", bearer)
    assert (status, answer["error"]) == (409, "stopped")
    presence = await RobotPresence.objects.aget()
    assert (presence.turnaround, presence.turnaround_reason) == ("paused", "stopped")


async def test_a_key_acts_thirty_times_a_minute(bridge, giraff, bearer, monkeypatch):
    monkeypatch.setattr("sessions.api.views.time.time", lambda: 1e9)
    assert [(await act("stop", bearer))[0] for _ in range(31)] == [202] * 30 + [429]


def test_every_field_and_error_stands_in_the_reference(giraff, bearer):
    reference = (Path(site.BASE_DIR) / "docs/reference/json-api.md").read_text()
    explained = set(re.findall(r"`([A-Za-z_]+)`", reference))
    assert set(Client().get("/api/v1/robots/giraff/", headers=bearer).json()["robot"]) <= explained
    source = (Path(site.BASE_DIR) / "sessions/api/views.py").read_text()
    assert set(re.findall(r'_problem\(\d+, "(\w+)"', source)) <= explained


@pytest.mark.parametrize("address", ["/api/v1/robots/", "/api/v1/robots/giraff/"])
def test_reading_robots_costs_the_same_after_many_sessions(giraff, address):
    at(giraff, "driving")
    with CaptureQueriesContext(connection) as asked:
        assert Client().get(address).status_code == 200
    reads = session_reads(asked)
    assert reads
    assert all("state=?" in line for line in reads), reads
    assert len(asked) <= 3


def test_reading_the_robots_is_rate_limited(giraff):
    reader = Client()
    codes = [reader.get("/api/v1/robots/").status_code for _ in range(READ.limit)]
    assert codes == [200] * READ.limit
    refused = reader.get("/api/v1/robots/giraff/")
    assert refused.status_code == 429
    assert int(refused["Retry-After"]) > 0
    assert refused.json()["error"] == "too_many_attempts"


async def test_a_cache_that_does_not_answer_holds_no_command(giraff, bridge, bearer, monkeypatch):
    """A Redis that hangs, as Django's cache meets it."""
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
