"""What somebody says to one question, judged: a value of the right kind within its bounds, or a
reason why there is none.

On the page a question `q` is the field `q`; a reason comes as `~preferred_not` in the same field
where one choice excludes the others (scales, single choice), and in the field `q~` elsewhere.
"""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from django.utils.translation import gettext as _

from surveys.conditions import Circumstances, shown_keys
from surveys.definition import (
    Date,
    Definition,
    Grid,
    Likert,
    Multiple,
    Number,
    Question,
    Single,
    Slider,
    TextItem,
)

REASON_MARK = "~"
MAX_DIGITS = 30
NUMBER_LIMIT = 1e12
# Hours from UTC of the places where days begin last and first.
WESTERNMOST, EASTERNMOST = -12, 14


class Missing(StrEnum):
    """Why there is no value. NOT_REACHED is never stored: whoever did not come so
    far said nothing.
    """

    SKIPPED = "skipped"
    PREFERRED_NOT = "preferred_not"
    NOT_APPLICABLE = "not_applicable"
    NOT_REACHED = "not_reached"


class RefusedError(ValueError):
    """An answer that its question does not allow; the text is for the visitor, in the language of
    the page.
    """


@dataclass(frozen=True)
class AnswerValue:
    """An answer: either a value (int, float, str, or a list of str in written order), or the reason
    why there is none.
    """

    value: Any = None
    missing: Missing | None = None

    @property
    def is_left_empty(self) -> bool:
        """Whether nothing at all was said."""
        return self.missing is Missing.SKIPPED


def read_answer(
    question: Question, fields: Mapping[str, Sequence[str]], now: datetime.datetime
) -> AnswerValue:
    """Return what the fields of a page say to a question; saying nothing is `SKIPPED`, whether or
    not that is allowed.

    Args:
        question: the question.
        fields: values by field name, as the page sends them.
        now: when it is said, for bounds that move with the day.

    Raises:
        RefusedError: when the value is of the wrong kind, out of bounds, or a reason is given that
            the question does not offer.
    """
    values = [
        value.replace("\r\n", "\n").replace("\x00", "").strip()
        for value in fields.get(question.key, ())
    ]
    reasons = [value for value in fields.get(question.key + REASON_MARK, ()) if value]
    reasons += [
        value[1:]
        for value in values
        if value.startswith(REASON_MARK) and not isinstance(question.item, TextItem)
    ]
    values = [
        value
        for value in values
        if value and (isinstance(question.item, TextItem) or not value.startswith(REASON_MARK))
    ]
    if reasons:
        return _declined(question, values, reasons)
    if not values:
        return AnswerValue(missing=Missing.SKIPPED)
    if len(values) > 1 and not isinstance(question.item, Multiple):
        raise RefusedError(_("Please give one answer."))
    return AnswerValue(value=_value(question, values, now))


def check_complete(question: Question, given: AnswerValue) -> None:
    """Raise RefusedError when an answer that is required was left empty."""
    if given.is_left_empty and question.item.required:
        raise RefusedError(_("Please answer this question."))


def _declined(question: Question, values: list[str], reasons: list[str]) -> AnswerValue:
    if values or len(set(reasons)) > 1:
        raise RefusedError(_("Please either answer or say why not."))
    allowed = {
        Missing.PREFERRED_NOT.value: question.item.prefer_not,
        Missing.NOT_APPLICABLE.value: question.item.not_applicable,
    }
    if not allowed.get(reasons[0]):
        raise RefusedError(_("This is not among the choices."))
    return AnswerValue(missing=Missing(reasons[0]))


def _value(question: Question, values: list[str], now: datetime.datetime) -> Any:
    item = question.item
    if isinstance(item, Likert | Grid):
        return _one_of({str(point.value): point.value for point in question.points}, values[0])
    if isinstance(item, Single):
        return _one_of({option.value: option.value for option in item.options}, values[0])
    if isinstance(item, Multiple):
        return _several(item, values)
    if isinstance(item, TextItem):
        return _words(item, values[0])
    if isinstance(item, Date):
        return _day(item, values[0], now)
    return _slide(item, values[0]) if isinstance(item, Slider) else _number(item, values[0], now)


def _one_of(choices: dict[str, Any], value: str) -> Any:
    if value not in choices:
        raise RefusedError(_("This is not among the choices."))
    return choices[value]


def _several(item: Multiple, values: list[str]) -> list[str]:
    for value in values:
        _one_of({option.value: value for option in item.options}, value)
    chosen = [option for option in item.options if option.value in values]
    if len(chosen) > 1 and any(option.alone for option in chosen):
        raise RefusedError(_("One of your choices excludes the others."))
    if len(chosen) < item.at_least and not any(option.alone for option in chosen):
        raise RefusedError(_("Please choose at least %(n)d.") % {"n": item.at_least})
    if item.at_most is not None and len(chosen) > item.at_most:
        raise RefusedError(_("Please choose at most %(n)d.") % {"n": item.at_most})
    return [option.value for option in chosen]


