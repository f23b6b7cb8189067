"""Questionnaires in the database: read from files or written in the editor, and frozen by their
first respondent.

A draft is stored as long as its types are right, and can be asked once it has no problems
(surveys/problems.py). A frozen one had none when it was frozen.
"""

import datetime
from collections.abc import Mapping, Sequence
from contextlib import suppress
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

ATTEMPTS = 5  # to get the next version's number
# Researchers' names of questionnaires that have another title for respondents.
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
    definitions = [parse(path.read_bytes()) for path in sorted(SHIPPED.glob("*.json"))]
    return {definition.slug: definition for definition in definitions}


def shipped_and_not_stored() -> list[Definition]:
    known = set(Questionnaire.objects.values_list("slug", "version"))
    return [one for slug, one in shipped().items() if (slug, one.version) not in known]


def listed_title(slug: str, title: str) -> str:
    """Return a questionnaire's title in lists for researchers: "NASA-TLX: The effort it took"."""
    return f"{INSTRUMENTS[slug]}: {title}" if slug in INSTRUMENTS else title


def named_by(term: str) -> list[str]:
    return [slug for slug, name in INSTRUMENTS.items() if term.strip().lower() in name.lower()]


def store(definition: Definition, now: datetime.datetime) -> Questionnaire:
    """Store a questionnaire, or return the row that has the same content already. Raises
    BadDefinitionError when it has problems, or its version is in use with other content.
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
    with suppress(IntegrityError), transaction.atomic():
        return Questionnaire.objects.create(**fields, **_fields(definition))
    return None


def store_next(
    definition: Definition, report: ImportReport, now: datetime.datetime
) -> tuple[Questionnaire, bool]:
    """Store an imported questionnaire with its report as the next version of its name. Return the
    row, and whether it is new: the newest version may be the same. Raises BadDefinitionError when
    it has problems, or others keep storing versions of this name.
    """
    if found := list(problems(definition)):
        raise BadDefinitionError(found)
    for _attempt in range(ATTEMPTS):
        newest = _newest(definition.slug)
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


def begin_empty(
    slug: str, title: str, languages: Sequence[str], now: datetime.datetime
) -> Questionnaire:
    """Store a draft of one empty question; raises BadDefinitionError for a taken name."""
    pages = [{"key": "page_1", "items": [{"kind": "text", "key": "q1", "text": {}}]}]
    texts = {"title": dict.fromkeys(languages, title), "languages": languages}
    document = {"format": 1, "slug": slug, "version": 1, **texts, "pages": pages}
    is_taken = slug in shipped() or Questionnaire.objects.filter(slug=slug).exists()
    row = None if is_taken else _create(msgspec.convert(document, Definition), now)
    if row is None:
        raise BadDefinitionError([gettext("There is already a questionnaire of this name.")])
    return row


def save_draft(questionnaire: Questionnaire, definition: Definition) -> Questionnaire:
    """Store a draft; raises ChangedMeanwhileError if changed since it was read, or in use."""
    slug, version = questionnaire.slug, questionnaire.version
    named = msgspec.structs.replace(definition, slug=slug, version=version)
    if not _rows_like(questionnaire).update(**_fields(named)):
        raise ChangedMeanwhileError(f"{slug} {version} has since been changed or put to use")
    return Questionnaire.objects.get(pk=questionnaire.pk)


def _rows_like(questionnaire: Questionnaire) -> QuerySet[Questionnaire]:
    """The row, if it is a draft that has not changed since it was read."""
    rows = Questionnaire.objects.filter(pk=questionnaire.pk, frozen_at=None)
    return rows.filter(sha256=questionnaire.sha256)


def problems_of(questionnaire: Questionnaire) -> Sequence[Problem]:
    """Return the problems of a draft; a questionnaire in use has none."""
    if questionnaire.frozen_at is not None:
        return ()
    return _problems_in(msgspec.json.encode(questionnaire.definition))


@lru_cache(maxsize=256)
def _problems_in(document: bytes) -> Sequence[Problem]:
    return tuple(problems(msgspec.json.decode(document, type=Definition)))


def is_usable(questionnaire: Questionnaire) -> bool:
    return not questionnaire.definition.get("template") and not problems_of(questionnaire)


def _newest(slug: str) -> Questionnaire | None:
    return Questionnaire.objects.filter(slug=slug).order_by("-version").first()


def current(slug: str, now: datetime.datetime) -> Questionnaire:
    """Return the newest version, storing a shipped one first; raises Questionnaire.DoesNotExist."""
    if row := _newest(slug):
        return row
    if slug not in shipped():
        raise Questionnaire.DoesNotExist(f"no questionnaire {slug}")
    return store(shipped()[slug], now)


def freeze(questionnaire: Questionnaire, now: datetime.datetime) -> Questionnaire:
    """Return the row, unchangeable from now on; raises BadDefinitionError if it is not usable."""
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
    """Store and return a draft with the same content, numbered after the newest version."""
    newest = _newest(questionnaire.slug) or questionnaire
    definition = questionnaire.as_definition()
    return _put(msgspec.structs.replace(definition, version=newest.version + 1), now)
