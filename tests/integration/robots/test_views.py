"""The agent's configuration, and floor plans for pages."""

import re

import pytest
from django.contrib.auth import get_user_model
from django.utils import timezone

from accounts.attempts import Attempts, address_of
from robots import views
from robots.enrol.credentials import make_credentials, revoke
from robots.floorplans import store_floor_plan
from robots.models import FloorPlan, Robot
from robots.world.sites import SHIPPED

pytestmark = pytest.mark.django_db


@pytest.fixture
def key():
    return make_credentials(Robot.objects.create(name="giraff", title="Giraff"), timezone.now())


def ask(client, robot, token, **extra):
    return client.get(
        "/api/v1/agent/", headers={"Authorization": f"Bearer {robot}:{token}"}, **extra
    )


def test_an_agent_is_told_its_name_its_broker_and_the_ice_servers(client, key, settings):
    settings.MQTT_PUBLIC_URL, settings.STUN_URLS = (
        "mqtts://{host}:8883, wss://{host}/mqtt",
        ["stun:example.org"],
    )
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


def test_without_a_public_address_the_servers_own_is_told(client, key, settings):
    settings.MQTT_PUBLIC_URL, settings.MQTT_URL = "", "mqtt://127.0.0.1:1883"
    assert ask(client, "giraff", key.token).json()["mqttUrl"] == "mqtt://127.0.0.1:1883"


@pytest.mark.parametrize(
    "header",
    [
        "",
        "Bearer",
        "Bearer ",
        "Bearer giraff",
        "Bearer giraff:",
        "Bearer giraff:wrong",
        "Basic giraff:x",
        "Bearer :x",
        "Bearer giraff:" + "x" * 5000,
    ],
)
def test_anything_else_than_the_right_token_is_refused_with_the_reason(client, key, header):
    response = client.get("/api/v1/agent/", headers={"Authorization": header})
    assert response.status_code == 401
    assert response.json()["error"] == "wrong_credentials"


def test_a_revoked_or_disabled_robot_and_another_robots_token_are_refused(client, key):
    robot = Robot.objects.get()
    other = make_credentials(Robot.objects.create(name="rhodon", title="Rhodon"), timezone.now())
    assert ask(client, "giraff", other.token).status_code == 401
    Robot.objects.filter(name="giraff").update(enabled=False)
    assert ask(client, "giraff", key.token).status_code == 401
    Robot.objects.filter(name="giraff").update(enabled=True)
    assert ask(client, "giraff", key.token).status_code == 200
    revoke(robot)
    assert ask(client, "giraff", key.token).status_code == 401


def test_an_address_with_many_wrong_tokens_must_wait_and_others_need_not(client, key, monkeypatch):
    monkeypatch.setattr(views, "REFUSED", Attempts("test-refused", limit=3, seconds=10**9))
    for _ in range(3):
        assert ask(client, "giraff", "wrong").status_code == 401
    response = ask(client, "giraff", key.token)
    assert response.status_code == 429
    assert int(response["Retry-After"]) >= 60
    assert ask(client, "giraff", key.token, REMOTE_ADDR="192.0.2.7").status_code == 200


def test_a_household_that_changes_its_address_waits_as_well(client, key, monkeypatch):
    monkeypatch.setattr(views, "REFUSED", Attempts("test-refused", limit=3, seconds=10**9))
    for number in range(3):
        assert ask(client, "giraff", "wrong", REMOTE_ADDR=f"2001:db8::{number}").status_code == 401
    assert ask(client, "giraff", key.token, REMOTE_ADDR="2001:db8::77").status_code == 429
    assert ask(client, "giraff", key.token, REMOTE_ADDR="2001:db8:0:1::77").status_code == 200


def test_a_forwarded_address_counts_only_from_a_trusted_proxy(rf, settings):
    settings.TRUSTED_PROXIES = ["10.0.0.1", "10.0.0.2/31"]
    forwarded = {"HTTP_X_FORWARDED_FOR": "6.6.6.6, 203.0.113.9, 10.0.0.2"}
    assert address_of(rf.get("/", REMOTE_ADDR="10.0.0.1", **forwarded)) == "203.0.113.9"
    assert address_of(rf.get("/", REMOTE_ADDR="198.51.100.4", **forwarded)) == "198.51.100.4"
    assert address_of(rf.get("/", REMOTE_ADDR="10.0.0.1")) == "10.0.0.1"
    assert (
        address_of(rf.get("/", REMOTE_ADDR="10.0.0.1", HTTP_X_FORWARDED_FOR="nonsense"))
        == "nonsense"
    )
    assert address_of(rf.get("/", REMOTE_ADDR="", HTTP_X_FORWARDED_FOR="6.6.6.6")) == ""


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
    user = get_user_model().objects.create(username="visitor")
    client.force_login(user)
    return user


def test_a_page_gets_the_map_and_its_picture(client, visitor, office):
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


def test_a_page_gets_the_titles_of_places_in_its_own_language(client, visitor, office):
    found = {
        language: client.get("/floorplans/office.json", headers={"accept-language": language})
        for language in ("en", "es")
    }
    titles = {
        language: [place["title"] for place in answer.json()["plan"]["places"]]
        for language, answer in found.items()
    }
    assert titles["en"][:2] == ["Laboratory", "Living room"]
    assert titles["es"][:2] == ["Laboratorio", "Sala de estar"]
    assert found["es"].json()["title"] == "Oficina"
    assert "translations" not in found["es"].json()["plan"]
    assert found["en"]["ETag"] != found["es"]["ETag"]
    assert "Accept-Language" in found["es"]["Vary"]


@pytest.mark.parametrize("address", ["/floorplans/office.json", "/floorplans/office.png"])
def test_a_map_that_the_browser_has_is_not_sent_again(client, visitor, office, address):
    first = client.get(address)
    again = client.get(address, headers={"If-None-Match": first["ETag"]})
    assert again.status_code == 304
    assert again.content == b""


@pytest.mark.parametrize("address", ["/floorplans/office.json", "/floorplans/office.png"])
def test_a_visitor_who_is_not_logged_in_gets_no_map(client, office, address):
    assert client.get(address).status_code == 403


def test_a_place_whose_robots_one_may_not_see_does_not_exist(client, visitor, office):
    Robot.objects.update(access=Robot.Access.INVITATION)
    assert client.get("/floorplans/office.json").status_code == 404
    assert client.get("/floorplans/office.png").status_code == 404
    assert client.get("/floorplans/nowhere.json").status_code == 404


def test_a_driver_gets_the_map_of_a_robot_without_observers(client, visitor, office):
    Robot.objects.update(observers_allowed=False)
    assert client.get("/floorplans/office.json").status_code == 200


def test_staff_get_every_map(client, office):
    Robot.objects.all().delete()
    client.force_login(get_user_model().objects.create(username="staff", is_staff=True))
    assert FloorPlan.objects.count() == 1
    assert client.get("/floorplans/office.json").status_code == 200
