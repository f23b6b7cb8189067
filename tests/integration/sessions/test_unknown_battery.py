"""A battery that the robot does not know: unknown on the wire, in the record, in exports, in the
API and on pages, never 100 %.
"""

import csv
import datetime
import importlib.util
import io
import json
from pathlib import Path

import msgspec
import pytest
from asgiref.sync import async_to_sync
from django.conf import settings as site
from django.test import AsyncClient, Client
from django.utils import timezone

from accounts.models import User
from experiments.extraction.states import states_of
from experiments.research.replay import recorded
from robots.api import codec, messages
from robots.cards import Traffic, card
from robots.models import Robot, RobotPresence
from sessions.leases.readiness import Readiness, RobotCondition, decide
from sessions.models import Session, StateChunk
from tests.support.robots import create_robot, unsaved_robot

pytestmark = pytest.mark.django_db(transaction=True)
NOW = datetime.datetime(2026, 3, 1, 12, 0, tzinfo=datetime.UTC)
UNKNOWN = messages.Battery(charging=None)


def state(battery: messages.Battery, seq: int = 1) -> messages.State:
    pose, still = messages.Pose(x=1.0, y=2.0, theta=0.1), messages.Velocity(linear=0.0, angular=0.0)
    return messages.State(
        stamp=1000.0 + seq, boot="b", seq=seq, pose=pose, velocity=still, battery=battery
    )


def stored(battery: messages.Battery) -> dict:
    return msgspec.json.decode(codec.encode(state(battery)))


@pytest.fixture
def robot():
    return create_robot(
        name="giraff",
        title="Giraff",
        connection="ONLINE",
        last_seen_at=timezone.now(),
        report=stored(UNKNOWN),
    )


@pytest.fixture
def session(robot):
    now = timezone.now()
    row = Session.objects.create(
        robot=robot,
        visitor=User.objects.create(username="ana"),
        state="ended",
        outcome="completed",
        live_key="k",
        queued_at=now,
        granted_at=now,
    )
    batteries = (UNKNOWN, messages.Battery(charge=0.5, charging=True))
    StateChunk.objects.create(
        session=row,
        boot="b",
        first_seq=1,
        last_seq=2,
        count=2,
        first_stamp=1001.0,
        last_stamp=1002.0,
        received_at=now.timestamp(),
        clock_offset=0.0,
        states=[stored(battery) for battery in batteries],
    )
    return row


# --- the wire -------------------------------------------------------------------------------------


def test_an_unknown_battery_is_absent_on_the_wire_and_reads_as_unknown():
    payload = codec.encode(state(UNKNOWN))
    assert json.loads(payload)["battery"] == {"charging": None}
    assert codec.decode("state", payload).battery == UNKNOWN


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ({"charge": 0.5}, (0.5, None, False)),
        ({"charge": 1.0, "voltage": 27.0, "charging": True}, (1.0, 27.0, True)),
    ],
)
def test_states_of_older_agents_keep_their_meaning(said, meant):
    content = {**json.loads(codec.encode(state(UNKNOWN))), "battery": said}
    battery = codec.decode("state", json.dumps(content).encode()).battery
    assert (battery.charge, battery.voltage, battery.charging) == meant


# --- rules ----------------------------------------------------------------------------------------


def test_a_docked_robot_of_unknown_charge_is_ready_for_waiting_would_not_make_it_known():
    assert (
        decide(Readiness(), RobotCondition(docked=True, charge=None, charge_limit=0.9), 0.0)[
            0
        ].phase
        == "ready"
    )
    assert (
        decide(Readiness(), RobotCondition(docked=True, charge=0.8, charge_limit=0.9), 0.0)[0].phase
        == "charging"
    )


# --- the record -----------------------------------------------------------------------------------


def test_the_record_and_the_dataset_leave_it_empty(session):
    [(_, first), (_, second)] = recorded(session, 1000.0)
    assert (first.battery.charge, second.battery.charge) == (None, 0.5)
    columns = states_of(session, 1000.0)
    charge, charging = columns["charge"], columns["charging"]
    assert [str(value) for value in charge] == ["nan", "0.5"]
    assert [str(value) for value in charging] == ["nan", "1.0"]


def test_the_csv_leaves_it_empty(session):
    client = Client()
    client.force_login(User.objects.create(username="grace", is_staff=True, is_superuser=True))
    answer = client.get(f"/admin/telepresence_sessions/session/{session.pk}/states.csv")

    @async_to_sync
    async def body() -> bytes:
        return b"".join([part async for part in answer.streaming_content])

    lines = list(csv.DictReader(io.StringIO(body().decode())))
    assert [(line["charge"], line["charging"]) for line in lines] == [("", ""), ("0.5", "True")]


# --- what people and programs read ----------------------------------------------------------------


async def test_the_api_says_null_and_the_metrics_say_nothing(robot, settings):
    settings.METRICS_TOKEN = "t" * 40
    shown = (await AsyncClient().get("/api/v1/robots/giraff/")).json()["robot"]
    assert (shown["charge"], shown["charging"], shown["docked"]) == (None, None, False)
    metrics = (
        await AsyncClient().get(
            "/metrics", headers={"authorization": f"Bearer {settings.METRICS_TOKEN}"}
        )
    ).content
    assert b'robot_online{robot="giraff"}' in metrics
    assert b"robot_charge{" not in metrics


def test_a_robot_that_does_not_charge_says_so_in_the_api_though_its_state_left_it_out(robot):
    RobotPresence.objects.update(report=stored(messages.Battery(charge=0.5)))
    shown = Client().get("/api/v1/robots/giraff/").json()["robot"]
    assert (shown["charge"], shown["charging"], shown["docked"]) == (0.5, False, False)


def test_home_assistant_is_told_unknown_and_not_off():
    spec = importlib.util.spec_from_file_location(
        "bridge", Path(site.BASE_DIR) / "deploy/home_assistant/bridge.py"
    )
    bridge = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bridge)
    parts = bridge.discovery(
        {"name": "giraff", "title": "Giraff", "series": "giraff", "page": "http://robots/"}, "base"
    )["components"]
    assert "none" in parts["charge"]["value_template"]
    assert parts["charging"]["value_template"].startswith(
        "{{ none if value_json.charging is none else "
    )


def test_the_list_of_robots_says_that_it_is_unknown():
    robot = unsaved_robot(
        name="giraff", title="Giraff", connection="ONLINE", last_seen_at=NOW, report=stored(UNKNOWN)
    )
    it = card(robot, Traffic(), barred="", url="/", now=NOW)
    assert (it.charge, it.battery) == (None, "Battery unknown")
    robot.presence.report = stored(messages.Battery(charging=True))
    assert (
        card(robot, Traffic(), barred="", url="/", now=NOW).battery == "Battery unknown, charging"
    )


def test_the_page_of_robots_shows_no_meter_for_it(robot):
    page = Client().get("/").content.decode()
    meter = page[page.index("<meter") :]
    assert "hidden" in meter[: meter.index(">")]
    assert "Battery unknown" in page


def test_the_admin_says_that_it_is_unknown(robot):
    client = Client()
    client.force_login(User.objects.create(username="grace", is_staff=True, is_superuser=True))
    page = client.get("/admin/robots/robot/").content.decode()
    assert ">unknown<" in page
