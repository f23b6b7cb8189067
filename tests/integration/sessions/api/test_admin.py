"""Keys of the JSON API in the administration: created, shown once, listed for owners, revoked."""

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


def added(client, robot):
    return client.post(f"{LIST}add/", {"robot": robot.pk, "label": "home"})


def key_in(page) -> str:
    return re.search(r'<pre id="key">(\S+)</pre>', page.content.decode())[1]


def delete(client, key) -> None:
    """Delete a key with the action of the list."""
    chosen = {"action": "delete_selected", "_selected_action": [key.pk], "post": "yes"}
    client.post(LIST, chosen)


def test_owner_creates_a_key_which_is_shown_once_and_opens_the_robot(client, giraff):
    page = added(client, giraff)
    key = key_in(page)
    assert "no-store" in page.headers["Cache-Control"]
    assert key_of(f"Bearer {key}").robot == giraff
    kept = ApiKey.objects.get()
    for address in (LIST, f"{LIST}{kept.pk}/change/"):
        assert key.partition(".")[2] not in client.get(address).content.decode()
    entry = AuditEntry.objects.get(act="api_key_made")
    assert (entry.robot, entry.thing, entry.detail) == ("giraff", str(kept.pk), "home")


def test_second_key_with_the_same_label_is_refused(client, giraff):
    added(client, giraff)
    assert 'id="key"' not in added(client, giraff).content.decode()
    assert ApiKey.objects.count() == 1


def test_owner_can_neither_see_create_nor_delete_keys_of_other_robots(client, giraff):
    other = robot_of(person("another"), "rhodon")
    make_key(other, "the lift", timezone.now())
    form = client.get(f"{LIST}add/").content.decode()
    assert str(giraff.pk) in form
    assert str(other.pk) not in form
    assert "the lift" not in client.get(LIST).content.decode()
    assert 'id="key"' not in added(client, other).content.decode()
    delete(client, ApiKey.objects.get())
    assert ApiKey.objects.get().label == "the lift"


def test_owner_who_may_view_all_keys_deletes_only_their_own(client, owner, giraff):
    owner.user_permissions.add(Permission.objects.get(codename="view_apikey"))
    make_key(robot_of(person("another"), "rhodon"), "the lift", timezone.now())
    assert "the lift" in client.get(LIST).content.decode()
    key = ApiKey.objects.get()
    delete(client, key)
    client.post(f"{LIST}{key.pk}/delete/", {"post": "yes"})
    assert ApiKey.objects.get().label == "the lift"


@pytest.mark.parametrize("where", ["page", "list"])
def test_deleted_key_opens_nothing_and_its_deletion_is_audited(client, giraff, where):
    bearer = f"Bearer {key_in(added(client, giraff))}"
    key = ApiKey.objects.get()
    if where == "page":
        client.post(f"{LIST}{key.pk}/delete/", {"post": "yes"})
    else:
        delete(client, key)
    assert key_of(bearer) is None
    assert AuditEntry.objects.get(act="api_key_revoked").detail == "home"


def test_key_cannot_be_changed(client, giraff):
    added(client, giraff)
    key = ApiKey.objects.get()
    client.post(f"{LIST}{key.pk}/change/", {"label": "other", "robot": giraff.pk})
    assert ApiKey.objects.get().label == "home"


def test_list_shows_when_a_key_was_used(client, giraff):
    key = key_in(added(client, giraff))
    assert "never" in client.get(LIST).content.decode()
    headers = {"authorization": f"Bearer {key}"}
    assert Client().get("/api/v1/robots/giraff/", headers=headers).status_code == 200
    used = ApiKey.objects.get().last_used_at
    assert timezone.now() - used < datetime.timedelta(minutes=5)
    assert "never" not in client.get(LIST).content.decode()


def test_use_of_a_key_is_stored_once_a_minute(giraff, django_assert_num_queries):
    now = timezone.now()
    make_key(giraff, "home", now)
    note_use(ApiKey.objects.get(), now)
    key = ApiKey.objects.get()
    with django_assert_num_queries(0):
        note_use(key, now + datetime.timedelta(seconds=59))
    note_use(key, now + datetime.timedelta(seconds=60))
    assert ApiKey.objects.get().last_used_at == now + datetime.timedelta(seconds=60)
