"""The agent's configuration, and floor plans for pages."""

import re

import pytest
from django.contrib.auth import get_user_model
from django.utils import timezone

from accounts.attempts import Attempts, address_of
from robots import views
from robots.enrol.credentials import make_credentials, revoke
from robots.models import FloorPlan, Robot
from robots.plans.floorplans import store_floor_plan
from robots.world.sites import SHIPPED

pytestmark = pytest.mark.django_db


@pytest.fixture
def key():
    return make_credentials(Robot.objects.create(name="giraff", title="Giraff"), timezone.now())


def ask(client, robot, token, **extra):
    return client.get(
        "/api/v1/agent/", headers={"Authorization": f"Bearer {robot}:{token}"}, **extra
    )


def test_agent_gets_its_name_its_broker_and_ice_servers(client, key, settings):
    settings.MQTT_PUBLIC_URL = "mqtts://{host}:8883, wss://{host}/mqtt"
    settings.STUN_URLS = ["stun:example.org"]
    settings.ALLOWED_HOSTS = ["robots.example.org"]
    response = ask(client, "giraff", key.token, HTTP_HOST="robots.example.org:8000")
    assert response.status_code == 200
    assert response.json() == {
        "robot": "giraff",
        "mqttUrl": "mqtts://robots.example.org:8883",
        "mqttUrls": ["mqtts://robots.example.org:8883", "wss://robots.example.org/mqtt"],
        "iceServers": [{"urls": ["stun:example.org"]}],
    }
    assert "no-store" in response["Cache-Control"]
    assert not response.cookies


def test_agent_gets_the_servers_broker_without_a_public_address(client, key, settings):
    settings.MQTT_PUBLIC_URL, settings.MQTT_URL = "", "mqtt://127.0.0.1:1883"
    assert ask(client, "giraff", key.token).json()["mqttUrl"] == "mqtt://127.0.0.1:1883"


@pytest.mark.parametrize(
    "header",
    [
        *("", "Bearer", "Bearer ", "Bearer giraff", "Bearer giraff:", "Bearer :x"),
        *("Bearer giraff:wrong", "Basic giraff:x", "Bearer giraff:" + "x" * 5000),
    ],
)
def test_wrong_credentials_are_refused_with_the_reason(client, key, header):
    response = client.get("/api/v1/agent/", headers={"Authorization": header})
    assert response.status_code == 401
    assert response.json()["error"] == "wrong_credentials"


def test_revoked_or_disabled_robot_and_another_robots_token_are_refused(client, key):
    robot = Robot.objects.get()
    other = make_credentials(Robot.objects.create(name="rhodon", title="Rhodon"), timezone.now())
    assert ask(client, "giraff", other.token).status_code == 401
    Robot.objects.filter(name="giraff").update(enabled=False)
    assert ask(client, "giraff", key.token).status_code == 401
    Robot.objects.filter(name="giraff").update(enabled=True)
    assert ask(client, "giraff", key.token).status_code == 200
    revoke(robot)
    assert ask(client, "giraff", key.token).status_code == 401


def test_address_with_many_wrong_tokens_must_wait(client, key, monkeypatch):
    monkeypatch.setattr(views, "REFUSED", Attempts("test-refused", limit=3, seconds=10**9))
    for _ in range(3):
        assert ask(client, "giraff", "wrong").status_code == 401
    response = ask(client, "giraff", key.token)
    assert response.status_code == 429
    assert int(response["Retry-After"]) >= 60
    assert ask(client, "giraff", key.token, REMOTE_ADDR="192.0.2.7").status_code == 200


def test_limit_of_wrong_tokens_counts_by_ipv6_network(client, key, monkeypatch):
    monkeypatch.setattr(views, "REFUSED", Attempts("test-refused", limit=3, seconds=10**9))
    for number in range(3):
        assert ask(client, "giraff", "wrong", REMOTE_ADDR=f"2001:db8::{number}").status_code == 401
    assert ask(client, "giraff", key.token, REMOTE_ADDR="2001:db8::77").status_code == 429
    assert ask(client, "giraff", key.token, REMOTE_ADDR="2001:db8:0:1::77").status_code == 200


