"""The log of interventions on a robot's page in the administration."""

import csv
import io

import pytest
from django.urls import reverse

from accounts import audit
from accounts.models import AuditEntry
from robots.models import Robot
from tests.support.people import person
from tests.support.robots import create_robot, robot_form

pytestmark = pytest.mark.django_db


@pytest.fixture
def owner(client):
    user = person("owner", is_staff=True)
    client.force_login(user)
    return user


@pytest.fixture
def giraff(owner):
    return create_robot(name="giraff", title="Giraff", owner=owner)


def page(client, robot, name="interventions"):
    return client.get(reverse(f"admin:robots_robot_{name}", args=[robot.pk]))


def test_an_owner_reads_what_happened_to_the_own_robot_and_to_the_site(client, giraff):
    audit.note("stopped", robot="giraff", role="screen")
    audit.note("site_changed", role="server", data={"version": ["0.1.0", "0.9.0"]})
    audit.note("estop", robot="rhodon", role="button")
    audit.note("photo_opened", robot="giraff")
    words = page(client, giraff).content.decode()
    assert "person at the robot&#x27;s screen" in words
    assert "version: 0.1.0 → 0.9.0" in words
    assert "emergency stop" not in words
    assert words.count('<th scope="row">') == 2
    main = client.get(reverse("admin:robots_robot_change", args=[giraff.pk])).content.decode()
    assert reverse("admin:robots_robot_interventions", args=[giraff.pk]) in main


def test_a_robot_of_somebody_else_has_no_log(client, giraff):
    client.force_login(person("other", is_staff=True))
    create_robot(name="rhodon", title="Rhodon", owner=person("third"))
    assert page(client, giraff).status_code in {403, 404}
    assert page(client, giraff, "interventions_csv").status_code in {403, 404}


def test_the_log_is_downloaded_as_csv_with_the_oldest_entry_first(client, giraff):
    audit.note("stopped", robot="giraff", role="driver", thing="session-1")
    audit.note("estop", robot="giraff", role="button")
    answer = page(client, giraff, "interventions_csv")
    assert "attachment" in answer["Content-Disposition"]
    rows = list(csv.DictReader(io.StringIO(answer.content.decode())))
    assert [(row["act"], row["role"]) for row in rows] == [
        ("stopped", "driver"),
        ("estop", "button"),
    ]
    assert "session-1" not in answer.content.decode()


def test_changed_limits_are_noted_with_their_values_and_other_fields_are_not(client, giraff):
    address = reverse("admin:robots_robot_change", args=[giraff.pk])
    counts = {"permits-MIN_NUM_FORMS": "0", "permits-MAX_NUM_FORMS": "9"}
    form = robot_form(title="Giraff", description="") | counts
    assert client.post(address, form | {"description": "new"}).status_code == 302
    assert not AuditEntry.objects.filter(act="limits_changed").exists()
    changes = {"max_linear": "0.3", "assist": "slow"}
    assert client.post(address, form | changes).status_code == 302
    entry = AuditEntry.objects.get(act="limits_changed")
    assert (entry.role, entry.robot) == ("owner", "giraff")
    assert entry.data == {"max_linear": [None, 0.3], "assist": ["off", "slow"]}
    assert Robot.objects.get().max_linear == 0.3
    assert "max_linear: – → 0.3" in page(client, giraff).content.decode()


def test_a_long_log_has_pages(client, giraff):
    for _ in range(51):
        audit.note("stopped", robot="giraff", role="driver")
    words = page(client, giraff).content.decode()
    assert words.count('<th scope="row">') == 50
    assert "Page 1 of 2" in words
