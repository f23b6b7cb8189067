"""One page of a questionnaire as the template draws it: words in one language, controls with their
state, in the order shown.
"""

import datetime
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from django.utils.translation import gettext as _

from surveys.answers import REASON_MARK, AnswerValue, Missing, days_between, greatest_number, plain
from surveys.conditions import Circumstances, circumstances_fit, shown_keys
from surveys.definition import (
    Condition,
    Date,
    Definition,
    Grid,
    Item,
    Likert,
    Multiple,
    Number,
    Question,
    Single,
    Slider,
    TextItem,
    spoken,
)
from surveys.layout import items_of, options_of, rows_of


@dataclass(frozen=True)
class Choice:
    """One thing to tick. `value` is what the page sends."""

    value: str
    label: str
    is_chosen: bool = False
    number: str = ""
    is_alone: bool = False


@dataclass(frozen=True)
class Control:
    """The control of one question. `kind` is a definition's kind, with `scale` for every question
    on a scale.
    """

    key: str
    kind: str
    text: str
    hint: str = ""
    error: str = ""
    is_required: bool = False
    is_shown: bool = True
    choices: tuple[Choice, ...] = ()
    reasons: tuple[Choice, ...] = ()
    value: str = ""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    low: str = ""
    high: str = ""
    unit: str = ""
    show_if: str = ""

    @property
    def has_plain_scale(self) -> bool:
        """Whether only the ends of its scale have names, so that it stays in one
        line on a phone.
        """
        return self.kind == "scale" and not all(choice.label for choice in self.choices)

    @property
    def first_label(self) -> str:
        """The name of the scale's low end."""
        return self.choices[0].label

    @property
    def last_label(self) -> str:
        """The name of the scale's high end."""
        return self.choices[-1].label

    @property
    def described_by(self) -> str:
        """The ids of hint and error, for aria-describedby; the page may put an
        error there later.
        """
        return " ".join(
            f"q-{self.key}-{name}" for name in ("hint", "error") if name == "error" or self.hint
        )


@dataclass(frozen=True)
class Fieldset:
    """Questions in one frame: a matrix of those on one scale, or one question of another kind."""

    heading: str
    hint: str
    controls: tuple[Control, ...]

    @property
    def is_matrix(self) -> bool:
        """Whether its rows share a scale."""
        return self.controls[0].kind == "scale"

    @property
    def is_shown(self) -> bool:
        """Whether any of it can be seen."""
        return any(control.is_shown for control in self.controls)


@dataclass(frozen=True)
class PageForm:
    """A page. `number` and `total` count from 1 the pages on which anything is asked."""

    title: str
    intro: str
    blocks: tuple[Fieldset, ...]
    number: int
    total: int

    @property
    def controls(self) -> list[Control]:
        """All questions of the page."""
        return [control for block in self.blocks for control in block.controls]

    @property
    def is_all_optional(self) -> bool:
        """Whether the page says once that nothing must be answered, instead of at each question."""
        return not any(control.is_required for control in self.controls)

    @property
    def wrong(self) -> list[Control]:
        """Those with an error."""
        return [control for control in self.controls if control.error]


@dataclass(frozen=True)
class Reader:
    """Who looks at the page: language, seed of the order, what they said so far, what they just
    sent, and when. A preview sees all.
    """

    language: str
    seed: int
    stored: Mapping[str, AnswerValue]
    circumstances: Circumstances
    now: datetime.datetime
    errors: Mapping[str, str] = field(default_factory=dict)
    sent: Mapping[str, Sequence[str]] = field(default_factory=dict)
    sees_all: bool = False


def page_form_of(
    definition: Definition, page: int, reader: Reader, shown_pages: Sequence[int]
) -> PageForm:
    """Return a page as somebody sees it.

    Args:
        definition: the questionnaire.
        page: which page, from 0.
        reader: for whom.
        shown_pages: the pages on which they are asked anything, for "page 2 of 3".
    """
    values = {key: given.value for key, given in reader.stored.items()}
    asked = (
        {question.key for question in definition.questions()}
        if reader.sees_all
        else set(shown_keys(definition, values, reader.circumstances))
    )
    here = [question for question in definition.questions() if question.page == page]
    blocks = [
        _block(item, here, asked, reader) for item in items_of(definition.pages[page], reader.seed)
    ]
    own = definition.pages[page]
    return PageForm(
        title=spoken(own.title, reader.language),
        intro=spoken(own.intro, reader.language),
        blocks=tuple(_joined([block for block in blocks if block is not None], definition)),
        number=1 + sum(n < page for n in shown_pages),
        total=len(shown_pages),
    )


def _block(item: Any, here: list[Question], asked: set[str], reader: Reader) -> Fieldset | None:
    """Return the frame of one item; None when no answer on this page could make it appear."""
    questions = {question.key: question for question in here if question.item.key == item.key}
    if not questions.keys() & asked and not _may_appear(
        item.show_if, {question.key for question in here}, reader
    ):
        return None
    keys = [row.key for row in rows_of(item, reader.seed)] if isinstance(item, Grid) else [item.key]
    controls = tuple(
        _control(questions[key], key in asked, _condition_here(item.show_if, here), reader)
        for key in keys
    )
    is_grid = isinstance(item, Grid)
    return Fieldset(
        spoken(item.text, reader.language) if is_grid else "",
        spoken(item.hint, reader.language) if is_grid else "",
        controls,
    )


