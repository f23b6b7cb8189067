"""Questionnaires in the database: taken from files or written in the editor, changed while nobody
uses them, frozen by their first respondent.

A draft may be half done: it is stored as long as its types are right. Whether it can be asked is no
state of its own: it can once nothing is wrong with it (surveys/problems.py), which what is in use
was when it was frozen.
"""

import datetime
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import msgspec
from django.db import IntegrityError, transaction
from django.db.models import QuerySet
from django.utils.translation import gettext

from surveys.definition import Definition, digest, language_for
from surveys.documents import BadDefinitionError, ChangedMeanwhileError, Problem, spoken
from surveys.importing.report import ImportReport
from surveys.models import Questionnaire
from surveys.problems import parse, problems

# How often somebody else may take the next version's number first.
ATTEMPTS = 5
# What researchers call and search for questionnaires that have another title for respondents.
INSTRUMENTS: Mapping[str, str] = {
    "tlx": "NASA-TLX",
    "sus": "SUS, System Usability Scale",
    "godspeed": "Godspeed Questionnaire",
    "presence": "PQ, Presence Questionnaire",
    "simulator-sickness": "SSQ, Simulator Sickness Questionnaire",
    "social-presence": "TPI, Temple Presence Inventory",
}
SHIPPED = Path(__file__).resolve().parent / "definitions"


@cache
def shipped() -> Mapping[str, Definition]:
    """Return the questionnaires that come with the site, by name; templates among them."""
    definitions = [parse(path.read_bytes()) for path in sorted(SHIPPED.glob("*.json"))]
    return {definition.slug: definition for definition in definitions}


def listed_title(slug: str, title: str) -> str:
    """Return what lists for researchers call a questionnaire: "NASA-TLX: The effort it took"."""
    return f"{INSTRUMENTS[slug]}: {title}" if slug in INSTRUMENTS else title


def named_by(term: str) -> list[str]:
    """Return the questionnaires whose name among researchers has a term in it."""
    return [slug for slug, name in INSTRUMENTS.items() if term.strip().lower() in name.lower()]


def store(definition: Definition, now: datetime.datetime) -> Questionnaire:
    """Put a questionnaire into the database, or return the row that holds the same already.

    Raises:
        BadDefinitionError: when it is wrong, or its version is in use with other content.
    """
    if found := list(problems(definition)):
        raise BadDefinitionError(found)
    return _put(definition, now)


def _put(definition: Definition, now: datetime.datetime) -> Questionnaire:
    if row := _create(definition, now):
        return row
    fields = _fields(definition)
    rows = Questionnaire.objects.filter(slug=definition.slug, version=definition.version)
    rows.filter(frozen_at=None).exclude(sha256=fields["sha256"]).update(**fields)
    row = rows.get()
    if row.sha256 != fields["sha256"]:
        words = gettext(
            "Version %(n)d of %(name)s is in use and cannot change: use another version."
        )
        raise BadDefinitionError([words % {"n": definition.version, "name": definition.slug}])
    return row


def _create(definition: Definition, now: datetime.datetime, **more: Any) -> Questionnaire | None:
    """Return a new row; None when its version exists already."""
    fields = {"slug": definition.slug, "version": definition.version, "created_at": now, **more}
    try:
        with transaction.atomic():
            return Questionnaire.objects.create(**fields, **_fields(definition))
    except IntegrityError:
        return None


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
        version = newest.version if newest is not None else 0
        same = msgspec.structs.replace(definition, version=version)
        if newest is not None and newest.sha256 == digest(same):
            return newest, False
        following = msgspec.structs.replace(definition, version=version + 1)
        if row := _create(following, now, import_report=msgspec.to_builtins(report)):
            return row, True
    words = gettext("Someone else is changing %(name)s. Try again.")
    raise BadDefinitionError([words % {"name": definition.slug}])


def _fields(definition: Definition) -> dict[str, Any]:
    return {
        "title": spoken(definition.title, language_for(definition, "en"))[:200],
        "definition": msgspec.to_builtins(definition),
        "sha256": digest(definition),
    }


# --- drafts ---------------------------------------------------------------------------------------


