"""A questionnaire as it is written: version 1 of the JSON format, one class a kind of thing.

A text is an object of languages, `{"en": "…", "es": "…"}`. What takes one answer is a *question*:
an item, or one row of a grid. Every question has a key of its own, under which its answer is stored
for good. The classes refuse unknown fields and wrong types; surveys/problems.py tells what types
cannot.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from robots.api.prepared import prepare

Text = dict[str, str]
Key = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Slug = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9-]{0,39}$")]
Language = Annotated[str, msgspec.Meta(pattern=r"^[a-z]{2,3}(-[a-z0-9]{2,8})*$", max_length=16)]
OptionValue = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,39}$")]
Whole = Annotated[int, msgspec.Meta(ge=-10_000, le=10_000)]
Order = Literal["fixed", "shuffled"]
Day = Annotated[str, msgspec.Meta(pattern=r"^(today|\d{4}-\d{2}-\d{2})$")]
Scoring = Literal["none", "likert", "sus", "tlx_raw"]


class Part(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """Any part of a definition."""


class Condition(Part, frozen=True, kw_only=True):
    """`show_if`: all that is given must hold. `is` and the bounds ask the answer of the earlier
    question `item`.
    """

    robot: tuple[str, ...] = ()
    outcome: tuple[str, ...] = ()
    item: str = ""
    one_of: tuple[str | int | float, ...] = msgspec.field(name="is", default=())
    at_least: float | None = None
    at_most: float | None = None


class Point(Part, frozen=True, kw_only=True):
    """One value of a scale. A scale may name only its ends."""

    value: Whole
    label: Text = {}


class Option(Part, frozen=True, kw_only=True):
    """One choice. `alone` excludes all others ("none of these")."""

    value: OptionValue
    label: Text
    alone: bool = False


class Row(Part, frozen=True, kw_only=True):
    """A row of a grid: a question of its own."""

    key: Key
    text: Text


class Item(Part, frozen=True, kw_only=True):
    """What every item says. Who may decline says so here; an optional item may
    also be left empty.
    """

    kind: ClassVar[str]
    key: Key
    text: Text
    hint: Text = {}
    required: bool = False
    prefer_not: bool = False
    not_applicable: bool = False
    show_if: Condition | None = None


class Likert(Item, frozen=True, kw_only=True, tag_field="kind", tag="likert"):
    """A statement and a scale."""

    kind: ClassVar[str] = "likert"
    scale: str


class Grid(Item, frozen=True, kw_only=True, tag_field="kind", tag="grid"):
    """Several rows on one scale."""

    kind: ClassVar[str] = "grid"
    scale: str
    rows: tuple[Row, ...]
    order: Order = "fixed"


class Single(Item, frozen=True, kw_only=True, tag_field="kind", tag="single"):
    """One of several options."""

    kind: ClassVar[str] = "single"
    options: tuple[Option, ...]
    order: Order = "fixed"


class Multiple(Item, frozen=True, kw_only=True, tag_field="kind", tag="multiple"):
    """Any of several options, within a count."""

    kind: ClassVar[str] = "multiple"
    options: tuple[Option, ...]
    order: Order = "fixed"
    at_least: int = 0
    at_most: int | None = None


class Number(Item, frozen=True, kw_only=True, tag_field="kind", tag="number"):
    """A number within bounds; `this_year` is the year in which it is asked."""

    kind: ClassVar[str] = "number"
    minimum: float | None = None
    maximum: float | Literal["this_year"] | None = None
    whole: bool = False
    unit: Text = {}


class TextItem(Item, frozen=True, kw_only=True, tag_field="kind", tag="text"):
    """Free text."""

    kind: ClassVar[str] = "text"
    lines: Annotated[int, msgspec.Meta(ge=1, le=20)] = 1
    max_length: Annotated[int, msgspec.Meta(ge=1, le=5000)] = 1000


class Date(Item, frozen=True, kw_only=True, tag_field="kind", tag="date"):
    """A day, within bounds."""

    kind: ClassVar[str] = "date"
    earliest: Day | None = None
    latest: Day | None = None


class Slider(Item, frozen=True, kw_only=True, tag_field="kind", tag="slider"):
    """A whole number between two named ends; 0 to 100 unless it says otherwise."""

    kind: ClassVar[str] = "slider"
    minimum: Whole = 0
    maximum: Whole = 100
    step: Annotated[int, msgspec.Meta(ge=1)] = 1
    low: Text
    high: Text


AnyItem = Likert | Grid | Single | Multiple | Number | TextItem | Date | Slider


class Page(Part, frozen=True, kw_only=True):
    """What is on the screen at once."""

    key: Key
    title: Text = {}
    intro: Text = {}
    order: Order = "fixed"
    show_if: Condition | None = None
    items: tuple[AnyItem, ...]


class Topic(Part, frozen=True, kw_only=True):
    """Questions that are reported together."""

    key: Key
    text: Text
    items: tuple[str, ...]


class Definition(Part, frozen=True, kw_only=True, dict=True):
    """A whole questionnaire. A `template` holds the structure of one whose text may not be shipped:
    it can be filled in, not used.
    """

    format: Literal[1]
    slug: Slug
    version: Annotated[int, msgspec.Meta(ge=1, le=9999)]
    title: Text
    intro: Text = {}
    source: str = ""
    licence: str = ""
    template: bool = False
    languages: tuple[Language, ...]
    scales: dict[Key, tuple[Point, ...]] = {}
    pages: tuple[Page, ...]
    topics: tuple[Topic, ...] = ()
    scoring: Scoring = "none"

    def questions(self) -> "Collection[Question]":
        """Every question in written order."""
        return self._by_key.values()

    def question(self, key: str) -> "Question | None":
        """Return the question with a key."""
        return self._by_key.get(key)

    @cached_property
    def _by_key(self) -> "dict[str, Question]":
        """Made once, because exports ask for it with every response. Of keys that stand twice,
        which is refused, the last one counts.
        """
        return {question.key: question for question in _walk(self)}


@dataclass(frozen=True)
class Question:
    """What takes one answer: an item, or a row of a grid. `page` counts from 0; `points` is empty
    without a scale.
    """

    page: int
    item: AnyItem
    row: Row | None
    points: tuple[Point, ...]

    @property
    def key(self) -> str:
        """Under what its answer is stored."""
        return self.item.key if self.row is None else self.row.key

    @property
    def text(self) -> Text:
        """Its own words; those of a grid stand above all rows."""
        return self.item.text if self.row is None else self.row.text

    def fingerprint(self, language: str) -> str:
        """Return 12 hexadecimal digits that change with any word that is shown for it in a
        language.
        """
        own = [self.item.text, self.text, self.item.hint, *(point.label for point in self.points)]
        own += [option.label for option in getattr(self.item, "options", ())]
        own += [
            getattr(self.item, name) for name in ("low", "high", "unit") if hasattr(self.item, name)
        ]
        return sha256("\x1f".join(text.get(language, "") for text in own).encode()).hexdigest()[:12]


def _walk(definition: Definition) -> "Iterator[Question]":
    for index, page in enumerate(definition.pages):
        for item in page.items:
            rows: tuple[Row | None, ...] = item.rows if isinstance(item, Grid) else (None,)
            for row in rows:
                yield Question(page=index, item=item, row=row, points=points_of(definition, item))


def points_of(definition: Definition, item: AnyItem) -> tuple[Point, ...]:
    """Return the scale of an item; empty for kinds without one, or when it names none that is
    there.
    """
    return definition.scales.get(item.scale, ()) if isinstance(item, Likert | Grid) else ()


def spoken(text: Mapping[str, str], language: str) -> str:
    """Return a text in a language, or in the first that it has; a definition has them all, a single
    label may be empty.
    """
    return text.get(language) or next(iter(text.values()), "")


def language_for(definition: Definition, wanted: str) -> str:
    """Return the language in which a questionnaire is shown to somebody who reads `wanted` ("es",
    "es-mx").
    """
    for name in (wanted, wanted.split("-", maxsplit=1)[0]):
        if name in definition.languages:
            return name
    return definition.languages[0]


prepare(Definition)


def to_json(definition: Definition) -> bytes:
    """Return a definition as the JSON that import takes: indented, fields in the order of the
    classes.
    """
    return msgspec.json.format(msgspec.json.encode(definition), indent=2) + b"\n"


def digest(definition: Definition) -> str:
    """Return the SHA-256 of a definition: equal exactly when nothing differs."""
    return sha256(msgspec.json.encode(definition, order="deterministic")).hexdigest()


def from_stored(document: Any) -> Definition:
    """Return the definition that a database row holds; it was checked when it was stored."""
    return msgspec.convert(document, Definition)
