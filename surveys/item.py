"""The base classes of question types, whose methods are all that the rest of the site knows of a
type. A type is one file in surveys/questions/ with one subclass of `Item`, found by name.
"""

import datetime
import random
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import msgspec
from django.utils.formats import sanitize_separators
from django.utils.translation import gettext as _

from surveys import documents
from surveys.documents import DocumentPart, Key, Problem, Text, duplicates, gettext_noop, spoken

T = TypeVar("T")

OptionValue = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,39}$")]
Whole = Annotated[int, msgspec.Meta(ge=-10_000, le=10_000)]
Order = Literal["fixed", "shuffled"]
ScoringRule = Literal["likert", "topics", "sus", "tlx_raw"]
Scales = Mapping[str, "tuple[ScalePoint, ...]"]
Labelled = Sequence[tuple[str | int, Text]]
MAX_DIGITS = 30
NUMBER_LIMIT = 1e12
# Hours from UTC of the places where days begin last and first.
WESTERNMOST, EASTERNMOST = -12, 14


class RefusedError(ValueError):
    """An answer that its question does not allow; says why in the language of the page."""


class ItemCondition(DocumentPart, frozen=True, kw_only=True):
    """`show_if`: all that is set must hold; `is` and bounds compare the answer to `item`."""

    robot: tuple[str, ...] = ()
    outcome: tuple[str, ...] = ()
    item: str = ""
    one_of: tuple[str | int | float, ...] = msgspec.field(name="is", default=())
    at_least: float | None = None
    at_most: float | None = None

    @property
    def is_bounded(self) -> bool:
        return self.at_least is not None or self.at_most is not None


class ScalePoint(DocumentPart, frozen=True, kw_only=True):
    """One value of a scale. A scale may name only its ends."""

    value: Whole
    label: Text = {}


class Option(DocumentPart, frozen=True, kw_only=True):
    """One choice. `alone` excludes all others ("none of these")."""

    value: OptionValue
    label: Text
    alone: bool = False


class Row(DocumentPart, frozen=True, kw_only=True):
    """A row of a grid, a question of its own; `reverse`: scored from the other end of the scale."""

    key: Key
    text: Text
    reverse: bool = False


@dataclass(frozen=True)
class Choice:
    """One thing to tick. `value` is what the page sends."""

    value: str
    label: str
    is_chosen: bool = False
    number: str = ""
    is_alone: bool = False


@dataclass(frozen=True)
class Viewing:
    """For whom a question is drawn, and when; `seed` is that of the order."""

    language: str
    seed: int
    now: datetime.datetime


@dataclass(frozen=True)
class Widget:
    """The control of a type, drawn with `template`. `style` names its class in CSS, `value` is the
    text of its one input (`has_one_input`: its label is the question's text), `attributes` are
    those of the input by their names in HTML, `more` is only for its own template.
    """

    template: str
    style: str
    value: str = ""
    choices: tuple[Choice, ...] = ()
    attributes: Mapping[str, str] = field(default_factory=dict)
    more: Mapping[str, Any] = field(default_factory=dict)
    has_one_input: bool = False
    is_scale: bool = False


