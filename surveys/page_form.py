"""One page of a questionnaire as the template draws it: words in one language, controls with their
state, in the order shown.
"""

import datetime
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from django.utils.translation import gettext as _

from surveys.answers import REASON_MARK, AnswerValue, Missing
from surveys.conditions import Circumstances, circumstances_fit, shown_keys
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.item import Choice, Item, ItemCondition, Question, Viewing, Widget


@dataclass(frozen=True)
class Control:
    """The control of one question: what every type shows, and the `widget` of its own."""

    key: str
    kind: str
    text: str
    widget: Widget
    hint: str = ""
    error: str = ""
    is_required: bool = False
    is_shown: bool = True
    takes_several: bool = False
    has_reason_choices: bool = False
    reasons: tuple[Choice, ...] = ()
    show_if: str = ""

    @property
    def choices(self) -> tuple[Choice, ...]:
        """What can be ticked."""
        return self.widget.choices

    @property
    def has_plain_scale(self) -> bool:
        """Whether only the ends of its scale have names, so that it stays in one
        line on a phone.
        """
        return self.widget.is_scale and not all(choice.label for choice in self.choices)

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
        return self.controls[0].widget.is_scale

    @property
    def is_shown(self) -> bool:
        """Whether any of it can be seen."""
        return any(control.is_shown for control in self.controls)


@dataclass(frozen=True)
class PageForm:
    """A page. `number` and `total` count from 1 the pages on which anything is asked."""

    title: str
    intro: str
    fieldsets: tuple[Fieldset, ...]
    number: int
    total: int

    @property
    def controls(self) -> list[Control]:
        """All questions of the page."""
        return [control for fieldset in self.fieldsets for control in fieldset.controls]

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
    fieldsets = [
        _fieldset(item, here, asked, reader)
        for item in definition.pages[page].items_shown(reader.seed)
    ]
    own = definition.pages[page]
    return PageForm(
        title=spoken(own.title, reader.language),
        intro=spoken(own.intro, reader.language),
        fieldsets=tuple(_joined([one for one in fieldsets if one is not None], definition)),
        number=1 + sum(n < page for n in shown_pages),
        total=len(shown_pages),
    )


def _fieldset(item: Item, here: list[Question], asked: set[str], reader: Reader) -> Fieldset | None:
    """Return the frame of one item; None when no answer on this page could make it appear, or when
    a draft has no rows in it yet.
    """
    questions = {question.key: question for question in here if question.item.key == item.key}
    around = {question.key for question in here}
    is_asked = questions.keys() & asked or _may_appear(item.show_if, around, reader)
    if not (questions and is_asked):
        return None
    keys = [item.key if row is None else row.key for row in item.rows_shown(reader.seed)]
    controls = tuple(
        _control(questions[key], key in asked, _condition_here(item.show_if, here), reader)
        for key in keys
    )
    return Fieldset(
        spoken(item.text, reader.language) if item.is_group else "",
        spoken(item.hint, reader.language) if item.is_group else "",
        controls,
    )


def _may_appear(condition: ItemCondition | None, here: set[str], reader: Reader) -> bool:
    return (
        condition is not None
        and condition.item in here
        and circumstances_fit(condition, reader.circumstances)
    )


def _condition_here(condition: ItemCondition | None, here: list[Question]) -> str:
    """Return the part of a condition that the page itself can follow, as JSON;
    empty without one.
    """
    asked = {question.key: question.item for question in here}
    if condition is None or condition.item not in asked:
        return ""
    return json.dumps(
        {
            "item": condition.item,
            "is": [asked[condition.item].expected(value) for value in condition.one_of],
            "at_least": condition.at_least,
            "at_most": condition.at_most,
        }
    )


def _joined(fieldsets: list[Fieldset], definition: Definition) -> list[Fieldset]:
    """Put statements that follow each other on the same scale into one frame."""
    joined: list[Fieldset] = []
    for fieldset in fieldsets:
        before = joined[-1] if joined else None
        if before is not None and _can_join(before, fieldset, definition):
            joined[-1] = Fieldset("", "", before.controls + fieldset.controls)
        else:
            joined.append(fieldset)
    return joined


def _can_join(before: Fieldset, fieldset: Fieldset, definition: Definition) -> bool:
    one, other = (definition.question(part.controls[-1].key) for part in (before, fieldset))
    return one is not None and other is not None and other.item.joins(one.item)


def _control(question: Question, shown: bool, condition: str, reader: Reader) -> Control:
    item = question.item
    sent = [value for value in item.values_sent(question.key, reader.sent) if value]
    return Control(
        key=question.key,
        kind=item.kind,
        text=spoken(question.text, reader.language),
        widget=item.widget(
            question,
            sent or _stored(question, reader),
            Viewing(reader.language, reader.seed, reader.now),
        ),
        hint="" if item.is_group else spoken(item.hint, reader.language),
        error=reader.errors.get(question.key, ""),
        is_required=item.required,
        is_shown=shown,
        takes_several=item.takes_several,
        has_reason_choices=item.has_reason_choices,
        reasons=_reasons(
            item, reader.stored.get(question.key), reader.sent.get(question.key + REASON_MARK, ())
        ),
        show_if=condition,
    )


def _stored(question: Question, reader: Reader) -> list[str]:
    """Return what is stored, as the page would send it."""
    value = reader.stored.get(question.key, AnswerValue()).value
    return [] if value is None else question.item.sent(value)


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
