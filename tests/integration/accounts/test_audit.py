"""The audit log: entries are written once and name ids alone."""

import datetime

import pytest
from django.urls import reverse
from django.utils import timezone

from accounts import audit
from accounts.models import AppendOnlyError, AuditEntry
from robots.models import Robot, RobotPermit
from tests.support.people import person

pytestmark = pytest.mark.django_db
NOW = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)


def test_an_entry_never_changes_and_is_not_deleted():
    about = {"actor": person("owner"), "person": person("ada"), "robot": "giraff"}
    entry = audit.note("permit_granted", **about)
    entry.act = "nothing"
    for attempt in (
        entry.save,
        entry.delete,
        AuditEntry.objects.all().delete,
        lambda: AuditEntry.objects.update(act="nothing"),
    ):
        with pytest.raises(AppendOnlyError):
            attempt()
    assert AuditEntry.objects.get().act == "permit_granted"


def test_only_what_is_old_is_forgotten_and_a_dry_run_forgets_nothing():
    audit.note("old", at=NOW)
    audit.note("new", at=NOW + datetime.timedelta(days=10))
    before = NOW + datetime.timedelta(days=5)
    assert audit.forget(before, dry_run=True) == 1
    assert audit.forget(before) == 1
    assert [entry.act for entry in AuditEntry.objects.all()] == ["new"]


def test_an_entry_outlives_its_account_without_naming_it():
    ada = person("lovelace", email="lovelace@example.org", display_name="Countess")
    audit.note("account_deleted", actor=ada, person=ada)
    key = ada.pk
    ada.delete()
    entry = AuditEntry.objects.values().get(act="account_deleted")
    assert (entry["actor"], entry["person"]) == (key, key)
    assert not any(word in str(entry) for word in ("lovelace", "example.org", "Countess"))


def test_changes_in_the_administration_are_noted_without_their_text(client):
    boss, ada = person("boss", is_staff=True, is_superuser=True), person("ada")
    client.force_login(boss)
    form = {"username": "ada", "display_name": "Countess", "email": "", "is_active": "on"}
    client.post(reverse("admin:accounts_user_change", args=[ada.pk]), form)
    entry = AuditEntry.objects.get(act="admin_changed")
    assert (entry.actor, entry.thing) == (boss.pk, f"user:{ada.pk}")
    assert "Countess" not in str(AuditEntry.objects.values().get())


def test_granted_and_taken_permits_are_noted(client):
    owner, ada = person("owner", is_staff=True), person("ada")
    robot = Robot.objects.create(name="giraff", title="Giraff", owner=owner)
    client.force_login(owner)
    form = {"title": "Giraff", "description": "", "enabled": "on", "access": "invitation"}
    form |= {"assist": "off", "calls": "accept", "charge_limit": "0.2"}
    counts = {"TOTAL_FORMS": "1", "INITIAL_FORMS": "0", "MIN_NUM_FORMS": "0", "MAX_NUM_FORMS": "9"}
    permit = {"0-robot": str(robot.pk), "0-person": "ada", "0-kind": "invited"}
    form |= {f"permits-{name}": value for name, value in (counts | permit).items()}
    address = reverse("admin:robots_robot_change", args=[robot.pk])
    assert client.post(address, form | {"permits-0-person": "nobody"}).status_code == 200
    assert not RobotPermit.objects.exists()
    assert client.post(address, form).status_code == 302
    permit = RobotPermit.objects.get()
    assert permit.user == ada
    granted = AuditEntry.objects.get(act="permit_granted")
    assert (granted.actor, granted.person) == (owner.pk, ada.pk)
    assert (granted.robot, granted.detail) == ("giraff", "invited")
    assert client.post(address, form).status_code == 200  # once is enough
    assert RobotPermit.objects.count() == 1
    form |= {"permits-INITIAL_FORMS": "1", "permits-0-id": str(permit.pk)}
    assert client.post(address, form | {"permits-0-DELETE": "on"}).status_code == 302
    assert AuditEntry.objects.get(act="permit_taken").person == ada.pk


def test_administrators_alone_read_it_and_find_a_persons_entries_by_their_id(client):
    boss, ada, ben = person("boss", is_staff=True, is_superuser=True), person("ada"), person("ben")
    audit.note("photo_opened", actor=boss, person=ada, at=timezone.now())
    audit.note("photo_opened", actor=boss, person=ben, at=timezone.now())
    client.force_login(boss)
    address = reverse("admin:accounts_auditentry_changelist")
    (entry,) = client.get(address, {"q": str(ada.pk)}).context["cl"].queryset
    assert entry.person == ada.pk
    assert client.get(address, {"act": "photo_opened"}).context["cl"].queryset.count() == 2
    delete = reverse("admin:accounts_auditentry_delete", args=[entry.pk])
    assert client.post(delete, {"post": "yes"}).status_code == 403
    client.force_login(person("staff", is_staff=True))
    assert client.get(address).status_code == 403
