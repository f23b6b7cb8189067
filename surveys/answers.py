"""Reading answers from the fields of a page: a value that the question allows, or a reason why
there is none.

A question `q` is the field `q`. A reason is sent as `~preferred_not` in the same field where one
choice excludes the others (scales, single choice), and in the field `q~` elsewhere.
"""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from django.utils.translation import gettext as _

from surveys.conditions import Circumstances, shown_keys
from surveys.definition import Definition
from surveys.item import Question, RefusedError

REASON_MARK = "~"


class Missing(StrEnum):
    """Why there is no value. NOT_APPLICABLE is a choice of the respondent. NOT_ASKED and
    NOT_REACHED are never stored.
    """

    SKIPPED = "skipped"
    PREFERRED_NOT = "preferred_not"
    NOT_APPLICABLE = "not_applicable"
    NOT_ASKED = "not_asked"
    NOT_REACHED = "not_reached"


@dataclass(frozen=True)
class AnswerValue:
    """Either a value (int, float, str, or a list of str), or the reason why there is none."""

    value: Any = None
    missing: Missing | None = None

    @property
    def is_left_empty(self) -> bool:
        return self.missing is Missing.SKIPPED


Stored = dict[str, AnswerValue]  # answers by the keys of their questions


def read_answer(
    question: Question, fields: Mapping[str, Sequence[str]], now: datetime.datetime
) -> AnswerValue:
    """Return the answer to a question in the fields of a page, sent at `now`; no answer is SKIPPED,
    whether or not that is allowed. Raises RefusedError for a value of the wrong kind or out of
    bounds, and for a reason that the question does not offer.
    """
    item, sent = question.item, fields.get(question.key, ())
    lines = (value.replace("\r\n", "\n").replace("\r", "\n") for value in sent)
    values = [value for one in lines if (value := one.replace("\x00", "").strip())]
    reasons = [value for value in fields.get(question.key + REASON_MARK, ()) if value]
    if not item.is_free_text:
        reasons += [value[1:] for value in values if value.startswith(REASON_MARK)]
        values = [value for value in values if not value.startswith(REASON_MARK)]
    if reasons:
        return _declined(question, values, reasons)
    if not values:
        return AnswerValue(missing=Missing.SKIPPED)
    if len(values) > 1 and not item.takes_several:
        raise RefusedError(_("Give only one answer."))
    return AnswerValue(value=item.parse(question, values, now))


def check_complete(question: Question, given: AnswerValue) -> None:
    if given.is_left_empty and question.item.required:
        raise RefusedError(_("Answer this question."))


def _declined(question: Question, values: list[str], reasons: list[str]) -> AnswerValue:
    if values or len(set(reasons)) > 1:
        raise RefusedError(_("Give either an answer or one reason for not answering."))
    item = question.item
    offered = [Missing.PREFERRED_NOT] if item.prefer_not else []
    offered += [Missing.NOT_APPLICABLE] if item.not_applicable else []
    if reasons[0] not in offered:
        raise RefusedError(_("Choose one of the options offered."))
    return AnswerValue(missing=Missing(reasons[0]))


def asked_keys(definition: Definition, stored: Stored, circumstances: Circumstances) -> list[str]:
    """Return the keys of the questions that a respondent with these answers is asked."""
    values = {key: given.value for key, given in stored.items()}
    return shown_keys(definition, values, circumstances)


def response_statuses(
    definition: Definition, stored: Stored, circumstances: Circumstances, reached: int
) -> Stored:
    """Return value or reason of every question of a response, by key in written order. `reached` is
    the number of pages done: all once the response is finished.

    A stored answer does not count when a change of an earlier one has hidden its question. A
    question without an answer was skipped if its page is done.
    """
    asked = set(asked_keys(definition, stored, circumstances))
    statuses: Stored = {}
    for key, question in definition.by_key.items():
        given = stored.get(key)
        if given is None and question.page >= reached:
            statuses[key] = AnswerValue(missing=Missing.NOT_REACHED)
        elif key not in asked:
            statuses[key] = AnswerValue(missing=Missing.NOT_ASKED)
        else:
            statuses[key] = given or AnswerValue(missing=Missing.SKIPPED)
    return statuses