def _words(item: TextItem, value: str) -> str:
    if len(value) > item.max_length:
        raise RefusedError(_("Please write at most %(n)d characters.") % {"n": item.max_length})
    return value


def _day(item: Date, value: str, now: datetime.datetime) -> str:
    try:
        day = datetime.date.fromisoformat(value)
    except ValueError as error:
        raise RefusedError(_("Please give a day as year-month-day.")) from error
    earliest, latest = days_between(item, now)
    if earliest is not None and day < earliest:
        raise RefusedError(_("The earliest day is %(day)s.") % {"day": earliest.isoformat()})
    if latest is not None and day > latest:
        raise RefusedError(_("The latest day is %(day)s.") % {"day": latest.isoformat()})
    return day.isoformat()


def days_between(
    item: Date, now: datetime.datetime
) -> tuple[datetime.date | None, datetime.date | None]:
    """Return the earliest and the latest day that a date may be; None without a bound. Somewhere on
    Earth it is still, or already, today.
    """
    return _bound(item.earliest, _day_at(now, WESTERNMOST)), _bound(
        item.latest, _day_at(now, EASTERNMOST)
    )


def _bound(bound: str | None, today: datetime.date) -> datetime.date | None:
    if bound is None or bound == "today":
        return None if bound is None else today
    return datetime.date.fromisoformat(bound)


def _day_at(now: datetime.datetime, hours: int) -> datetime.date:
    return now.astimezone(datetime.timezone(datetime.timedelta(hours=hours))).date()


def _number(item: Number, value: str, now: datetime.datetime) -> int | float:
    number = _parsed(value)
    if item.whole and number != int(number):
        raise RefusedError(_("Please give a whole number."))
    least, greatest = item.minimum, greatest_number(item, now)
    if least is not None and number < least:
        raise RefusedError(_("The least number is %(n)s.") % {"n": plain(least)})
    if greatest is not None and number > greatest:
        raise RefusedError(_("The greatest number is %(n)s.") % {"n": plain(greatest)})
    return int(number) if item.whole else number


def greatest_number(item: Number, now: datetime.datetime) -> float | None:
    """Return the upper bound of a number; None without one."""
    return _day_at(now, EASTERNMOST).year if isinstance(item.maximum, str) else item.maximum


def _slide(item: Slider, value: str) -> int:
    number = _parsed(value)
    if (
        number != int(number)
        or not item.minimum <= number <= item.maximum
        or (number - item.minimum) % item.step
    ):
        words = {"least": item.minimum, "greatest": item.maximum, "step": item.step}
        raise RefusedError(
            _("Please give a number from %(least)d to %(greatest)d in steps of %(step)d.") % words
        )
    return int(number)


def _parsed(value: str) -> float:
    """Return a number that was written with a point or a comma."""
    try:
        number = (
            float(value.replace(",", "."))
            if len(value) <= MAX_DIGITS and "_" not in value
            else float("nan")
        )
    except ValueError as error:
        raise RefusedError(_("Please give a number.")) from error
    if not abs(number) < NUMBER_LIMIT:
        raise RefusedError(_("Please give a number."))
    return number


def plain(number: float) -> str:
    """Return a number without needless decimals."""
    return str(int(number)) if number == int(number) else str(number)


def response_statuses(
    definition: Definition,
    stored: Mapping[str, AnswerValue],
    circumstances: Circumstances,
    reached: int,
) -> dict[str, AnswerValue]:
    """Return how every question of a response stands, by key in written order: its value, or the
    reason why there is none.

    A question that was not asked is not applicable, whatever was said before an earlier answer
    changed. One that was asked without an answer was skipped, if its page was left behind.

    Args:
        definition: the questionnaire.
        stored: what is stored, by key.
        circumstances: robot and outcome.
        reached: how many pages were left behind; all of them once the response is finished.
    """
    values = {key: given.value for key, given in stored.items()}
    asked = set(shown_keys(definition, values, circumstances))
    return {
        question.key: _standing(question, stored.get(question.key), question.key in asked, reached)
        for question in definition.questions()
    }


def _standing(
    question: Question, given: AnswerValue | None, asked: bool, reached: int
) -> AnswerValue:
    if question.page >= reached and given is None:
        return AnswerValue(missing=Missing.NOT_REACHED)
    if not asked:
        return AnswerValue(missing=Missing.NOT_APPLICABLE)
    return given or AnswerValue(missing=Missing.SKIPPED)
