"""Robots that other sites serve: pages redirect there, and agents get the address."""

import pytest
from django.contrib.auth import get_user_model
from django.core.exceptions import ValidationError
from django.urls import reverse
from django.utils import timezone

from robots.enrol.credentials import make_credentials
from robots.enrol.tokens import make_token
from robots.models import Robot, RobotElsewhere

pytestmark = pytest.mark.django_db
NORTH = "https://robots.north.example.org"


@pytest.fixture(autouse=True)
def entry():
    return RobotElsewhere.objects.create(name="giraff", site=NORTH)


def bearer(name: str, token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {name}:{token}"}


def enrol(client, robot: str, token: str):
    content = {"robot": robot, "token": token}
    return client.post("/api/v1/agent/enrol/", content, content_type="application/json")


@pytest.mark.parametrize("is_signed_in", [False, True])
def test_page_of_a_robot_redirects_to_the_site_that_serves_it(client, is_signed_in):
    if is_signed_in:
        client.force_login(get_user_model().objects.create_user("ada"))
    answer = client.get("/robots/giraff/?watch=1")
    assert answer.status_code == 302
    assert answer.url == f"{NORTH}/robots/giraff/?watch=1&from_site=testserver"


@pytest.mark.parametrize("page", ["account_login", "account_signup"])
def test_visitor_from_another_site_reads_that_accounts_are_separate(client, page):
    Robot.objects.create(name="rhodon", title="Rhodon")
    sent = client.get("/robots/rhodon/?from_site=robots.south.example.org").url
    asked = client.get(f"{reverse(page)}?{sent.partition('?')[2]}").content.decode()
    assert "Sites have separate accounts" in asked
    assert "robots.south.example.org</" not in asked, "an unverified site became a link"
    usual = client.get("/robots/rhodon/").url
    asked = client.get(f"{reverse(page)}?{usual.partition('?')[2]}").content.decode()
    assert "Sites have separate accounts" not in asked


def test_two_sites_that_name_each_other_do_not_redirect_in_a_loop(client):
    client.force_login(get_user_model().objects.create_user("ada"))
    assert client.get("/robots/giraff/?from_site=robots.north.example.org").status_code == 404


def test_robot_that_is_enabled_here_is_served_here(client):
    robot = Robot.objects.create(name="giraff", title="Giraff")
    key = make_credentials(robot, timezone.now())
    assert client.get("/robots/giraff/").url.startswith(reverse("account_login"))
    assert client.get("/api/v1/agent/", headers=bearer("giraff", key.token)).status_code == 200
    robot.enabled = False
    robot.save()
    assert client.get("/robots/giraff/").url.startswith(NORTH)
    assert client.get("/api/v1/agent/", headers=bearer("giraff", key.token)).status_code == 421


def test_unknown_robot_is_unknown(client):
    assert client.get("/robots/rhodon/").url.startswith(reverse("account_login"))
    for path in ("/api/v1/agent/", "/api/v1/agent/renew/"):
        asked = client.get if path.endswith("agent/") else client.post
        assert asked(path, headers=bearer("rhodon", "wrong")).status_code == 401


@pytest.mark.parametrize("path", ["/api/v1/agent/", "/api/v1/agent/renew/"])
def test_agent_of_another_site_gets_its_address(client, path):
    asked = client.get if path == "/api/v1/agent/" else client.post
    answer = asked(path, headers=bearer("giraff", "of the north"))
    assert answer.status_code == 421
    assert answer.json()["site"] == NORTH
    assert answer.json()["detail"].startswith(f"giraff is served by {NORTH}. Start the agent with")


def test_guessed_tokens_for_a_robot_at_another_site_are_limited(client):
    statuses = [enrol(client, "giraff", "guessed").status_code for _ in range(12)]
    assert statuses[0] == 421
    assert statuses[-1] == 429


def test_robot_of_this_site_enrols(client):
    token = make_token(Robot.objects.create(name="rhodon", title="Rhodon"), timezone.now())
    assert enrol(client, "rhodon", token).json()["robot"] == "rhodon"


@pytest.mark.parametrize(
    "site",
    [
        "robots.north.example.org",
        "ftp://robots.north.example.org",
        "https://robots.north.example.org/",
        "https://robots.north.example.org/robots",
        "https://user:secret@north.example.org",
        "https://north .example.org",
        "javascript:alert(1)",
        "https://",
    ],
)
def test_site_is_only_a_scheme_a_host_and_a_port(entry, site):
    entry.site = site
    with pytest.raises(ValidationError):
        entry.full_clean()


def added(admin_client, name: str, site: str) -> str:
    values = {"name": name, "site": site}
    page = admin_client.post(reverse("admin:robots_robotelsewhere_add"), values, follow=True)
    return page.content.decode()


def test_administration_accepts_a_trailing_slash_and_no_path(admin_client):
    added(admin_client, "rhodon", f"{NORTH}/")
    assert RobotElsewhere.objects.get(name="rhodon").site == NORTH
    page = added(admin_client, "third", f"{NORTH}/robots/third/")
    assert "without a path" in page


def test_administration_reports_an_entry_without_effect(admin_client):
    assert "has no effect" not in added(admin_client, "third", NORTH).split("<h1>")[0]
    robot = Robot.objects.create(name="rhodon", title="Rhodon")
    page = added(admin_client, "rhodon", NORTH)
    assert ">rhodon</a> is enabled here, so this entry has no effect until you disable it." in page
    assert reverse("admin:robots_robot_change", args=[robot.pk]) in page


@pytest.mark.parametrize("site", ["http://10.0.0.7:8000", "https://north.example.org:8443", NORTH])
def test_address_with_a_port_is_accepted(entry, site):
    entry.site = site
    entry.full_clean()