def test_forwarded_address_is_used_only_from_a_trusted_proxy(rf, settings):
    settings.TRUSTED_PROXIES = ["10.0.0.1", "10.0.0.2/31"]
    for remote, chain, address in (
        ("10.0.0.1", "6.6.6.6, 203.0.113.9, 10.0.0.2", "203.0.113.9"),
        ("198.51.100.4", "6.6.6.6, 203.0.113.9, 10.0.0.2", "198.51.100.4"),
        ("10.0.0.1", "", "10.0.0.1"),
        ("10.0.0.1", "nonsense", "nonsense"),
        ("", "6.6.6.6", ""),
    ):
        headers = {"HTTP_X_FORWARDED_FOR": chain} if chain else {}
        assert address_of(rf.get("/", REMOTE_ADDR=remote, **headers)) == address


def test_only_get_is_answered(client, key):
    assert client.post("/api/v1/agent/").status_code == 405


# --- floor plans ----------------------------------------------------------------------------------


@pytest.fixture
def office():
    plan = store_floor_plan(SHIPPED / "office")
    Robot.objects.create(name="giraff", title="Giraff", floor_plan=plan)
    return plan


@pytest.fixture
def visitor(client):
    client.force_login(get_user_model().objects.create(username="visitor"))


def test_page_gets_the_map_and_its_image(client, visitor, office):
    content = client.get("/floorplans/office.json").json()
    assert content["resolution"] == office.resolution
    assert content["origin"] == [office.origin_x, office.origin_y, office.origin_theta]
    assert content["plan"]["rooms"]
    assert re.fullmatch(r"/floorplans/office\.png\?v=[0-9a-f]{16}", content["image"])
    picture = client.get(content["image"])
    assert picture["Content-Type"] == "image/png"
    assert picture.content == bytes(office.image)
    assert "immutable" in picture["Cache-Control"]
    assert "private" in picture["Cache-Control"]


def test_titles_of_places_are_in_the_language_of_the_page(client, visitor, office):
    english, spanish = (
        client.get("/floorplans/office.json", headers={"accept-language": language})
        for language in ("en", "es")
    )
    titles = lambda answer: [place["title"] for place in answer.json()["plan"]["places"]]
    assert titles(english)[:2] == ["Laboratory", "Living room"]
    assert titles(spanish)[:2] == ["Laboratorio", "Sala de estar"]
    assert spanish.json()["title"] == "Oficina"
    assert "translations" not in spanish.json()["plan"]
    assert english["ETag"] != spanish["ETag"]
    assert "Accept-Language" in spanish["Vary"]


@pytest.mark.parametrize("address", ["/floorplans/office.json", "/floorplans/office.png"])
def test_cached_map_is_not_sent_again(client, visitor, office, address):
    first = client.get(address)
    again = client.get(address, headers={"If-None-Match": first["ETag"]})
    assert again.status_code == 304
    assert again.content == b""


@pytest.mark.parametrize("address", ["/floorplans/office.json", "/floorplans/office.png"])
def test_map_needs_a_login(client, office, address):
    assert client.get(address).status_code == 403


def test_map_of_invisible_robots_is_not_found(client, visitor, office):
    Robot.objects.update(access=Robot.Access.INVITATION)
    assert client.get("/floorplans/office.json").status_code == 404
    assert client.get("/floorplans/office.png").status_code == 404
    assert client.get("/floorplans/nowhere.json").status_code == 404


def test_driver_gets_the_map_of_a_robot_without_observers(client, visitor, office):
    Robot.objects.update(observers_allowed=False)
    assert client.get("/floorplans/office.json").status_code == 200


def test_staff_get_every_map(client, office):
    Robot.objects.all().delete()
    client.force_login(get_user_model().objects.create(username="staff", is_staff=True))
    assert FloorPlan.objects.count() == 1
    assert client.get("/floorplans/office.json").status_code == 200
