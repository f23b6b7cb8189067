"""The administration's first page: numbers of studies and robots, as far as a user may see them."""

import datetime
import re
from html import unescape

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse
from django.utils import timezone

from experiments.models import StudyMember
from robots.models import Robot
from sessions.models import Lease, ManagerBeat, Session
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.robots import create_robot
from tests.support.sessions import replays

pytestmark = pytest.mark.django_db
HOME = "admin:index"


def cards(client) -> dict[str, list[tuple[str, str]]]:
    """Return the lines of each card with their links, by the name of the card."""
    html = client.get(reverse(HOME)).content.decode()
    found = {}
    for name, card in re.findall(r'<section .*?"home-(\w+)">(.*?)</section>', html, re.DOTALL):
        facts = re.search(r'<ul class="home-card__facts">(.*?)</ul>', card, re.DOTALL)
        if facts is not None:
            links = re.findall(r'<a href="(.*?)">(.*?)</a>', facts[1], re.DOTALL)
            found[name] = [
                (" ".join(re.sub("<.*?>", "", text).split()), unescape(url)) for url, text in links
            ]
    return found


def facts(client) -> dict[str, list[str]]:
    return {name: [text for text, _url in lines] for name, lines in cards(client).items()}


def system(client) -> set[str]:
    """Return the apps whose lists are under System."""
    return set(re.findall(r'class="app-(\w+) module', client.get(reverse(HOME)).content.decode()))


def online(name: str, **more) -> Robot:
    presence = {"connection": "ONLINE", "last_seen_at": timezone.now()}
    return create_robot(name=name, title=name.title(), **presence | more)


@pytest.fixture
def boss(client):
    user = person("boss", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


def test_card_of_robots_counts_online_busy_and_failing_ones(client, boss):
    giraff = online("giraff")
    online("stopped", report={"safety": {"estop": True}})
    online("away", report={"errors": ["adapter_lost: no answer from the base"]})
    online("stuck", turnaround=Robot.Turnaround.PAUSED)
    online("faulty", report={"safety": {"inhibited": "fault"}})
    create_robot(name="attic", title="Attic", report={"safety": {"estop": True}})
    practice = online("practice-1", practice=True, report={"safety": {"estop": True}})
    replays.session(giraff, person("ada"), granted=timezone.now())
    replays.session(practice, person("bert"), granted=timezone.now())
    replays.session(giraff, person("cleo"), granted=timezone.now(), state=Session.State.WAITING)
    assert facts(client)["Robot"] == [
        "5 / 6 robots online",
        "1 robot in use",
        "4 robots with a problem",
        "1 visitor waiting",
        "2 visits today",
    ]


def test_card_of_studies_counts_them_by_state_and_their_participants(client, boss):
    now = timezone.now()
    other_day = (now.weekday() + 3) % 7
    away = [{"days": [other_day], "start": "09:00", "end": "10:00"}]
    study = replays.study(status="published")
    replays.study(slug="night-study", status="published", opening_hours=away)
    replays.study(slug="next-study")
    replays.study(slug="former-study", status="closed")
    hours = datetime.timedelta(hours=1)
    for name, more in {
        "ada": {},
        "bert": {"seen_at": now - 2 * hours},
        "cleo": {"status": "finished"},
        "pilot": {"kind": "pilot"},
    }.items():
        replays.participant(study, person(name), **more)
    assert facts(client)["Study"] == [
        "1 study open",
        "1 study paused, outside its hours",
        "1 draft study",
        "1 participant in the last hour",
        "1 participant finished",
    ]


def test_researcher_sees_only_the_card_of_their_own_studies(client):
    rosa = person("rosa", is_staff=True)
    StudyMember.objects.create(slug="cabin-study", user=rosa, role="viewer")
    replays.study(status="published")
    replays.study(slug="other-study", status="published")
    online("giraff")
    client.force_login(rosa)
    found = facts(client)
    assert found.keys() == {"Study"}
    assert found["Study"][0] == "1 study open"
    assert system(client) == set()
    assert "System" not in read(client.get(reverse(HOME))).text


def test_owner_sees_only_the_card_of_their_own_robots(client):
    olga = person("olga", is_staff=True)
    online("hers", owner=olga)
    online("other")
    replays.study()
    client.force_login(olga)
    found = facts(client)
    assert found.keys() == {"Robot"}
    assert found["Robot"][0] == "1 / 1 robot online"


def test_sessions_are_not_counted_without_the_right_to_see_them(client):
    user = person("helper", is_staff=True)
    user.user_permissions.set(Permission.objects.filter(codename="view_robot"))
    client.force_login(user)
    assert facts(client)["Robot"] == [
        "0 / 0 robots online",
        "0 robots in use",
        "0 robots with a problem",
    ]


def test_all_other_lists_are_under_system_and_each_is_listed_once(client, boss):
    assert facts(client).keys() == {"Study", "Robot"}
    assert system(client) >= {"accounts", "telepresence_sessions"}
    assert not system(client) & {"experiments", "surveys", "robots"}


def test_card_links_to_the_rows_that_it_counts(client, boss):
    replays.study(status="published")
    for lines in cards(client).values():
        for _text, url in lines:
            assert client.get(url).status_code == 200, url


def test_number_of_robots_or_sessions_links_to_those_that_it_counts(client, boss):
    giraff = online("giraff")
    Robot.objects.create(name="attic", title="Attic")
    online("stopped", report={"safety": {"estop": True}})
    drive = replays.session(giraff, person("ada"), granted=timezone.now())
    Lease.objects.create(robot=giraff, session=drive, epoch=1, changed_at=timezone.now())
    replays.session(giraff, person("cleo"), granted=timezone.now(), state=Session.State.WAITING)
    day = datetime.timedelta(days=1)
    replays.session(giraff, person("bert"), granted=timezone.now() - 2 * day, state="ended")
    for text, url in cards(client)["Robot"]:
        assert client.get(url).context["cl"].result_count == int(text.split()[0]), text


def test_owner_finds_their_robots_with_a_problem(client):
    olga = person("olga", is_staff=True)
    online("hers", owner=olga)
    online("stopped", owner=olga, report={"safety": {"estop": True}})
    online("other", report={"safety": {"estop": True}})
    client.force_login(olga)
    url = next(url for text, url in cards(client)["Robot"] if "with a problem" in text)
    assert [robot.name for robot in client.get(url).context["cl"].queryset] == ["stopped"]


def test_only_operators_see_that_the_session_manager_is_silent(client, boss):
    output = "The session manager isn't running"
    assert output in read(client.get(reverse(HOME))).text
    ManagerBeat.objects.create(name="manager", holder="here:1", beat_at=timezone.now())
    assert output not in read(client.get(reverse(HOME))).text
    ManagerBeat.objects.all().delete()
    client.force_login(person("helper", is_staff=True))
    assert output not in read(client.get(reverse(HOME))).text
