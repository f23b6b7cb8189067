"""Trying a simulated robot without an account: permissions and time limits."""

import datetime
import re

import pytest
from django.core.management import call_command
from django.db import connection
from django.test import Client
from django.test.utils import CaptureQueriesContext
from django.urls import reverse
from django.utils import timezone

from accounts.models import User
from accounts.passwordless import NEW_GUESTS
from robots.access import may_drive, may_observe
from robots.models import Robot, RobotPresence
from sessions.leases import terms
from sessions.models import Session
from telepresence_site.practice import robots
from tests.support.people import person
from tests.support.sessions.query_plans import session_reads
from tests.support.sessions.rows import chunk_row, session_row

pytestmark = pytest.mark.django_db


@pytest.fixture(autouse=True)
def practice(settings, tmp_path):
    settings.PRACTICE_ROBOTS, settings.CREDENTIALS_DIR = 1, tmp_path / "credentials"
    robots.prepare(1, "mqtt://127.0.0.1:1")
    return Robot.objects.get(name="practice-1")


@pytest.fixture
def tries(client):
    assert client.post(reverse("try_now")).url == reverse("try_robot")
    return User.objects.get(kind=User.Kind.VISITOR)


def go_online(robot: Robot) -> None:
    online = {"connection": "ONLINE", "last_seen_at": timezone.now()}
    RobotPresence.objects.filter(pk=robot.pk).update(**online)


def test_first_page_offers_a_trial_if_there_are_practice_robots(client, settings):
    assert reverse("try_now") in client.get(reverse("home")).content.decode()
    settings.PRACTICE_ROBOTS = 0
    assert reverse("try_now") not in client.get(reverse("home")).content.decode()
    refused = client.post(reverse("try_now"))
    assert refused.status_code == 404
    assert "This site offers no trial" in refused.content.decode()


def test_length_of_a_trial_is_shown_beside_its_button(client, settings):
    assert "1 minute, without an account" in client.get(reverse("home")).content.decode()
    settings.TRIAL_SECONDS = 90.0
    assert "90 seconds, without an account" in client.get(reverse("home")).content.decode()
    client.force_login(person())
    assert "without an account" not in client.get(reverse("home")).content.decode()
    assert "This takes a few seconds.<" in client.get(reverse("try_robot")).content.decode()


def test_visitor_who_waits_reads_that_trials_have_been_turned_off(client, tries, settings):
    settings.PRACTICE_ROBOTS = 0
    assert client.get(reverse("practice")).status_code == 404
    assert "This site offers no trial" in client.get(reverse("try_robot")).content.decode()


def test_page_leads_to_a_robot_as_soon_as_one_is_ready(client, tries, practice):
    assert client.get(reverse("try_robot")).status_code == 200
    assert client.get(reverse("practice")).json() == {"url": None}
    go_online(practice)
    url = client.get(reverse("practice")).json()["url"]
    page = client.get(url)
    assert page.status_code == 200
    assert page.context["config"]["signUp"] == reverse("account_signup")
    plan = client.get(page.context["config"]["floorplan"])
    assert plan.status_code == 200
    assert client.get(plan.json()["image"]).status_code == 200


def test_robot_that_is_about_to_restart_is_not_offered(client, tries, practice):
    go_online(practice)
    RobotPresence.objects.filter(pk=practice.pk).update(boot="first")
    now = timezone.now()
    before = session_row(practice, tries, state="ended", granted_at=now, ended_at=now)
    chunk_row(before, [{"boot": "first", "seq": 0, "stamp": 0.0}])
    assert client.get(reverse("practice")).json() == {"url": None}
    RobotPresence.objects.filter(pk=practice.pk).update(boot="second")
    assert client.get(reverse("practice")).json()["url"] is not None


