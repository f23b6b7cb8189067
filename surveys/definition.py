"""The definition of a questionnaire: version 1 of the JSON format.

A *question* takes one answer: an item (surveys/item.py, with a file for each type in
surveys/questions/), or a row of a grid. Its answer is stored under its key for good. The classes
refuse unknown fields and wrong types; surveys/problems.py checks the rest.
"""

from collections.abc import Collection, Mapping
from functools import cached_property
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import msgspec

from robots.api.prepared import prepare
from surveys.documents import DocumentPart, Key, Language, Slug, Text
from surveys.item import Item, ItemCondition, Order, Question, ScalePoint, ScoringRule, ordered
from surveys.questions import TYPES

if TYPE_CHECKING:
    AnyItem = Item
else:
    AnyItem = Union[tuple(TYPES.values())]  # noqa: UP007 - the types are found when this is read


class Page(DocumentPart, frozen=True, kw_only=True):
    key: Key
    title: Text = {}
    intro: Text = {}
    order: Order = "fixed"
    show_if: ItemCondition | None = None
    items: tuple[AnyItem, ...]

    def items_shown(self, seed: int) -> list[AnyItem]:
        return ordered(self.items, self.order, seed, f"page {self.key}")


class QuestionTopic(DocumentPart, frozen=True, kw_only=True):
    key: Key
    text: Text
    items: tuple[str, ...]


class Definition(DocumentPart, frozen=True, kw_only=True, dict=True):
    """A questionnaire. A `template` lacks texts that may not be shipped, and cannot be used."""

    format: Literal[1]
    slug: Slug
    version: Annotated[int, msgspec.Meta(ge=1, le=9999)]
    title: Text
    intro: Text = {}
    source: str = ""
    licence: str = ""
    template: bool = False
    languages: tuple[Language, ...]
    scales: dict[Key, tuple[ScalePoint, ...]] = {}
    pages: tuple[Page, ...]
    topics: tuple[QuestionTopic, ...] = ()
    scoring: ScoringRule | Literal["none"] = "none"

    def questions(self) -> Collection[Question]:
        return self.by_key.values()

    def question(self, key: str) -> Question | None:
        return self.by_key.get(key)

    def questions_shown(self, seed: int) -> list[Question]:
        items = (item for page in self.pages for item in page.items_shown(seed))
        return [self.by_key[key] for item in items for key in item.keys_asked(seed)]

    def positions(self, seed: int) -> dict[str, int]:
        """Return the place of each question in the order shown, from 1, by key."""
        return {question.key: n for n, question in enumerate(self.questions_shown(seed), start=1)}

    @cached_property
    def scored(self) -> list[Question]:
        """The questions that its rule of scoring takes, in written order."""
        in_topics = {key for topic in self.topics for key in topic.items}
        fit = [one for one in self.questions() if self.scoring in one.item.scored_by]
        scored = [one for one in fit if one.score_values]
        return [one for one in scored if self.scoring != "topics" or one.key in in_topics]

    @cached_property
    def reversed(self) -> Collection[str]:
        """The keys of the questions that scores count from the other end; in the SUS, the even."""
        if self.scoring == "sus":
            return [question.key for question in self.scored[1::2]]
        return [question.key for question in self.scored if question.is_reversed]

    def coded(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return answers by key (None for none), reversed ones counted from the other end."""
        given = [key for key in self.reversed if values.get(key) is not None]
        return {**values, **{key: self.by_key[key].from_other_end(values[key]) for key in given}}

    @cached_property
    def by_key(self) -> dict[str, Question]:
        """The questions by key; a key that occurs twice (a problem) has the last."""
        items = ((n, item) for n, page in enumerate(self.pages) for item in page.items)
        asked = ((n, item, row) for n, item in items for row in item.rows_asked())
        questions = (Question(n, item, row, item.points(self.scales)) for n, item, row in asked)
        return {question.key: question for question in questions}


def language_for(definition: Definition, wanted: str) -> str:
    """Return the language to show a questionnaire in where `wanted` ("es-mx") is preferred."""
    names = (wanted, wanted.split("-", maxsplit=1)[0])
    return next((one for one in names if one in definition.languages), definition.languages[0])


prepare(Definition)


def to_json(definition: Definition) -> bytes:
    return msgspec.json.format(msgspec.json.encode(definition), indent=2) + b"\n"


def digest(definition: Definition) -> str:
    """Return the SHA-256 of a definition: equal exactly when nothing differs."""
    return sha256(msgspec.json.encode(definition, order="deterministic")).hexdigest()


def from_stored(document: Any) -> Definition:
    return msgspec.convert(document, Definition)
