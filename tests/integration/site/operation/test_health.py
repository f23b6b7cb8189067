"""/healthz and /readyz name the missing part, without login and without secrets."""

import asyncio
import datetime
import threading
from types import SimpleNamespace

import pytest
from channels.layers import get_channel_layer
from django.db import OperationalError
from django.test import AsyncClient
from django.utils import timezone

from accounts.models import User
from robots.api import disk_space
from robots.bridge import bridge as mqtt_bridge
from sessions.models import ManagerBeat
from sessions.shards.rows import NAME, beat, occupy
from telepresence import __version__
from telepresence_site.ops.health import BEHIND, manager_state, managers_state
from tests.support.loop_gap import longest_gap
from tests.support.patience import patient
from tests.support.sessions.memory_bridge import MemoryBridge

pytestmark = pytest.mark.django_db(transaction=True)
WELL = {"connected": True, "waiting": 3}


@pytest.fixture
def bridge():
    double = MemoryBridge()
    mqtt_bridge.use(double)
    yield double
    mqtt_bridge.use(None)


def broken_database(*_args, **_kwargs):
    raise OperationalError("password authentication failed for hunter2")


async def add_manager():
    beat = {"beat_at": timezone.now(), "report": WELL}
    await ManagerBeat.objects.acreate(name=NAME, holder="here:1", **beat)


async def ask():
    response = await AsyncClient().get("/readyz")
    return response.status_code, response.json()


def test_health_is_only_read(client):
    assert client.post("/healthz").status_code == client.post("/readyz").status_code == 405


async def test_healthz_is_200_without_login(bridge):
    response = await AsyncClient().get("/healthz")
    expected = {"database": True, "broker": True, "disk": "ok"}
    assert (response.status_code, response.json()) == (200, expected)


async def test_healthz_names_an_unavailable_broker_and_database(bridge, monkeypatch):
    bridge.connected = False
    monkeypatch.setattr(User.objects, "exists", broken_database)
    response = await AsyncClient().get("/healthz")
    expected = {"database": False, "broker": False, "disk": "ok"}
    assert (response.status_code, response.json()) == (503, expected)


@pytest.mark.parametrize("address", ["/healthz", "/readyz", "/metrics"])
async def test_disk_that_does_not_answer_delays_no_command(bridge, monkeypatch, settings, address):
    settings.METRICS_TOKEN = "secret"
    asked, answers = threading.Event(), threading.Event()

    def hangs(_folder):
        asked.set()
        answers.wait(patient(20))
        return SimpleNamespace(free=disk_space.MIB)

    monkeypatch.setattr(disk_space.shutil, "disk_usage", hangs)
    async with longest_gap() as gap:
        headers = {"Authorization": "Bearer secret"}
        answer = asyncio.create_task(AsyncClient().get(address, headers=headers))
        try:
            response = await asyncio.wait_for(answer, patient(10))
        finally:
            answers.set()
    assert asked.is_set()
    assert gap() < patient(0.5)
    if address == "/metrics":
        assert b"telepresence_disk_free_bytes" not in response.content
        assert b"telepresence_disk_silent 1.0" in response.content
        assert b"telepresence_broker_connected" in response.content
    else:
        assert response.json()["disk"] == "silent"


async def test_server_with_all_its_parts_is_ready(bridge):
    await add_manager()
    ok = dict.fromkeys(("database", "broker", "channel_layer", "session_manager", "disk"), "ok")
    assert await ask() == (200, {"ready": True, "version": __version__, **ok})


async def test_server_without_session_manager_and_broker_is_not_ready_and_names_them(bridge):
    bridge.connected = False
    status, answer = await ask()
    ok = dict.fromkeys(("database", "channel_layer", "disk"), "ok")
    assert status == 503
    assert answer.pop("version") == __version__
    assert answer == {"ready": False, "broker": "away", "session_manager": "none", **ok}


async def test_missing_database_is_reported_without_an_error(bridge, monkeypatch):
    monkeypatch.setattr(ManagerBeat.objects, "filter", broken_database)
    status, answer = await ask()
    assert (status, answer["database"], answer["session_manager"]) == (503, "away", "unknown")
    assert "hunter2" not in str(answer)


@pytest.mark.parametrize(("free", "status", "word"), [(499, 200, "low"), (1, 503, "full")])
async def test_nearly_full_disk_is_named_and_only_a_full_one_makes_the_site_unready(
    bridge, monkeypatch, free, status, word
):
    await add_manager()
    usage = SimpleNamespace(free=free * disk_space.MIB)
    monkeypatch.setattr(disk_space.shutil, "disk_usage", lambda _: usage)
    code, answer = await ask()
    assert (code, answer["ready"], answer["disk"]) == (status, status == 200, word)
    response = await AsyncClient().get("/healthz")
    assert (response.status_code, response.json()["disk"]) == (200, word)


@pytest.mark.parametrize("error", [OSError("gone"), TimeoutError()])
async def test_unavailable_channel_layer_is_named_and_the_site_stays_ready(
    bridge, monkeypatch, error
):
    async def broken(*_):
        raise error

    await add_manager()
    monkeypatch.setattr(type(get_channel_layer()), "group_send", broken)
    status, answer = await ask()
    assert (status, answer["ready"], answer["channel_layer"]) == (200, True, "slow")


@pytest.mark.parametrize(
    ("holder", "age", "report", "state"),
    [
        ("here:1", 1, WELL, "ok"),
        ("", 1, WELL, "none"),
        ("here:1", 60, WELL, "silent"),
        ("here:1", 1, {"connected": False}, "without_broker"),
        ("here:1", 1, {}, "without_broker"),
        ("here:1", 1, {"connected": True, "waiting": BEHIND + 1}, "behind"),
    ],
)
def test_state_of_the_session_manager_follows_from_its_beat(holder, age, report, state):
    now = timezone.now()
    beat_at = now - datetime.timedelta(seconds=age)
    row = ManagerBeat(holder=holder, beat_at=beat_at, report=report)
    assert manager_state(row, now) == state


def test_beat_carries_its_report():
    now = timezone.now()
    assert occupy(0, None, "here:1", now)
    assert beat(0, "here:1", 2, now, WELL)
    assert ManagerBeat.objects.get().report == WELL
    assert not beat(0, "there:2", 2, now, {})
    assert ManagerBeat.objects.get().report == WELL


@pytest.mark.parametrize(
    ("of_others", "state"),
    [
        ([("", 60, WELL)], "ok"),
        ([("there:2", 60, WELL)], "ok"),
        ([("there:2", 1, {"connected": False})], "without_broker"),
        ([("there:2", 1, {"connected": True, "waiting": BEHIND + 1})], "behind"),
    ],
)
def test_worst_of_the_session_managers_that_beat_counts(of_others, state):
    now = timezone.now()
    rows = [
        ManagerBeat(holder=holder, beat_at=now - datetime.timedelta(seconds=age), report=report)
        for holder, age, report in [("here:1", 1, WELL), *of_others]
    ]
    assert managers_state(rows, now) == state
    assert managers_state([], now) == "none"
