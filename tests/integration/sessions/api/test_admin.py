"""Keys of the JSON API in the administration: made and shown once, seen by whose robot it is, taken
away.
"""

import datetime
import re

import pytest
from django.contrib.auth.models import Permission
from django.test import Client
from django.utils import timezone

from accounts.models import AuditEntry
from robots.models import Robot
from sessions.api.keys import key_of, make_key, note_use
from sessions.models import ApiKey
from tests.support.people import person

pytestmark = pytest.mark.django_db
LIST = "/admin/telepresence_sessions/apikey/"


def robot_of(owner, name="giraff") -> Robot:
    return Robot.objects.create(name=name, title=name.title(), owner=owner)


@pytest.fixture
def owner(client):
    user = person("owner", is_staff=True)
    client.force_login(user)
    return user


@pytest.fixture
def giraff(owner):
    return robot_of(owner)


def made(client, robot, label="home") -> str:
    """Make a key as people do and return it as the page shows it."""
    page = client.post(f"{LIST}add/", {"robot": robot.pk, "label": label})
    assert page.status_code == 200
    return re.search(r'<pre id="key">(\S+)</pre>', page.content.decode())[1]


def test_an_owner_makes_a_key_which_is_shown_once_and_opens_the_robot(client, giraff):
    page = client.post(f"{LIST}add/", {"robot": giraff.pk, "label": "home"})
    key = re.search(r'<pre id="key">(\S+)</pre>', page.content.decode())[1]
    assert "no-store" in page.headers["Cache-Control"]
    assert key_of(f"Bearer {key}").robot == giraff
    kept = ApiKey.objects.get()
    for address in (LIST, f"{LIST}{kept.pk}/change/"):
        assert key.partition(".")[2] not in client.get(address).content.decode()
    entry = AuditEntry.objects.get(act="api_key_made")
    assert (entry.robot, entry.thing, entry.detail) == ("giraff", str(kept.pk), "home")


def test_two_keys_of_a_robot_do_not_share_a_label_and_the_form_sent_again_makes_none(
    client, giraff
):
    made(client, giraff)
    again = client.post(f"{LIST}add/", {"robot": giraff.pk, "label": "home"})
    assert 'id="key"' not in again.content.decode()
    assert ApiKey.objects.count() == 1


def test_an_owner_neither_sees_nor_makes_nor_deletes_keys_of_other_robots(client, giraff):
    other = robot_of(person("another"), "rhodon")
    make_key(other, "the lift", timezone.now())
    form = client.get(f"{LIST}add/").content.decode()
    assert str(giraff.pk) in form
    assert str(other.pk) not in form
    assert "the lift" not in client.get(LIST).content.decode()
    assert (
        'id="key"'
        not in client.post(f"{LIST}add/", {"robot": other.pk, "label": "x"}).content.decode()
    )
    client.post(
        LIST,
        {"action": "delete_selected", "_selected_action": [ApiKey.objects.get().pk], "post": "yes"},
    )
    assert ApiKey.objects.get().label == "the lift"


def test_an_owner_who_may_look_at_all_keys_takes_only_their_own_away(client, owner, giraff):
    owner.user_permissions.add(Permission.objects.get(codename="view_apikey"))
    make_key(robot_of(person("another"), "rhodon"), "the lift", timezone.now())
    assert "the lift" in client.get(LIST).content.decode()
    pk = ApiKey.objects.get().pk
    client.post(LIST, {"action": "delete_selected", "_selected_action": [pk], "post": "yes"})
    client.post(f"{LIST}{pk}/delete/", {"post": "yes"})
    assert ApiKey.objects.get().label == "the lift"


@pytest.mark.parametrize("way", ["page", "list"])
def test_a_key_that_was_taken_away_opens_nothing_and_that_is_noted(client, giraff, way):
    bearer = f"Bearer {made(client, giraff)}"
    pk = ApiKey.objects.get().pk
    if way == "page":
        client.post(f"{LIST}{pk}/delete/", {"post": "yes"})
    else:
        client.post(LIST, {"action": "delete_selected", "_selected_action": [pk], "post": "yes"})
    assert key_of(bearer) is None
    assert AuditEntry.objects.get(act="api_key_revoked").detail == "home"


def test_a_key_cannot_be_changed(client, giraff):
    made(client, giraff)
    key = ApiKey.objects.get()
    client.post(f"{LIST}{key.pk}/change/", {"label": "other", "robot": giraff.pk})
    assert ApiKey.objects.get().label == "home"


def test_the_list_tells_when_a_key_was_used(client, giraff):
    key = made(client, giraff)
    assert "never" in client.get(LIST).content.decode()
    assert (
        Client()
        .get("/api/v1/robots/giraff/", headers={"authorization": f"Bearer {key}"})
        .status_code
        == 200
    )
    used = ApiKey.objects.get().last_used_at
    assert timezone.now() - used < datetime.timedelta(minutes=5)
    assert "never" not in client.get(LIST).content.decode()


def test_a_use_is_written_once_a_minute(giraff, django_assert_num_queries):
    now = timezone.now()
    make_key(giraff, "home", now)
    note_use(ApiKey.objects.get(), now)
    key = ApiKey.objects.get()
    with django_assert_num_queries(0):
        note_use(key, now + datetime.timedelta(seconds=59))
    note_use(key, now + datetime.timedelta(seconds=60))
    assert ApiKey.objects.get().last_used_at == now + datetime.timedelta(seconds=60)
