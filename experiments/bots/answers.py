"""A bot's answers to a form: each control of its page as HTML has it, and the controls of some
types of questions together.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from itertools import groupby

from experiments.bots.page import FormField, HtmlForm
from experiments.bots.persona import Persona

BIRTH = ("birth", "geburt", "nacimiento")
AGE = ("age", "edad")
GUARDIAN = ("guardian", "tutor")
Sent = list[tuple[str, str]]


class UnknownControlError(Exception):
    """A control that no bot knows how to answer."""


def fill(form: HtmlForm, persona: Persona, circumstances: Mapping[str, str], now: datetime) -> Sent:
    """Return the fields of a form as a person would send them; the browser adds buttons and hidden
    fields. Raises an UnknownControlError for a control that no bot knows.
    """
    bot, sent = Answering(persona, circumstances, now), Sent()
    # the reasons to decline belong to the question before
    asked = [one for one in form.fields.values() if not one.name.endswith("~")]
    for (_question, kind), fields in groupby(asked, lambda one: (one.question, one.question_type)):
        if kind in BY_QUESTION_TYPE:
            sent += BY_QUESTION_TYPE[kind](list(fields), bot)
        else:
            sent += [pair for one in fields for pair in bot.answer(one)]
    return sent


@dataclass(frozen=True)
class Answering:
    """A bot that fills in a form, in the circumstances of its last drive."""

    persona: Persona
    circumstances: Mapping[str, str]
    now: datetime

    def answer(self, asked: FormField) -> Sent:
        """Return what answers one control; an UnknownControlError for a kind not in CONTROLS."""
        if asked.kind not in CONTROLS:
            raise UnknownControlError(f"{asked.name} is of the unknown kind {asked.kind!r}")
        return [(asked.name, value) for value in CONTROLS[asked.kind](asked, self)]


def _one_of(asked: FormField, bot: Answering) -> list[str]:
    """Choose a point of a scale (whose values are numbers) by opinion, any other at random."""
    values = [choice.value for choice in asked.choices if not choice.value.startswith("~")]
    if not values:
        return []
    if all(value.lstrip("-").isdigit() for value in values):
        values.sort(key=int)
        return [values[bot.persona.point(asked.name, len(values), bot.circumstances)]]
    return [values[bot.persona.option(asked.name, len(values))]]


def _listed(asked: FormField, bot: Answering) -> list[str]:
    options = [choice.value for choice in asked.choices if choice.value]
    return [options[bot.persona.option(asked.name, len(options))]] if options else []


def _some_of(asked: FormField, bot: Answering) -> list[str]:
    if len(asked.choices) == 1:  # a box to tick: "I agree"
        return [asked.choices[0].value]
    first = asked.choices[bot.persona.option(asked.name, len(asked.choices))]
    second = asked.choices[bot.persona.option(f"{asked.name}.second", len(asked.choices))]
    is_one = first.alone or second.alone or first == second or bot.persona.explore is not None
    return [first.value] if is_one else [first.value, second.value]


def _number(asked: FormField, bot: Answering) -> list[str]:
    named = f"{asked.name} {asked.label}".lower()
    if any(word in named for word in BIRTH):
        return [str(bot.persona.birth_year)]
    if any(word in named.split() or asked.name == word for word in AGE):
        return [str(bot.now.year - bot.persona.birth_year)]
    low = float(asked.attributes.get("min") or 0.0)
    high = float(asked.attributes.get("max") or low + 100.0)
    step = asked.attributes.get("step") or "1"
    value = bot.persona.number_between(asked.name, low, high, bot.circumstances)
    if step == "any":
        return [f"{value:.2f}"]
    whole = low + round((value - low) / float(step)) * float(step)
    return [f"{min(high, whole):g}"]


def _day(asked: FormField, bot: Answering) -> list[str]:
    day = date.fromisoformat
    latest, earliest = asked.attributes.get("max"), asked.attributes.get("min")
    last = day(latest) if latest else bot.now.date()
    first = day(earliest) if earliest else last - timedelta(days=365)
    days = bot.persona.option(asked.name, (last - first).days + 1)
    return [(first + timedelta(days=days)).isoformat()]


def _words(asked: FormField, bot: Answering) -> list[str]:
    if any(word in asked.name for word in GUARDIAN) and not asked.required:
        return []
    longest = int(asked.attributes.get("maxlength") or 80)
    return [f"Bot {bot.persona.number} has nothing to add."[:longest]]


# By the type of an input, or the name of another control.
CONTROLS: dict[str, Callable[[FormField, Answering], list[str]]] = {
    "radio": _one_of,
    "select": _listed,
    "checkbox": _some_of,
    "number": _number,
    "range": _number,
    "date": _day,
    "text": _words,
    "textarea": _words,
}


def _in_order(fields: Sequence[FormField], bot: Answering) -> Sent:
    """Give each option of a ranking a place: values are a place and an option, "2.a"."""
    (asked,) = fields
    sendable = (choice.value.partition(".") for choice in asked.choices if choice.value)
    left = list(dict.fromkeys(option for _place, _point, option in sendable))
    answer = []
    for place in range(1, len(left) + 1):
        option = left.pop(bot.persona.option(f"{asked.name}.{place}", len(left)))
        answer.append((asked.name, f"{place}.{option}"))
    return answer


# By the type of a question, for those that are not answered control by control.
BY_QUESTION_TYPE: dict[str, Callable[[Sequence[FormField], Answering], Sent]] = {
    "ranking": _in_order
}
