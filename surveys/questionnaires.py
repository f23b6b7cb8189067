"""Questionnaires in the database: taken from files, replaced while nobody uses them, frozen by
their first respondent.
"""

import datetime
from pathlib import Path
from typing import Any

import msgspec
from django.db import IntegrityError, transaction

from surveys.definition import Definition, digest, language_for
from surveys.documents import BadDefinitionError, spoken
from surveys.importing.report import ImportReport, stored
from surveys.models import Questionnaire
from surveys.problems import parse, problems

# How often somebody else may take the next version's number first.
ATTEMPTS = 5
SHIPPED = Path(__file__).resolve().parent / "definitions"


def shipped() -> dict[str, Definition]:
    """Return the questionnaires that come with the site, by name; templates among them."""
    definitions = [parse(path.read_bytes()) for path in sorted(SHIPPED.glob("*.json"))]
    return {definition.slug: definition for definition in definitions}


def store(definition: Definition, now: datetime.datetime) -> Questionnaire:
    """Put a questionnaire into the database, or return the row that holds the same already.

    Raises:
        BadDefinitionError: when it is wrong, or its version is in use with other content.
    """
    found = list(problems(definition))
    if found:
        raise BadDefinitionError(found)
    fields = _fields(definition)
    try:
        with transaction.atomic():
            return Questionnaire.objects.create(
                slug=definition.slug, version=definition.version, created_at=now, **fields
            )
    except IntegrityError:
        return _replace(definition, fields)


def store_next(
    definition: Definition, report: ImportReport, now: datetime.datetime
) -> tuple[Questionnaire, bool]:
    """Put what was imported from another system into the database as the next version of its name,
    with the report. Return the row, and whether it is new: the newest version may be the same.

    Raises:
        BadDefinitionError: when it is wrong, or others store versions of this name all the time.
    """
    if found := list(problems(definition)):
        raise BadDefinitionError(found)
    for _attempt in range(ATTEMPTS):
        newest = Questionnaire.objects.filter(slug=definition.slug).order_by("-version").first()
        version = 1 if newest is None else newest.version
        same = msgspec.structs.replace(definition, version=version)
        if newest is not None and newest.sha256 == digest(same):
            return newest, False
        if newest is not None:
            same = msgspec.structs.replace(definition, version=version + 1)
        try:
            with transaction.atomic():
                row = Questionnaire.objects.create(
                    slug=same.slug,
                    version=same.version,
                    created_at=now,
                    import_report=stored(report),
                    **_fields(same),
                )
        except IntegrityError:
            continue
        return row, True
    raise BadDefinitionError([f"{definition.slug} is being changed by somebody else: try again."])


def _replace(definition: Definition, fields: dict[str, Any]) -> Questionnaire:
    rows = Questionnaire.objects.filter(slug=definition.slug, version=definition.version)
    rows.filter(frozen_at=None).exclude(sha256=fields["sha256"]).update(**fields)
    row = rows.get()
    if row.sha256 != fields["sha256"]:
        version = f"Version {definition.version} of {definition.slug}"
        raise BadDefinitionError(
            [f"{version} is in use and cannot change: give yours another version."]
        )
    return row


def _fields(definition: Definition) -> dict[str, Any]:
    title = spoken(definition.title, language_for(definition, "en"))[:200]
    return {
        "title": title,
        "definition": msgspec.to_builtins(definition),
        "sha256": digest(definition),
    }


def current(slug: str, now: datetime.datetime) -> Questionnaire:
    """Return the newest version of a questionnaire; one that comes with the site is put into the
    database if it is not there yet.

    Raises:
        Questionnaire.DoesNotExist: when nobody knows it.
    """
    row = Questionnaire.objects.filter(slug=slug).order_by("-version").first()
    if row is not None:
        return row
    definition = shipped().get(slug)
    if definition is None:
        raise Questionnaire.DoesNotExist(f"no questionnaire {slug}")
    return store(definition, now)


def freeze(questionnaire: Questionnaire, now: datetime.datetime) -> Questionnaire:
    """Return the row as it will stay from now on.

    Raises:
        BadDefinitionError: when it is a template, whose text is not filled in.
    """
    if questionnaire.frozen_at is None:
        if questionnaire.as_definition().template:
            raise BadDefinitionError(
                [
                    (
                        f"{questionnaire.slug} is a template: fill in its text and set "
                        "template to false before you use it."
                    )
                ]
            )
        Questionnaire.objects.filter(pk=questionnaire.pk, frozen_at=None).update(frozen_at=now)
    return Questionnaire.objects.get(pk=questionnaire.pk)


def next_version(questionnaire: Questionnaire, now: datetime.datetime) -> Questionnaire:
    """Return a copy that can be changed, numbered after the newest version."""
    newest = (
        Questionnaire.objects.filter(slug=questionnaire.slug)
        .order_by("-version")
        .values_list("version", flat=True)[0]
    )
    return store(msgspec.structs.replace(questionnaire.as_definition(), version=newest + 1), now)