@pytest.mark.parametrize("kind", ["visitor", "full"])
def test_request_for_a_robot_starts_one(client, tries, kind):
    if kind == "full":
        client.force_login(person())
        assert client.post(reverse("try_now")).url == reverse("try_robot")
    assert robots.demand(None, timezone.now()).wanted_at is None
    client.post(reverse("practice"))
    assert robots.demand(None, timezone.now()).wanted_at is not None


def test_trial_gives_no_other_rights(client, tries, giraff):
    home = client.get(reverse("home"))
    assert not home.context["user"].is_authenticated
    assert home.context["invitation"].url.startswith(reverse("account_signup"))
    drive = client.get(reverse("drive", args=["giraff"]))
    assert drive.url.startswith(reverse("account_login"))
    assert client.get(reverse("account_signup")).status_code == 200
    assert client.post(reverse("api_act", args=["giraff"])).status_code in (401, 403)
    assert not may_drive(tries, giraff)
    assert not may_observe(tries, giraff)


def test_each_trial_has_a_new_visitor(client, tries):
    client.post(reverse("try_now"))
    assert User.objects.filter(kind=User.Kind.VISITOR).count() == 2
    client.cookies.clear()
    assert client.get(reverse("try_robot")).url == reverse("home")


def test_user_with_an_account_practises_under_that_account(client):
    ada = User.objects.create_user("ada", password="x")
    client.force_login(ada)
    client.post(reverse("try_now"))
    assert client.get(reverse("try_robot")).status_code == 200
    assert User.objects.count() == 1


def test_trials_are_limited_per_address(client, settings):
    for _ in range(NEW_GUESTS.limit):
        assert client.post(reverse("try_now")).status_code == 302
    answer = client.post(reverse("try_now"))
    assert answer.status_code == 429
    assert int(answer["Retry-After"]) > 0


def test_turn_of_a_trial_is_always_limited(client, tries, practice):
    fixed = terms.of_granted(session_row(practice, tries), timezone.now())
    assert (fixed.turn_seconds, fixed.turn_always) == (60.0, True)
    ada = User.objects.create_user("ada", password="x")
    assert terms.of_granted(session_row(practice, ada), timezone.now()) == terms.FREE


def test_visitors_of_trials_are_deleted_after_a_day(client, tries, practice):
    session_row(practice, tries)
    call_command("forget", verbosity=0)
    assert User.objects.filter(pk=tries.pk).exists()
    before = timezone.now() - datetime.timedelta(days=2)
    User.objects.filter(pk=tries.pk).update(last_login=before, date_joined=before)
    call_command("forget", verbosity=0)
    assert not User.objects.filter(pk=tries.pk).exists()
    assert Session.objects.count() == 0


def test_get_request_for_a_robot_changes_nothing(tries, practice, client):
    rows = lambda: [model.objects.values().get(pk=pk) for model, pk in known]
    known = (Robot, practice.pk), (User, tries.pk)
    before = rows()
    with CaptureQueriesContext(connection) as asked:
        assert client.get(reverse("practice")).json() == {"url": None}
    assert not [query["sql"] for query in asked if query["sql"].startswith(("UPDATE", "INSERT"))]
    assert rows() == before


def test_page_posts_its_request_with_a_csrf_token(tries, practice):
    browser = Client(enforce_csrf_checks=True)
    browser.force_login(tries)
    page = browser.get(reverse("try_robot")).content.decode()
    token = re.search(r'data-csrf="(\w+)"', page)[1]
    asked = browser.post(reverse("practice"), headers={"X-CSRFToken": token})
    assert asked.json() == {"url": None}
    practice.refresh_from_db()
    assert practice.wanted_at is not None
    assert browser.post(reverse("practice")).status_code == 403


def test_finding_a_practice_robot_reads_only_live_or_recent_sessions(tries, practice, client):
    with CaptureQueriesContext(connection) as asked:
        client.get(reverse("practice"))
    reads = session_reads(asked, "robots_robot")
    assert reads
    assert all("state=?" in line or "queued_at>?" in line for line in reads), reads
