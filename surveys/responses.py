"""Responses: begun once for a respondent and context, saved question by question or page by page,
and finished once.

Every function can be called twice with the same result. Nothing relies on transactions: rows are
unique, and updates name the state that they expect.
"""

import datetime
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from surveys.answers import AnswerValue, Stored, asked_keys, check_complete, read_answer
from surveys.definition import Definition, language_for
from surveys.item import RefusedError
from surveys.models import Answer, Questionnaire, Response
from surveys.questionnaires import freeze

MAX_SECONDS = 24 * 3600.0
SentFields = Mapping[str, Sequence[str]]


class ClosedError(Exception):
    """The response is finished and takes no more answers."""


class NotAskedError(Exception):
    """This respondent is not asked the question now: it is unknown, hidden, or on a later page."""


@dataclass(frozen=True)
class Respondent:
    """A user, or an anonymous key of at most 64 characters."""

    user: Any = None
    key: str = ""

    def __post_init__(self) -> None:
        if (self.user is None) == (not self.key):
            raise ValueError("a respondent must be either a user or a key")

    @property
    def name(self) -> str:
        return f"user:{self.user.pk}" if self.user is not None else f"key:{self.key}"


@dataclass(frozen=True)
class Context:
    """The circumstances of a response. `key` is opaque, `robot` has the robot's names; `return_to`
    and `back_to` are paths of this site.
    """

    key: str
    label: str = ""
    robot: Sequence[str] = ()
    outcome: str = ""
    return_to: str = ""
    back_to: str = ""


@dataclass(frozen=True)
class Saving:
    """The saving of answers: when, in the language shown, with seconds of attention by question;
    `writer` is the page load that saves them, `writing` counts its requests.
    """

    now: datetime.datetime
    language: str
    seconds: Mapping[str, float] = field(default_factory=dict)
    writer: str = ""
    writing: int = 0


@dataclass(frozen=True)
class PageResult:
    """Errors of a sent page by question, and whether its answers made more questions appear."""

    errors: dict[str, str]
    more_appeared: bool

    @property
    def is_done(self) -> bool:
        return not self.errors and not self.more_appeared


def begin(
    questionnaire: Questionnaire,
    respondent: Respondent,
    context: Context,
    *,
    language: str,
    seed: int,
    now: datetime.datetime,
) -> Response:
    """Return the response of a respondent in a context, made at the first call and not changed by
    later ones, even with a newer version of the questionnaire. Raises BadDefinitionError when the
    questionnaire is a template.
    """
    parts = [questionnaire.slug, respondent.name, context.key]
    slot = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    rows = Response.objects.select_related("questionnaire")
    if found := rows.filter(slot=slot).first():
        return found
    frozen = freeze(questionnaire, now)
    fields = {
        "questionnaire": frozen,
        "user": respondent.user,
        "respondent_key": respondent.key,
        "context": context.key,
        "context_label": context.label[:200],
        "robot": list(context.robot),
        "outcome": context.outcome,
        "return_to": context.return_to,
        "back_to": context.back_to,
        "seed": seed,
        "language": language_for(frozen.as_definition(), language),
        "started_at": now,
        "seen_at": now,
    }
    return rows.get_or_create(slot=slot, defaults=fields)[0]


def save_one(
    response: Response, definition: Definition, key: str, fields: SentFields, saving: Saving
) -> AnswerValue:
    """Store the answer to one question in the fields of a page, empty or not, and return it. Raises
    ClosedError when the response is finished, NotAskedError when the question is on no page so far,
    and RefusedError when it does not allow the answer.
    """
    _check_open(response)
    question = definition.question(key)
    shown = asked_keys(definition, response.given(), response.circumstances)
    if question is None or question.page > response.reached or key not in shown:
        raise NotAskedError(key)
    given = read_answer(question, fields, saving.now)
    _write(response, definition, {key: given}, saving)
    return given


