"""/metrics: who may read it, its figures, and that it names no person."""

import pytest
from django.db import connection
from django.test import AsyncClient, Client
from django.test.utils import CaptureQueriesContext
from django.utils import timezone
from prometheus_client.parser import text_string_to_metric_families

from robots.bridge import bridge as mqtt_bridge
from robots.models import Robot
from sessions.models import Lease, ManagerBeat
from sessions.shards.rows import NAME, name_of
from tests.support.people import person
from tests.support.robots import online_robot
from tests.support.sessions.memory_bridge import MemoryBridge
from tests.support.sessions.query_plans import session_reads
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db(transaction=True)
TOKEN = "t" * 32
BEARER = {"authorization": f"Bearer {TOKEN}"}


@pytest.fixture(autouse=True)
def bridge():
    double = MemoryBridge()
    mqtt_bridge.use(double)
    yield double
    mqtt_bridge.use(None)


@pytest.fixture
def site(settings):
    settings.METRICS_TOKEN = TOKEN
    now = timezone.now()
    giraff = online_robot(report={"battery": {"charge": 0.5}})
    Robot.objects.create(name="attic", title="Attic")
    Robot.objects.create(name="practice-1", title="Practice", practice=True)
    ada, bert, cleo = person("ada"), person("bert"), person("cleo")
    rows = [(ada, "driving", ""), (bert, "waiting", ""), (cleo, "ended", "completed")]
    made = [
        session_row(giraff, user, state=state, outcome=outcome) for user, state, outcome in rows
    ]
    Lease.objects.create(robot=giraff, session=made[0], changed_at=now)
    report = {
        "connected": True,
        "waiting": 7,
        "counts": {"states": 40},
        "refused": {"stale": 2},
        "rejected": {"malformed": 1},
    }
    for name, holder, shards in ((NAME, "here:1", 40), (name_of(1), "there:2", 24)):
        beat = {"beat_at": now, "report": {"shards": shards, **report}}
        ManagerBeat.objects.create(name=name, holder=holder, **beat)
    return made


def samples(text):
    return {
        (s.name, *sorted(s.labels.items())): s.value
        for family in text_string_to_metric_families(text)
        for s in family.samples
    }


async def test_metrics_contain_figures_of_site_and_process(site, bridge):
    bridge.counts["arrived"] = 5
    response = await AsyncClient().get("/metrics", headers=BEARER)
    assert response["Content-Type"].startswith("text/plain; version=")
    found = samples(response.content.decode())
    for name, label, value in [
        ("sessions_ended", ("outcome", "completed"), 1),
        ("sessions_ended", ("outcome", "timed_out"), 0),
        ("sessions_live", ("state", "driving"), 1),
        ("sessions_live", ("state", "waiting"), 1),
        ("robot_online", ("robot", "giraff"), 1),
        ("robot_online", ("robot", "attic"), 0),
        ("robot_leased", ("robot", "giraff"), 1),
        ("robot_queue_length", ("robot", "giraff"), 1),
        ("robot_queue_length", ("robot", "attic"), 0),
        ("robot_charge", ("robot", "giraff"), 0.5),
        ("recorded_total", ("what", "states"), 80),
        ("robot_refused_commands_total", ("reason", "stale"), 4),
        ("rejected_messages_total", ("reason", "malformed"), 2),
        ("session_manager_shards", ("manager", "session_manager"), 40),
        ("session_manager_shards", ("manager", "session_manager-1"), 24),
        ("bridge_total", ("what", "arrived"), 5),
    ]:
        assert found["telepresence_" + name, label] == value
    assert not any(("robot", "practice-1") in name for name in found)
    assert found[("telepresence_recorder_waiting",)] == 14
    assert found[("telepresence_session_manager_well",)] == 1
    assert found[("telepresence_broker_connected",)] == 1
    assert ("telepresence_relay_to_page_seconds_count",) in found
    assert ("telepresence_relay_to_robot_seconds_count",) in found


def test_no_label_names_a_person_or_a_session(site):
    text = Client().get("/metrics", headers=BEARER).content.decode()
    for session in site:
        for secret in (str(session.pk), str(session.visitor_id), session.visitor.username):
            assert secret not in text


@pytest.mark.parametrize("given", ["", "Bearer wrong", "Basic dTpw", "Bearer "])
def test_metrics_are_not_found_without_the_token(site, given):
    headers = {"authorization": given} if given else {}
    assert Client().get("/metrics", headers=headers).status_code == 404


def test_metrics_are_not_found_without_a_setting(settings):
    settings.METRICS_TOKEN, settings.METRICS_ALLOWED = "", []
    assert Client().get("/metrics", headers={"authorization": "Bearer "}).status_code == 404


@pytest.mark.parametrize(
    ("address", "headers", "status"),
    [
        ("10.1.2.3", {}, 200),
        ("10.2.0.1", {}, 404),
        ("10.1.2.3", {"x-forwarded-for": "10.1.2.3"}, 404),  # all visitors share a proxy's address
        ("10.1.2.3", {"forwarded": "for=10.1.2.3"}, 404),
        ("", {}, 404),
    ],
)
def test_allowed_address_counts_only_for_a_direct_connection(settings, address, headers, status):
    settings.METRICS_TOKEN, settings.METRICS_ALLOWED = "", ["10.1.0.0/16"]
    assert Client(REMOTE_ADDR=address).get("/metrics", headers=headers).status_code == status


def test_figures_of_robots_need_as_many_queries_after_many_sessions(site):
    with CaptureQueriesContext(connection) as asked:
        assert Client().get("/metrics", headers=BEARER).status_code == 200
    reads = session_reads(asked, "robot_id")
    assert reads
    assert all("state=?" in line or ("SEARCH" in line and "id=?" in line) for line in reads), reads
    assert not any("factsheet" in query["sql"] for query in asked)
