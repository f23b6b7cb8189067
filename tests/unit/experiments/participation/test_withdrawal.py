"""The privacy page describes the effect of a withdrawal on every field and table."""

import re

from django.db.models import Model

from accounts.models import AuditEntry
from experiments.models import Participant
from experiments.participation.withdrawal.deletion import KEPT
from sessions.models import Session
from surveys.models import Response
from tests.support.paths import ROOT

PAGE = (ROOT / "docs" / "explanation" / "privacy.md").read_text()
SECTION = PAGE.partition("## What stays after a withdrawal")[2].partition("\n## ")[0]
ROW = re.compile(r"^\| (`[^|]*`) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)


def names(text: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", text))


def line(begin: str) -> set[str]:
    """The names in the paragraph that begins so."""
    (found,) = (part for part in SECTION.split("\n\n") if part.startswith(begin))
    return names(found.partition(": ")[2])


def fields(model: type[Model]) -> set[str]:
    return {field.name for field in model._meta.concrete_fields}


def reached(*models: type[Model]) -> set[type[Model]]:
    """All tables with a way to one of these."""
    found: set[type[Model]] = set(models)
    for model in models:
        for relation in model._meta.get_fields(include_hidden=True):
            comes_here = relation.auto_created and not relation.concrete
            if comes_here and relation.related_model not in found:
                found |= reached(relation.related_model)
    return found


def test_each_field_of_a_participant_is_listed_as_kept_with_a_reason_or_replaced():
    stays = set().union(*(names(row[0]) for row in ROW.findall(SECTION)))
    new = line("**New**")
    assert stays == set(KEPT)
    assert new == fields(Participant) - stays


def test_each_table_about_a_participant_is_listed_as_deleted():
    tables = {model.__name__ for model in reached(Participant, Session, Response)}
    changed = line("**Kept without the person**")
    assert tables - {"Lease"} - changed == line("**Deleted**")  # a robot's forgets the session
    assert changed == {"Draw"}


def test_each_field_of_an_audit_entry_is_listed_as_kept_or_emptied():
    stays, emptied = line("**Audit log**, stays"), line("**Audit log**, emptied")
    assert stays | emptied == fields(AuditEntry)
    assert emptied == {"person", "thing"}
