"""One page of a questionnaire as the template draws it: words in one language, controls with their
state, in the order shown.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from django.utils.translation import gettext as _

from surveys.answers import REASON_MARK, AnswerValue, Missing, Stored, asked_keys
from surveys.conditions import Circumstances
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.item import Choice, Item, ItemCondition, Question, ScaleItem, Viewing, Widget


@dataclass(frozen=True)
class Control:
    """The control of one question: what every type shows, and the `widget` of its own."""

    key: str
    item: Item
    text: str
    widget: Widget
    hint: str
    error: str
    is_shown: bool
    reasons: tuple[Choice, ...]
    show_if: str

    @property
    def has_plain_scale(self) -> bool:
        """Whether only the ends of its scale have names, so that a phone shows it in one line."""
        return self.widget.is_scale and not all(choice.label for choice in self.widget.choices)


@dataclass(frozen=True)
class Fieldset:
    """Questions in one frame: a matrix of those on one `scale`, or one question of another kind."""

    heading: str
    hint: str
    controls: tuple[Control, ...]
    scale: str | None  # shared with the questions of the next frame, if it has the same one

    @property
    def is_shown(self) -> bool:
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
        return [control for fieldset in self.fieldsets for control in fieldset.controls]

    @property
    def is_all_optional(self) -> bool:
        """Whether the page says once that nothing must be answered, instead of at each question."""
        return not any(control.item.required for control in self.controls)

    @property
    def wrong(self) -> list[Control]:
        return [control for control in self.controls if control.error]


@dataclass(frozen=True)
class Reader(Viewing):
    """The page's reader: stored and just sent answers, and errors; a preview `sees_all`."""

    stored: Stored = field(default_factory=dict)
    circumstances: Circumstances = field(default_factory=Circumstances)
    errors: Mapping[str, str] = field(default_factory=dict)
    sent: Mapping[str, Sequence[str]] = field(default_factory=dict)
    sees_all: bool = False


def page_form_of(
    definition: Definition, page: int, reader: Reader, shown_pages: Sequence[int]
) -> PageForm:
    """Return page `page` (from 0) for a reader. `shown_pages` are the pages on which this reader is
    asked anything, for "page 2 of 3".
    """
    shown = asked_keys(definition, reader.stored, reader.circumstances)
    asked = set(definition.by_key if reader.sees_all else shown)
    own = definition.pages[page]
    here = {key: one for key, one in definition.by_key.items() if one.page == page}
    fieldsets: list[Fieldset] = []
    for item in own.items_shown(reader.seed):
        fieldset = _fieldset(item, here, asked, reader)
        if fieldset is None:
            continue
        if fieldsets and fieldset.scale is not None and fieldsets[-1].scale == fieldset.scale:
            fieldset = replace(fieldset, controls=fieldsets.pop().controls + fieldset.controls)
        fieldsets.append(fieldset)
    title, intro = (spoken(text, reader.language) for text in (own.title, own.intro))
    number = 1 + sum(n < page for n in shown_pages)
    return PageForm(title, intro, tuple(fieldsets), number, total=len(shown_pages))


def _fieldset(
    item: Item, here: Mapping[str, Question], asked: set[str], reader: Reader
) -> Fieldset | None:
    """Return the frame of an item; None if no answer here can show it, or it has no rows yet."""
    questions = [here[key] for key in item.keys_asked(reader.seed) if key in here]
    condition = item.show_if if item.show_if and item.show_if.item in here else None
    may_appear = condition is not None and reader.circumstances.fit(condition)
    if not questions or not (may_appear or any(one.key in asked for one in questions)):
        return None
    show_if = _condition_here(condition, here) if condition is not None else ""
    controls = tuple(_control(one, one.key in asked, show_if, reader) for one in questions)
    if item.is_group:
        heading, hint = (spoken(text, reader.language) for text in (item.text, item.hint))
        return Fieldset(heading, hint, controls, scale=None)
    return Fieldset("", "", controls, item.scale if isinstance(item, ScaleItem) else None)


def _condition_here(condition: ItemCondition, here: Mapping[str, Question]) -> str:
    """Return the part of a condition that the page can follow, as JSON of sent answers."""
    item = here[condition.item].item
    values = [item.sent([one])[0] if item.takes_several else one for one in condition.one_of]
    bounds = {"at_least": condition.at_least, "at_most": condition.at_most}
    return json.dumps({"item": condition.item, "is": values, **bounds})


def _control(question: Question, shown: bool, condition: str, reader: Reader) -> Control:
    item, key = question.item, question.key
    given = reader.stored.get(key, AnswerValue())
    stored = [] if given.value is None else item.sent(given.value)
    chosen = [value for value in reader.sent.get(key, ()) if value] or stored
    reasons: Sequence[str | None] = reader.sent.get(key + REASON_MARK) or [given.missing]
    offered = [(Missing.PREFERRED_NOT, _("Prefer not to answer"))] if item.prefer_not else []
    offered += [(Missing.NOT_APPLICABLE, _("Does not apply"))] if item.not_applicable else []
    return Control(
        *(key, item, spoken(question.text, reader.language)),
        widget=item.widget(question, chosen, reader),
        hint="" if item.is_group else spoken(item.hint, reader.language),
        error=reader.errors.get(key, ""),
        is_shown=shown,
        reasons=tuple(Choice(value, label, value in reasons) for value, label in offered),
        show_if=condition,
    )
