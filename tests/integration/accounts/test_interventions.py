"""The log of interventions: kept for years, without people, and merged into a restored site."""

import datetime
import io
import json

import pytest
from django.core.management import CommandError, call_command
from django.db.models import QuerySet
from django.utils import timezone

from accounts import audit, interventions
from accounts.models import AuditEntry
from tests.support.people import person

pytestmark = pytest.mark.django_db
YEAR = datetime.timedelta(days=366)


def called(*arguments, **options) -> str:
    out = io.StringIO()
    call_command(*arguments, stdout=out, **options)
    return out.getvalue()


def lose(*entries):
    """Delete entries as a restore of an older backup does."""
    QuerySet(AuditEntry).filter(pk__in=[entry.pk for entry in entries]).delete()


def test_interventions_are_kept_for_five_years_and_the_rest_of_the_log_for_three():
    now = timezone.now()
    for years in (1, 4, 6):
        audit.note("estop", role="screen", robot="giraff", at=now - years * YEAR)
        audit.note("photo_opened", at=now - years * YEAR)
    called("forget")
    kept = AuditEntry.objects.values_list("act", flat=True)
    assert sorted(kept) == ["estop", "estop", "photo_opened"]


def test_an_intervention_that_outlives_the_audit_log_loses_the_person_affected():
    boss, ada = person("boss"), person("ada")
    at = timezone.now() - 4 * YEAR
    audit.note("session_stopped", actor=boss, person=ada, robot="giraff", at=at)
    called("forget")
    entry = AuditEntry.objects.get()
    assert (entry.actor, entry.person, entry.at) == (boss.pk, None, at)


def test_a_stop_stays_when_its_driver_leaves_and_no_longer_says_when_or_in_which_visit():
    audit.note("stopped", role="driver", robot="giraff", thing="session-1")
    audit.unlink(["session-1"])
    entry = AuditEntry.objects.get()
    assert (entry.act, entry.role, entry.thing) == ("stopped", "driver", "")
    assert entry.at.time() == datetime.time()


def test_an_export_adds_to_an_older_log_what_that_lacks_and_changes_nothing_else(tmp_path):
    path = tmp_path / "log.jsonl"
    early = audit.note("estop", role="screen", robot="giraff", thing="session-1")
    late = audit.note("safety_test", role="owner", robot="giraff", data={"stop_s": 0.4})
    audit.note("photo_opened", actor=person("boss"))
    assert called("interventions", str(path)) == "2 entries written.\n"
    lose(late)
    audit.unlink(["session-1"])
    assert called("interventions", str(path), merge=True) == "1 entries added.\n"
    assert called("interventions", str(path), merge=True) == "0 entries added.\n"
    back = AuditEntry.objects.get(pk=late.pk)
    assert (back.act, back.role, back.data, back.at) == ("safety_test", "owner", late.data, late.at)
    assert AuditEntry.objects.get(pk=early.pk).at.time() == datetime.time(), "as it was unlinked"


def test_an_export_names_no_person_and_no_visit(tmp_path):
    boss, ada = person("boss"), person("ada")
    audit.note("session_stopped", actor=boss, person=ada, robot="giraff", thing="session-1")
    [line] = interventions.exported()
    assert set(json.loads(line)) == set(interventions.COLUMNS)
    assert not any(str(mark) in line for mark in (boss.pk, ada.pk, "session-1"))


@pytest.mark.parametrize("line", ["no json", "[]", '{"act": "estop"}', "photo_opened"])
def test_a_file_with_anything_else_is_refused(tmp_path, line):
    if line == "photo_opened":  # whole, but no intervention
        entry = audit.note("estop")
        line = next(interventions.exported()).replace("estop", "photo_opened")
        lose(entry)
    path = tmp_path / "log.jsonl"
    path.write_text(line + "\n", encoding="utf-8")
    with pytest.raises(CommandError, match="line 1 is not an intervention"):
        called("interventions", str(path), merge=True)
    assert not AuditEntry.objects.exists()


def test_an_export_never_overwrites_a_file(tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(CommandError, match="exists"):
        called("interventions", str(path))
    assert path.read_text(encoding="utf-8") == "mine"