def save_page(
    response: Response,
    definition: Definition,
    page: int,
    *,
    fields: SentFields,
    offered: Iterable[str],
    saving: Saving,
) -> PageResult:
    """Store the answers of a whole page (from 0) and return the errors of the others. `offered` are
    the keys of the questions that the respondent saw. Raises ClosedError when the response is
    finished, and NotAskedError for a later page or when `offered` has questions of other pages.
    """
    _check_open(response)
    here = {key: one for key, one in definition.by_key.items() if one.page == page}
    offered = set(offered)
    if page > response.reached or not here or offered - set(here):
        raise NotAskedError(str(page))
    stored, given, errors = response.given(), Stored(), dict[str, str]()
    for key, question in here.items():
        # an answer may hide questions after it
        if key in offered and key in asked_keys(definition, stored | given, response.circumstances):
            try:
                given[key] = read_answer(question, fields, saving.now)
                check_complete(question, given[key])
            except RefusedError as error:
                errors[key] = str(error)
    changed = {key: one for key, one in given.items() if stored.get(key) != one}
    _write(response, definition, changed, saving)
    asked = set(asked_keys(definition, stored | given, response.circumstances))
    errors = {key: text for key, text in errors.items() if key in asked}
    return PageResult(errors, more_appeared=bool((asked & set(here)) - offered))


def leave_page(response: Response, definition: Definition, page: int) -> int | None:
    """Record that a page is done; return the next one with questions, None after the last."""
    following = next((n for n in pages_shown(response, definition) if n > page), None)
    left_behind = len(definition.pages) if following is None else following
    unfinished = Response.objects.filter(pk=response.pk, finished_at=None)
    unfinished.filter(reached__lt=left_behind).update(reached=left_behind)
    response.refresh_from_db(fields=["reached"])
    return following


def finish(response: Response, definition: Definition, now: datetime.datetime) -> int | None:
    """Close a response and return None, or the first page on which a required answer is missing."""
    stored = response.given()
    for key in asked_keys(definition, stored, response.circumstances):
        question, given = definition.by_key[key], stored.get(key)
        if question.item.required and (given is None or given.is_left_empty):
            return question.page
    unfinished = Response.objects.filter(pk=response.pk, finished_at=None)
    unfinished.update(finished_at=now, reached=len(definition.pages))
    response.refresh_from_db(fields=["finished_at", "reached"])
    return None


def place(response: Response, definition: Definition) -> int | None:
    """Return the furthest open page (from 0), at which a respondent resumes; None without one."""
    shown = pages_shown(response, definition)
    open_now = [page for page in shown if page <= response.reached]
    if response.reached < len(definition.pages) and open_now:
        return open_now[-1]
    return leave_page(response, definition, -1) if response.reached == 0 else None


def pages_shown(response: Response, definition: Definition) -> list[int]:
    """Return the pages on which this respondent is asked anything, from 0, in order."""
    shown = asked_keys(definition, response.given(), response.circumstances)
    return sorted({definition.by_key[key].page for key in shown})


def _check_open(response: Response) -> None:
    if response.finished_at is not None:
        raise ClosedError(str(response.pk))


def _write(response: Response, definition: Definition, given: Stored, saving: Saving) -> None:
    places = definition.positions(response.seed) if given else {}
    for key, answer in given.items():
        fields: dict[str, Any] = {
            "value": answer.value,
            "missing": answer.missing.value if answer.missing else "",
            "language": saving.language,
            "text_version": definition.by_key[key].fingerprint(saving.language),
            "position": places[key],
            "answered_at": saving.now,
            "writer": saving.writer,
            "writing": saving.writing,
        }
        if (seconds := saving.seconds.get(key)) is not None:
            elapsed = (saving.now - response.started_at).total_seconds()
            fields["seconds"] = round(min(max(seconds, 0.0), elapsed, MAX_SECONDS), 2)
        first = {"first_at": saving.now, **fields}
        row, is_new = Answer.objects.get_or_create(response=response, item=key, defaults=first)
        if not is_new:
            older = Answer.objects.filter(pk=row.pk)
            if saving.writer:
                older = older.exclude(writer=saving.writer, writing__gte=saving.writing)
            older.update(**fields)
    Response.objects.filter(pk=response.pk).update(seen_at=saving.now)
