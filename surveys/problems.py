"""What is wrong with a questionnaire that somebody wrote, in sentences that say where."""

import datetime
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import msgspec

from surveys.definition import (
    AnyItem,
    Condition,
    Date,
    Definition,
    Grid,
    Likert,
    Multiple,
    Number,
    Part,
    Question,
    Single,
    Slider,
    Text,
    points_of,
)

T = TypeVar("T")

MAX_BYTES = 512 * 1024
MAX_QUESTIONS = 300
MAX_TEXT = 4000
MIN_POINTS, MAX_POINTS = 2, 11
SUS_ITEMS, TLX_ITEMS = 10, 6


class BadDefinitionError(ValueError):
    """A definition that cannot be used. `problems` has a sentence each."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = problems


def parse(document: bytes) -> Definition:
    """Return the definition that a JSON document holds.

    Raises:
        BadDefinitionError: with every problem found; JSON or types that are wrong end the search at
            the first.
    """
    return checked(document, Definition, problems, MAX_BYTES)


def checked(
    document: bytes, kind: type[T], problems_of: Callable[[T], Iterable[str]], limit: int
) -> T:
    """Return what a JSON document of at most `limit` bytes holds, when `problems_of` finds nothing
    wrong with it.

    Raises:
        BadDefinitionError: as `parse`.
    """
    if len(document) > limit:
        raise BadDefinitionError([f"The file is larger than {limit // 1024} kB."])
    try:
        found = msgspec.json.decode(document, type=kind)
    except msgspec.ValidationError as error:
        raise BadDefinitionError([f"{error}."]) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadDefinitionError([f"This is not JSON: {error}."]) from error
    wrong = list(problems_of(found))
    if wrong:
        raise BadDefinitionError(wrong)
    return found


def problems(definition: Definition) -> Iterator[str]:
    """Yield what is wrong with a definition whose types are right."""
    yield from _of_the_whole(definition)
    yield from _of_texts(definition)
    yield from _of_scales(definition)
    for page in definition.pages:
        for item in page.items:
            yield from (f"{item.key}: {problem}" for problem in _of_item(definition, item))
    yield from _of_conditions(definition)
    yield from _of_scoring(definition)


def _of_the_whole(definition: Definition) -> Iterator[str]:
    if not definition.pages:
        yield "There is no page."
    yield from (f"Page {page.key} has no items." for page in definition.pages if not page.items)
    yield from _twice("page", (page.key for page in definition.pages))
    items = [item for page in definition.pages for item in page.items]
    keys = [row.key for item in items if isinstance(item, Grid) for row in item.rows] + [
        item.key for item in items if not isinstance(item, Grid)
    ]
    yield from _twice("key", keys + [item.key for item in items if isinstance(item, Grid)])
    if len(keys) > MAX_QUESTIONS:
        yield f"There are {len(keys)} questions; at most {MAX_QUESTIONS} are allowed."
    yield from _twice("topic", (topic.key for topic in definition.topics))


def _twice(what: str, names: Iterable[str]) -> Iterator[str]:
    yield from (
        f"The {what} {name} stands {count} times."
        for name, count in Counter(names).items()
        if count > 1
    )


def _of_texts(definition: Definition) -> Iterator[str]:
    if not definition.languages:
        yield "There is no language."
    yield from _twice("language", definition.languages)
    if "\x00" in definition.source + definition.licence:
        yield "Source or licence holds a null character."
    yield from text_problems(definition, "questionnaire", definition.languages)


def text_problems(part: Part, where: str, languages: tuple[str, ...]) -> Iterator[str]:
    """Yield what is wrong with any text inside a part: each must be there in all of the languages
    and in no other.
    """
    for place, text, needed in _texts(part, where):
        if not needed and not any(text.values()):
            continue
        yield from (
            f"{place} has no text in {language}."
            for language in languages
            if not text.get(language, "").strip()
        )
        yield from (
            f"{place} has a text in {name}, which is not among the languages."
            for name in text
            if name not in languages
        )
        yield from (
            f"{place}: the text in {name} holds a null character."
            for name in text
            if "\x00" in text[name]
        )
        yield from (
            f"{place}: the text in {name} is longer than {MAX_TEXT} characters."
            for name in text
            if len(text[name]) > MAX_TEXT
        )


def _texts(part: Part, place: str) -> Iterator[tuple[str, Text, bool]]:
    """Yield (where, text, whether it must be there) for every text inside a part."""
    for field in msgspec.structs.fields(part):
        value = getattr(part, field.name)
        if field.type == Text:
            yield f"{place}.{field.encode_name}", value, field.required
        elif isinstance(value, Part):
            yield from _texts(value, f"{place}.{field.encode_name}")
        elif isinstance(value, tuple):
            for n, inner in enumerate(value):
                if isinstance(inner, Part):
                    yield from _texts(
                        inner, getattr(inner, "key", "") or f"{place}.{field.encode_name}[{n}]"
                    )
        elif isinstance(value, dict) and field.name == "scales":
            for name, points in value.items():
                for point in points:
                    yield from _texts(point, f"scale {name}, {point.value}")


def _of_scales(definition: Definition) -> Iterator[str]:
    for name, points in definition.scales.items():
        values = [point.value for point in points]
        if not MIN_POINTS <= len(values) <= MAX_POINTS:
            yield (
                f"The scale {name} has {len(values)} points; it needs {MIN_POINTS} to {MAX_POINTS}."
            )
        elif values != sorted(set(values)):
            yield f"The values of the scale {name} do not rise from point to point."
        elif not (any(points[0].label.values()) and any(points[-1].label.values())):
            yield f"The scale {name} does not name its two ends."


def _of_item(definition: Definition, item: AnyItem) -> Iterator[str]:
    if isinstance(item, Likert | Grid) and not points_of(definition, item):
        yield f"there is no scale {item.scale}."
    if isinstance(item, Grid) and not item.rows:
        yield "the grid has no rows."
    if isinstance(item, Single | Multiple):
        yield from _of_options(item)
    if (
        isinstance(item, Number)
        and isinstance(item.minimum, float)
        and isinstance(item.maximum, float)
        and item.minimum > item.maximum
    ):
        yield "the least number is larger than the greatest."
    if isinstance(item, Slider) and (
        item.minimum >= item.maximum or (item.maximum - item.minimum) % item.step
    ):
        yield "its ends must differ by a multiple of its step."
    if isinstance(item, Date):
        yield from _of_days(item)


def _of_options(item: Single | Multiple) -> Iterator[str]:
    if not item.options:
        yield "there are no options."
    yield from _twice("option", (option.value for option in item.options))
    if isinstance(item, Multiple):
        most = len(item.options) if item.at_most is None else item.at_most
        if not 0 <= item.at_least <= most or not 1 <= most <= len(item.options):
            yield "so many options cannot be chosen."


def _of_days(item: Date) -> Iterator[str]:
    days = []
    for day in (item.earliest, item.latest):
        try:
            days += (
                [datetime.date.fromisoformat(day)]
                if day not in {None, "today"} and isinstance(day, str)
                else []
            )
        except ValueError:
            yield f"{day} is not a day."
    if len(days) == len((item.earliest, item.latest)) and days[0] > days[1]:
        yield "the earliest day is after the latest."


def _of_conditions(definition: Definition) -> Iterator[str]:
    known: dict[str, Question] = {}
    for index, page in enumerate(definition.pages):
        yield from (f"page {page.key}: {problem}" for problem in _of_condition(page.show_if, known))
        here: dict[str, Question] = {}
        for item in page.items:
            # On a shuffled page nothing is surely earlier; a later page always is.
            reach = known if page.order == "shuffled" else {**known, **here}
            yield from (f"{item.key}: {problem}" for problem in _of_condition(item.show_if, reach))
            here |= {
                question.key: question
                for question in definition.questions()
                if question.page == index and question.item.key == item.key
            }
        known |= here


def _of_condition(condition: Condition | None, earlier: dict[str, Question]) -> Iterator[str]:
    if condition is None:
        return
    asks_answer = (
        bool(condition.one_of) or condition.at_least is not None or condition.at_most is not None
    )
    if not (condition.robot or condition.outcome or condition.item):
        yield "show_if names neither robot nor outcome nor item."
    if bool(condition.item) != asks_answer:
        yield "show_if needs item together with is, at_least or at_most."
    elif condition.item and condition.item not in earlier:
        yield f"show_if asks {condition.item}, which is no earlier question."
    elif condition.item:
        yield from _of_expected(condition, earlier[condition.item])


def _of_expected(condition: Condition, question: Question) -> Iterator[str]:
    possible: set[str | int | float] | None = None
    if question.points:
        possible = {point.value for point in question.points}
    elif isinstance(question.item, Single | Multiple):
        possible = {option.value for option in question.item.options}
    if possible is not None:
        yield from (
            f"show_if expects {value}, which {question.key} cannot be."
            for value in condition.one_of
            if value not in possible
        )
    bounded = condition.at_least is not None or condition.at_most is not None
    if bounded and not (question.points or isinstance(question.item, Number | Slider)):
        yield f"show_if compares {question.key}, which is no number."


def _of_scoring(definition: Definition) -> Iterator[str]:
    by_key = {question.key: question for question in definition.questions()}
    for topic in definition.topics:
        yield from (
            f"topic {topic.key}: there is no statement {key}."
            for key in topic.items
            if key not in by_key or not by_key[key].points
        )
    questions = list(by_key.values())
    scaled = [question for question in questions if question.points]
    if (
        definition.scoring == "likert"
        and len({tuple(point.value for point in question.points) for question in scaled}) != 1
    ):
        yield "scoring likert needs statements on one scale."
    if definition.scoring == "sus" and not (
        len(scaled) == SUS_ITEMS
        and all([p.value for p in q.points] == [1, 2, 3, 4, 5] for q in scaled)
    ):
        yield "scoring sus needs ten statements on a scale from 1 to 5."
    sliders = [question.item for question in questions if isinstance(question.item, Slider)]
    if definition.scoring == "tlx_raw" and not (
        len(sliders) == TLX_ITEMS and all((s.minimum, s.maximum) == (0, 100) for s in sliders)
    ):
        yield "scoring tlx_raw needs six sliders from 0 to 100."