class Item(DocumentPart, frozen=True, kw_only=True, tag_field="kind"):
    """The base of all items. The defaults are those of a question with one input on the page and
    one value in the answer. `prefer_not` and `not_applicable` offer reasons for not answering; an
    optional item may also be left empty.
    """

    # What the editor calls it (empty: the name of the type), and the labels and hints of the fields
    # that only this type has.
    plain_name: ClassVar[Any] = ""
    labels: ClassVar[Mapping[str, Any]] = {}
    hints: ClassVar[Mapping[str, Any]] = {}
    # One value of several is sent for the question; else a second one is refused.
    takes_several: ClassVar[bool] = False
    # A reason for no answer is one of the choices, sent in the same field; else it is beside them.
    has_reason_choices: ClassVar[bool] = False
    # Its text may begin with the mark of a reason, and may identify the respondent: exports leave
    # it out unless requested.
    is_free_text: ClassVar[bool] = False
    # `show_if` may compare its answer with bounds.
    is_number: ClassVar[bool] = False
    # Its text and hint are shown above several questions, which have keys of their own.
    is_group: ClassVar[bool] = False
    # The rules of scoring that take its answers.
    scored_by: ClassVar[Collection[ScoringRule]] = ()

    key: Key
    text: Text
    hint: Text = {}
    required: bool = False
    prefer_not: bool = False
    not_applicable: bool = False
    show_if: ItemCondition | None = None

    @property
    def kind(self) -> str:
        return str(self.__struct_config__.tag)

    def rows_asked(self, seed: int | None = None) -> Sequence[Row | None]:
        """Return its questions in the order of a seed, or as written; None is the item itself."""
        return (None,)

    def keys_asked(self, seed: int | None = None) -> list[str]:
        return [self.key if row is None else row.key for row in self.rows_asked(seed)]

    def points(self, scales: Scales) -> tuple[ScalePoint, ...]:
        """Return the points of its scale; none without one, or when there is none of its name."""
        return ()

    def problems(self, scales: Scales) -> Iterator[Problem]:
        """Yield its problems, except those of types and texts."""
        yield from ()

    def parse(self, question: "Question", values: Sequence[str], now: datetime.datetime) -> Any:
        """Return the value to be stored (int, float, str, list of str) for the values that the page
        sent, of which none is empty. Raises RefusedError when the question does not allow it.
        """
        raise NotImplementedError

    def sent(self, value: Any) -> list[str]:
        if isinstance(value, list):
            return list(value)
        return [plain(value) if isinstance(value, float) else str(value)]

    def labelled_values(self, points: Sequence[ScalePoint]) -> Labelled:
        """Return all values that tables count and `show_if` may expect; none where not listed."""
        return ()

    def compared(self, value: Any) -> Any:
        """Return what `show_if` compares and tables count; each part of a list counts."""
        return value

    def score_values(self, points: Sequence[ScalePoint]) -> Sequence[int]:
        """Return the numbers that an answer can be, rising, where a score takes them."""
        return ()

    def ends(self, points: Sequence[ScalePoint]) -> tuple[Text, Text]:
        """Return the labels of the least and the greatest number on the page."""
        return {}, {}

    def columns(self, key: str) -> Mapping[str, Text]:
        """Return the columns in tables with a line a response, with labels among several."""
        return {key: {}}

    def cells(self, value: Any) -> tuple[Any, ...]:
        """Return the cells of these columns for a stored value; None is no answer."""
        return ("" if value is None else one_cell(value),)

    def widget(self, question: "Question", chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return what the page draws; `chosen` is what the page would send now."""
        raise NotImplementedError

    def entry(
        self, chosen: Sequence[str], attributes: Mapping[str, Any], template: str = "", **more: Any
    ) -> Widget:
        """Return a widget that is one input; attributes that are None are left out."""
        given = {name: str(one) for name, one in attributes.items() if one is not None}
        template, value = template or "surveys/_entry.html", chosen[0] if chosen else ""
        return Widget(template, self.kind, value, (), given, more, has_one_input=True)


class ScaleItem(Item, frozen=True, kw_only=True):
    has_reason_choices: ClassVar[bool] = True
    is_number: ClassVar[bool] = True
    scored_by: ClassVar[Collection[ScoringRule]] = ("likert", "topics", "sus")

    scale: str

    def points(self, scales: Scales) -> tuple[ScalePoint, ...]:
        return scales.get(self.scale, ())

    def problems(self, scales: Scales) -> Iterator[Problem]:
        if not self.points(scales):
            yield Problem(gettext_noop("Choose a scale."), names=(("scale", self.scale),))

    def parse(self, question: "Question", values: Sequence[str], now: datetime.datetime) -> int:
        return one_of({str(point.value): point.value for point in question.points}, values[0])

    def labelled_values(self, points: Sequence[ScalePoint]) -> Labelled:
        return [(point.value, point.label) for point in points]

    def score_values(self, points: Sequence[ScalePoint]) -> Sequence[int]:
        return [point.value for point in points]

    def ends(self, points: Sequence[ScalePoint]) -> tuple[Text, Text]:
        return (points[0].label, points[-1].label) if points else ({}, {})

    def widget(self, question: "Question", chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return the points as a line of choices; with numbers where not all have a label."""
        labels = {str(one.value): spoken(one.label, viewing.language) for one in question.points}
        named = all(labels.values())
        words = ((value, label, "" if named else value) for value, label in labels.items())
        choices = tuple(Choice(one, label, one in chosen, number) for one, label, number in words)
        return Widget("surveys/_choices.html", "scale", choices=choices, is_scale=True)


class OptionsItem(Item, frozen=True, kw_only=True):
    options: tuple[Option, ...]
    order: Order = "fixed"

    def problems(self, scales: Scales) -> Iterator[Problem]:
        if not self.options:
            yield Problem(gettext_noop("There are no options; add some."))
        yield from duplicates(gettext_noop("Option"), (option.value for option in self.options))

    def options_shown(self, seed: int) -> list[Option]:
        """Return the options in the order shown; those that exclude all others stay at the end."""
        usual = [option for option in self.options if not option.alone]
        alone = [option for option in self.options if option.alone]
        return ordered(usual, self.order, seed, f"options {self.key}") + alone

    def labelled_values(self, points: Sequence[ScalePoint]) -> Labelled:
        return [(option.value, option.label) for option in self.options]

    def widget(self, question: "Question", chosen: Sequence[str], viewing: Viewing) -> Widget:
        language = viewing.language
        choices = (
            Choice(one.value, spoken(one.label, language), one.value in chosen, is_alone=one.alone)
            for one in self.options_shown(viewing.seed)
        )
        return Widget("surveys/_choices.html", self.kind, choices=tuple(choices))


@dataclass(frozen=True)
class Question:
    """An item or a row of a grid; `page` counts from 0, `points` is empty without a scale."""

    page: int
    item: Item
    row: Row | None
    points: tuple[ScalePoint, ...]

    @property
    def key(self) -> str:
        """The name under which its answer is stored."""
        return self.item.key if self.row is None else self.row.key

    @property
    def text(self) -> Text:
        return self.item.text if self.row is None else self.row.text

    @cached_property
    def labelled_values(self) -> Labelled:
        return self.item.labelled_values(self.points)

    @property
    def score_values(self) -> Sequence[int]:
        return self.item.score_values(self.points)

    @property
    def ends(self) -> tuple[Text, Text]:
        return self.item.ends(self.points)

    @property
    def is_reversed(self) -> bool:
        return bool(getattr(self.row or self.item, "reverse", False))

    def from_other_end(self, value: float) -> float:
        """Return an answer counted from the other end of its scale: least + greatest - value."""
        return self.score_values[0] + self.score_values[-1] - value

    def fingerprint(self, language: str) -> str:
        """Return 12 hexadecimal digits that change with any of its texts in a language. They are
        stored with answers: the order of the texts must stay.
        """
        own = [self.item.text, self.text, self.item.hint, *(point.label for point in self.points)]
        for one in documents.fields_of(type(self.item)):
            value = getattr(self.item, one.name)
            if one.type == Text and one.name not in {"text", "hint"}:
                own.append(value)
            elif one.name == "options":
                own += [option.label for option in value]
        return sha256("\x1f".join(text.get(language, "") for text in own).encode()).hexdigest()[:12]


def ordered(things: Iterable[T], order: Order, seed: int, name: str) -> list[T]:
    """Return things as written, or shuffled by the seed that is stored with a response.

    Each list has a generator of its own, so that a new page or option elsewhere changes no other
    order. `random.Random(text)` and `shuffle` give the same on every version of Python since 3.2.
    """
    arranged = list(things)
    if order == "shuffled":
        random.Random(f"{seed}:{name}").shuffle(arranged)
    return arranged


def one_cell(value: Any) -> Any:
    """Return a stored value as one cell of a table; several have bars between them."""
    return "|".join(value) if isinstance(value, list) else value


def one_of(choices: Mapping[str, T], value: str) -> T:
    """Return the choice for a sent value; raises RefusedError when there is none."""
    if value not in choices:
        raise RefusedError(_("Choose one of the options offered."))
    return choices[value]


def parsed_number(value: str) -> float:
    """Return a number with a point or local decimal mark; raises RefusedError for others."""
    number = float("nan")
    try:
        if len(value) <= MAX_DIGITS and "_" not in value:
            number = float(sanitize_separators(value))
    except ValueError as error:
        if "," in value:
            raise RefusedError(_("Use a decimal point and no comma: 0.6, or 1000.")) from error
    if not abs(number) < NUMBER_LIMIT:
        raise RefusedError(_("Enter a number."))
    return number


def plain(number: float) -> str:
    return str(int(number)) if number == int(number) else str(number)


def day_at(now: datetime.datetime, hours: int) -> datetime.date:
    return now.astimezone(datetime.timezone(datetime.timedelta(hours=hours))).date()
