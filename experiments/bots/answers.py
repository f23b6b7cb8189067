"""How a bot fills in a form: every kind of question that there is, from the controls of its page
alone.
"""

import datetime
from collections.abc import Mapping

from experiments.bots.page import Field, Form
from experiments.bots.persona import Persona

BIRTH = ("birth", "geburt", "nacimiento")
AGE = ("age", "edad")
GUARDIAN = ("guardian", "tutor")
Sent = list[tuple[str, str]]


def fill(
    form: Form, persona: Persona, circumstances: Mapping[str, str], now: datetime.datetime
) -> Sent:
    """Return the fields of a form as a person would send them; buttons and hidden fields are the
    browser's.

    Who declines or leaves out does so by the persona's seed alone, and only where that may be done.
    """
    sent: Sent = []
    for asked in form.fields.values():
        if asked.name.endswith("~"):  # the reasons to decline, which belong to the question before
            continue
        sent += _answer(asked, persona, circumstances, now)
    return sent


def _answer(
    asked: Field, persona: Persona, circumstances: Mapping[str, str], now: datetime.datetime
) -> Sent:
    match asked.kind:
        case "radio":
            return _one_of(asked, persona, circumstances)
        case "select":
            options = [choice.value for choice in asked.choices if choice.value]
            return (
                [(asked.name, options[persona.option(asked.name, len(options))])] if options else []
            )
        case "checkbox":
            return _some_of(asked, persona)
        case "number" | "range":
            return [(asked.name, _number(asked, persona, circumstances, now))]
        case "date":
            return [(asked.name, _day(asked, persona, now))]
        case "text" | "textarea":
            return _words(asked, persona)
        case _:
            return [(asked.name, asked.value)] if asked.value else []


def _one_of(asked: Field, persona: Persona, circumstances: Mapping[str, str]) -> Sent:
    """Choose a point of a scale by opinion, an option by chance: a scale's values are numbers, in
    order.
    """
    values = [choice.value for choice in asked.choices if not choice.value.startswith("~")]
    if not values:
        return []
    if all(_is_whole(value) for value in values):
        values.sort(key=int)
        return [(asked.name, values[persona.point(asked.name, len(values), circumstances)])]
    return [(asked.name, values[persona.option(asked.name, len(values))])]


def _some_of(asked: Field, persona: Persona) -> Sent:
    if len(asked.choices) == 1:  # a box to tick: "I agree"
        return [(asked.name, asked.choices[0].value)]
    chosen = asked.choices[persona.option(asked.name, len(asked.choices))]
    second = asked.choices[persona.option(f"{asked.name}.second", len(asked.choices))]
    both = (
        [chosen]
        if chosen.alone or second.alone or second == chosen or persona.explore is not None
        else [chosen, second]
    )
    return [(asked.name, choice.value) for choice in both]


def _number(
    asked: Field, persona: Persona, circumstances: Mapping[str, str], now: datetime.datetime
) -> str:
    named = f"{asked.name} {asked.label}".lower()
    if any(word in named for word in BIRTH):
        return str(persona.birth_year)
    if any(word in named.split() or asked.name == word for word in AGE):
        return str(now.year - persona.birth_year)
    low = float(asked.attributes.get("min") or 0.0)
    high = float(asked.attributes.get("max") or low + 100.0)
    step = asked.attributes.get("step") or "1"
    value = persona.number_between(asked.name, low, high, circumstances)
    if step == "any":
        return f"{value:.2f}"
    whole = low + round((value - low) / float(step)) * float(step)
    return f"{min(high, whole):g}"


def _day(asked: Field, persona: Persona, now: datetime.datetime) -> str:
    latest = asked.attributes.get("max") or now.date().isoformat()
    earliest = (
        asked.attributes.get("min")
        or (datetime.date.fromisoformat(latest) - datetime.timedelta(days=365)).isoformat()
    )
    first, last = datetime.date.fromisoformat(earliest), datetime.date.fromisoformat(latest)
    return (
        first + datetime.timedelta(days=persona.option(asked.name, (last - first).days + 1))
    ).isoformat()


def _words(asked: Field, persona: Persona) -> Sent:
    longest = int(asked.attributes.get("maxlength") or 80)
    if any(word in asked.name for word in GUARDIAN) and not asked.required:
        return []
    text = f"Bot {persona.number} has nothing to add."[:longest]
    return [(asked.name, text)]


def _is_whole(value: str) -> bool:
    return value.lstrip("-").isdigit()