def _may_appear(condition: Condition | None, here: set[str], reader: Reader) -> bool:
    return (
        condition is not None
        and condition.item in here
        and circumstances_fit(condition, reader.circumstances)
    )


def _condition_here(condition: Condition | None, here: list[Question]) -> str:
    """Return the part of a condition that the page itself can follow, as JSON;
    empty without one.
    """
    if condition is None or condition.item not in {question.key for question in here}:
        return ""
    return json.dumps(
        {
            "item": condition.item,
            "is": list(condition.one_of),
            "at_least": condition.at_least,
            "at_most": condition.at_most,
        }
    )


def _joined(blocks: list[Fieldset], definition: Definition) -> list[Fieldset]:
    """Put statements that follow each other on the same scale into one frame."""
    joined: list[Fieldset] = []
    for block in blocks:
        before = joined[-1] if joined else None
        if before is not None and _can_join(before, block, definition):
            joined[-1] = Fieldset("", "", before.controls + block.controls)
        else:
            joined.append(block)
    return joined


def _can_join(before: Fieldset, block: Fieldset, definition: Definition) -> bool:
    scales = []
    for part in (before, block):
        question = definition.question(part.controls[-1].key)
        if question is None or not isinstance(question.item, Likert):
            return False
        scales.append(question.item.scale)
    return scales[0] == scales[1]


def _control(question: Question, shown: bool, condition: str, reader: Reader) -> Control:
    item, said = question.item, _said(question, reader)
    sent = [value for value in reader.sent.get(question.key, ()) if value]
    chosen = sent or said
    return Control(
        key=question.key,
        kind="scale" if question.points else item.kind,
        text=spoken(question.text, reader.language),
        hint="" if isinstance(item, Grid) else spoken(item.hint, reader.language),
        error=reader.errors.get(question.key, ""),
        is_required=item.required,
        is_shown=shown,
        choices=_choices(question, chosen, reader),
        reasons=_reasons(
            item, reader.stored.get(question.key), reader.sent.get(question.key + REASON_MARK, ())
        ),
        value=chosen[0] if chosen and isinstance(item, Number | TextItem | Date | Slider) else "",
        attributes=_attributes(item, reader),
        low=spoken(item.low, reader.language) if isinstance(item, Slider) else "",
        high=spoken(item.high, reader.language) if isinstance(item, Slider) else "",
        unit=spoken(item.unit, reader.language) if isinstance(item, Number) else "",
        show_if=condition,
    )


def _said(question: Question, reader: Reader) -> list[str]:
    """Return what is stored, as the page would send it."""
    value = reader.stored.get(question.key, AnswerValue()).value
    if value is None:
        return []
    if isinstance(value, list):
        return value
    return [plain(value) if isinstance(value, int | float) else str(value)]


def _choices(question: Question, chosen: list[str], reader: Reader) -> tuple[Choice, ...]:
    item = question.item
    if question.points:
        named = all(spoken(point.label, reader.language) for point in question.points)
        return tuple(
            Choice(
                str(p.value),
                spoken(p.label, reader.language),
                str(p.value) in chosen,
                number="" if named else str(p.value),
            )
            for p in question.points
        )
    if isinstance(item, Single | Multiple):
        options = options_of(item, reader.seed)
        return tuple(
            Choice(o.value, spoken(o.label, reader.language), o.value in chosen, is_alone=o.alone)
            for o in options
        )
    return ()


def _reasons(item: Item, given: AnswerValue | None, sent: Sequence[str]) -> tuple[Choice, ...]:
    offered = [
        (Missing.PREFERRED_NOT.value, _("Prefer not to answer"), item.prefer_not),
        (Missing.NOT_APPLICABLE.value, _("Does not apply"), item.not_applicable),
    ]
    stored = given.missing if given is not None else None
    return tuple(
        Choice(value, label, value in sent or (not sent and stored == value))
        for value, label, allowed in offered
        if allowed
    )


def _attributes(item: Item, reader: Reader) -> dict[str, Any]:
    """Return the attributes of the control, by their names in HTML."""
    if isinstance(item, Number):
        greatest = greatest_number(item, reader.now)
        bounds = {"min": item.minimum, "max": greatest}
        numbers = {name: plain(bound) for name, bound in bounds.items() if bound is not None}
        return {
            "step": "1" if item.whole else "any",
            "inputmode": "numeric" if item.whole else "decimal",
            **numbers,
        }
    if isinstance(item, Slider):
        return {
            "min": str(item.minimum),
            "max": str(item.maximum),
            "step": str(item.step),
            "inputmode": "numeric",
        }
    if isinstance(item, Date):
        days = dict(zip(("min", "max"), days_between(item, reader.now), strict=True))
        return {name: day.isoformat() for name, day in days.items() if day is not None}
    return (
        {"maxlength": str(item.max_length), "rows": str(item.lines)}
        if isinstance(item, TextItem)
        else {}
    )