def begin_empty(
    slug: str, title: str, languages: Sequence[str], now: datetime.datetime
) -> Questionnaire:
    """Make a draft with one page and one question, which has no text yet.

    Raises:
        BadDefinitionError: there is a questionnaire of that name.
    """
    question = {"kind": "text", "key": "q1", "text": {}}
    document = {
        "format": 1,
        "slug": slug,
        "version": 1,
        "title": dict.fromkeys(languages, title),
        "languages": languages,
        "pages": [{"key": "page_1", "items": [question]}],
    }
    is_taken = slug in shipped() or Questionnaire.objects.filter(slug=slug).exists()
    row = None if is_taken else _create(msgspec.convert(document, Definition), now)
    if row is None:
        raise BadDefinitionError([gettext("There is already a questionnaire of this name.")])
    return row


def save_draft(questionnaire: Questionnaire, definition: Definition) -> Questionnaire:
    """Keep a draft as it is now, complete or half done; name and version stay.

    Raises:
        ChangedMeanwhileError: it is in use, or holds something else than when it was read.
    """
    slug, version = questionnaire.slug, questionnaire.version
    named = msgspec.structs.replace(definition, slug=slug, version=version)
    if not _rows_like(questionnaire).update(**_fields(named)):
        raise ChangedMeanwhileError(f"{slug} {version} has since been changed or put to use")
    return Questionnaire.objects.get(pk=questionnaire.pk)


def _rows_like(questionnaire: Questionnaire) -> QuerySet[Questionnaire]:
    """The row, if it is a draft and holds the same as when it was read."""
    return Questionnaire.objects.filter(
        pk=questionnaire.pk, frozen_at=None, sha256=questionnaire.sha256
    )


def problems_of(questionnaire: Questionnaire) -> Sequence[Problem]:
    """Return what is wrong with a draft; nothing with what is in use."""
    if questionnaire.frozen_at is not None:
        return ()
    return _problems_in(msgspec.json.encode(questionnaire.definition))


@lru_cache(maxsize=256)
def _problems_in(document: bytes) -> Sequence[Problem]:
    return tuple(problems(msgspec.json.decode(document, type=Definition)))


def is_usable(questionnaire: Questionnaire) -> bool:
    """Tell whether it can be asked: nothing is wrong with it, and it is no template."""
    return not questionnaire.definition.get("template") and not problems_of(questionnaire)


# --- versions -------------------------------------------------------------------------------------


def current(slug: str, now: datetime.datetime) -> Questionnaire:
    """Return the newest version of a questionnaire; one that comes with the site is put into the
    database if it is not there yet.

    Raises:
        Questionnaire.DoesNotExist: when there is none of this name.
    """
    if row := Questionnaire.objects.filter(slug=slug).order_by("-version").first():
        return row
    if slug not in shipped():
        raise Questionnaire.DoesNotExist(f"no questionnaire {slug}")
    return store(shipped()[slug], now)


def freeze(questionnaire: Questionnaire, now: datetime.datetime) -> Questionnaire:
    """Return the row as it will stay from now on.

    Raises:
        BadDefinitionError: when it is a template, whose text is not filled in, or half written.
    """
    while questionnaire.frozen_at is None:
        if questionnaire.as_definition().template:
            words = gettext(
                "%(name)s is a template: fill in its text and set template to false before you use "
                "it."
            )
            raise BadDefinitionError([words % {"name": questionnaire.slug}])
        if found := problems_of(questionnaire):
            raise BadDefinitionError(found)
        _rows_like(questionnaire).update(frozen_at=now)
        questionnaire = Questionnaire.objects.get(pk=questionnaire.pk)
    return Questionnaire.objects.get(pk=questionnaire.pk)


def next_version(questionnaire: Questionnaire, now: datetime.datetime) -> Questionnaire:
    """Return a copy that can be changed, numbered after the newest version."""
    versions = Questionnaire.objects.filter(slug=questionnaire.slug).order_by("-version")
    newest = versions.values_list("version", flat=True)[0]
    return _put(msgspec.structs.replace(questionnaire.as_definition(), version=newest + 1), now)
