"""A battery of unknown charge: unknown on the wire, in the record, in exports, in the API and on
pages, never 100 %.
"""

import csv
import datetime
import importlib.util
import io
import json
from pathlib import Path

import msgspec
import pytest
from django.conf import settings as site
from django.test import AsyncClient, Client
from django.utils import timezone

from accounts.models import User
from experiments.extraction.states import states_of
from experiments.research.replay import recorded
from robots.api import codec, messages
from robots.cards import Traffic, card
from robots.models import RobotPresence
from sessions.leases.readiness import Readiness, RobotCondition, decide
from tests.support import words
from tests.support.robots import online_robot, unsaved_robot
from tests.support.sessions.rows import chunk_row, session_row
from tests.support.streamed import body_of

pytestmark = pytest.mark.django_db(transaction=True)
NOW = datetime.datetime(2026, 3, 1, 12, 0, tzinfo=datetime.UTC)
UNKNOWN = messages.Battery(charging=None)


def state(battery: messages.Battery, seq: int = 1) -> messages.State:
    return words.state(seq, stamp=1000.0 + seq, boot="b", battery=battery)


def stored(battery: messages.Battery, seq: int = 1) -> dict:
    return msgspec.json.decode(codec.encode(state(battery, seq)))


@pytest.fixture
def robot():
    return online_robot(report=stored(UNKNOWN))


@pytest.fixture
def session(robot):
    now = timezone.now()
    visitor = User.objects.create(username="ana")
    row = session_row(robot, visitor, state="ended", outcome="completed", granted_at=now)
    known = messages.Battery(charge=0.5, charging=True)
    chunk_row(row, [stored(UNKNOWN), stored(known, seq=2)], received_at=now.timestamp())
    return row


# --- the wire -------------------------------------------------------------------------------------


def test_unknown_battery_is_absent_on_the_wire():
    payload = codec.encode(state(UNKNOWN))
    assert json.loads(payload)["battery"] == {"charging": None}
    assert codec.decode("state", payload).battery == UNKNOWN


@pytest.mark.parametrize(
    ("sent", "meant"),
    [
        ({"charge": 0.5}, (0.5, None, False)),
        ({"charge": 1.0, "voltage": 27.0, "charging": True}, (1.0, 27.0, True)),
    ],
)
def test_states_of_older_agents_keep_their_meaning(sent, meant):
    content = {**json.loads(codec.encode(state(UNKNOWN))), "battery": sent}
    battery = codec.decode("state", json.dumps(content).encode()).battery
    assert (battery.charge, battery.voltage, battery.charging) == meant


# --- rules ----------------------------------------------------------------------------------------


def test_docked_robot_of_unknown_charge_is_ready():
    for charge, phase in ((None, "ready"), (0.8, "charging")):
        condition = RobotCondition(docked=True, charge=charge, charge_limit=0.9)
        assert decide(Readiness(), condition, 0.0)[0].phase == phase


# --- the record -----------------------------------------------------------------------------------


def test_unknown_battery_is_empty_in_record_and_dataset(session):
    [(_, first), (_, second)] = recorded(session, 1000.0)
    assert (first.battery.charge, second.battery.charge) == (None, 0.5)
    columns = states_of(session, 1000.0)
    charge, charging = columns["charge"], columns["charging"]
    assert [str(value) for value in charge] == ["nan", "0.5"]
    assert [str(value) for value in charging] == ["nan", "1.0"]


def test_unknown_battery_is_empty_in_the_csv(session):
    client = Client()
    client.force_login(User.objects.create(username="grace", is_staff=True, is_superuser=True))
    answer = client.get(f"/admin/telepresence_sessions/session/{session.pk}/states.csv")
    lines = list(csv.DictReader(io.StringIO(body_of(answer).decode())))
    assert [(line["charge"], line["charging"]) for line in lines] == [("", ""), ("0.5", "True")]


# --- programs and pages --------------------------------------------------------------------------


async def test_unknown_battery_is_null_in_the_api_and_absent_in_metrics(robot, settings):
    settings.METRICS_TOKEN = "t" * 40
    shown = (await AsyncClient().get("/api/v1/robots/giraff/")).json()["robot"]
    assert (shown["charge"], shown["charging"], shown["docked"]) == (None, None, False)
    bearer = {"authorization": f"Bearer {settings.METRICS_TOKEN}"}
    metrics = await AsyncClient().get("/metrics", headers=bearer)
    assert b'robot_online{robot="giraff"}' in metrics.content
    assert b"robot_charge{" not in metrics.content


def test_api_reports_a_robot_that_does_not_charge(robot):
    RobotPresence.objects.update(report=stored(messages.Battery(charge=0.5)))
    shown = Client().get("/api/v1/robots/giraff/").json()["robot"]
    assert (shown["charge"], shown["charging"], shown["docked"]) == (0.5, False, False)


def test_home_assistant_gets_unknown_and_not_off():
    path = Path(site.BASE_DIR) / "deploy/home_assistant/bridge.py"
    spec = importlib.util.spec_from_file_location("bridge", path)
    bridge = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bridge)
    robot = {"name": "giraff", "title": "Giraff", "series": "giraff", "page": "http://robots/"}
    parts = bridge.discovery(robot, "base")["components"]
    assert "none" in parts["charge"]["value_template"]
    template = parts["charging"]["value_template"]
    assert template.startswith("{{ none if value_json.charging is none else ")


def test_card_of_a_robot_shows_an_unknown_battery():
    robot = unsaved_robot(
        name="giraff", title="Giraff", connection="ONLINE", last_seen_at=NOW, report=stored(UNKNOWN)
    )
    shown = lambda: card(robot, Traffic(), barred="", url="/", now=NOW)
    assert (shown().charge, shown().battery) == (None, "Battery unknown")
    robot.presence.report = stored(messages.Battery(charging=True))
    assert shown().battery == "Battery unknown, charging"


def test_list_of_robots_shows_no_meter_for_an_unknown_battery(robot):
    page = Client().get("/").content.decode()
    meter = page[page.index("<meter") :]
    assert "hidden" in meter[: meter.index(">")]
    assert "Battery unknown" in page


def test_administration_shows_an_unknown_battery(robot):
    client = Client()
    client.force_login(User.objects.create(username="grace", is_staff=True, is_superuser=True))
    page = client.get("/admin/robots/robot/").content.decode()
    assert ">unknown<" in page
