"""What is wrong with a questionnaire that somebody wrote, in sentences that say where."""

from collections.abc import Iterator, Mapping, Sequence

from surveys.definition import Definition
from surveys.documents import checked, duplicates, text_problems
from surveys.item import ItemCondition, Question
from surveys.questions import TYPES

MAX_BYTES = 512 * 1024
MAX_QUESTIONS = 300
MIN_POINTS, MAX_POINTS = 2, 11
SUS_ITEMS, TLX_ITEMS = 10, 6


def parse(document: bytes) -> Definition:
    """Return the definition that a JSON document holds.

    Raises:
        BadDefinitionError: with every problem found; JSON or types that are wrong end the search at
            the first.
    """
    return checked(
        document, Definition, problems, limit=MAX_BYTES, kinds=TYPES, kind_name="question type"
    )


def problems(definition: Definition) -> Iterator[str]:
    """Yield what is wrong with a definition whose types are right."""
    yield from _of_the_whole(definition)
    yield from _of_texts(definition)
    yield from _of_scales(definition)
    for page in definition.pages:
        for item in page.items:
            yield from (f"{item.key}: {problem}" for problem in item.problems(definition.scales))
    yield from _of_conditions(definition)
    yield from _of_scoring(definition)


def _of_the_whole(definition: Definition) -> Iterator[str]:
    if not definition.pages:
        yield "There is no page; add at least one."
    yield from (f"Page {page.key} has no items." for page in definition.pages if not page.items)
    yield from duplicates("page", (page.key for page in definition.pages))
    items = [item for page in definition.pages for item in page.items]
    keys = [item.key if row is None else row.key for item in items for row in item.rows_asked()]
    yield from duplicates("key", keys + [item.key for item in items if item.is_group])
    if len(keys) > MAX_QUESTIONS:
        yield f"There are {len(keys)} questions; at most {MAX_QUESTIONS} are allowed."
    yield from duplicates("topic", (topic.key for topic in definition.topics))


def _of_texts(definition: Definition) -> Iterator[str]:
    if not definition.languages:
        yield "There is no language; add at least one."
    yield from duplicates("language", definition.languages)
    if "\x00" in definition.source + definition.licence:
        yield "The source or licence contains a null character; remove it."
    yield from text_problems(definition, "questionnaire", definition.languages)


def _of_scales(definition: Definition) -> Iterator[str]:
    for name, points in definition.scales.items():
        values = [point.value for point in points]
        if not MIN_POINTS <= len(values) <= MAX_POINTS:
            yield (
                f"The scale {name} has {len(values)} points; it needs {MIN_POINTS} to {MAX_POINTS}."
            )
        elif values != sorted(set(values)):
            yield f"The values of the scale {name} must increase from point to point."
        elif not (any(points[0].label.values()) and any(points[-1].label.values())):
            yield f"The scale {name} must name its two ends."


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


def _of_condition(condition: ItemCondition | None, earlier: dict[str, Question]) -> Iterator[str]:
    if condition is None:
        return
    asks_answer = (
        bool(condition.one_of) or condition.at_least is not None or condition.at_most is not None
    )
    if not (condition.robot or condition.outcome or condition.item):
        yield "show_if must name a robot, an outcome or an item."
    if bool(condition.item) != asks_answer:
        yield "show_if needs item together with is, at_least or at_most."
    elif condition.item and condition.item not in earlier:
        yield f"show_if names {condition.item}, which is not an earlier question."
    elif condition.item:
        yield from _of_expected(condition, earlier[condition.item])


def _of_expected(condition: ItemCondition, question: Question) -> Iterator[str]:
    possible = {value for value, _label in question.labelled_values}
    if possible:
        yield from (
            f"show_if expects {value}, which is not a possible answer to {question.key}."
            for value in condition.one_of
            if value not in possible
        )
    bounded = condition.at_least is not None or condition.at_most is not None
    if bounded and not question.item.is_number:
        yield f"show_if compares {question.key}, which is not a number."


def _of_scoring(definition: Definition) -> Iterator[str]:
    by_key = {question.key: question for question in definition.questions()}
    for topic in definition.topics:
        yield from (
            f"topic {topic.key}: there is no statement {key}."
            for key in topic.items
            if key not in by_key or not _may_be_in_topic(definition, by_key[key])
        )
    yield from _of_topics_as_scales(definition, by_key)
    yield from _of_reversed(definition)
    scored = [question.score_values for question in definition.scored]
    if definition.scoring == "likert" and len({tuple(values) for values in scored}) != 1:
        yield "scoring likert needs statements on one scale."
    if definition.scoring == "sus" and not (
        len(scored) == SUS_ITEMS and all(list(values) == [1, 2, 3, 4, 5] for values in scored)
    ):
        yield "scoring sus needs ten statements on a scale from 1 to 5."
    if definition.scoring == "tlx_raw" and not (
        len(scored) == TLX_ITEMS and all(_is_percent(values) for values in scored)
    ):
        yield "scoring tlx_raw needs six sliders from 0 to 100."


def _may_be_in_topic(definition: Definition, question: Question) -> bool:
    if definition.scoring == "topics":
        return "topics" in question.item.scored_by and bool(question.score_values)
    return bool(question.points)


def _of_topics_as_scales(definition: Definition, by_key: Mapping[str, Question]) -> Iterator[str]:
    if definition.scoring != "topics":
        return
    if not definition.topics:
        yield "scoring topics needs at least one topic."
    for topic in definition.topics:
        values = {tuple(by_key[key].score_values) for key in topic.items if key in by_key}
        if len(values) != 1:
            yield f"topic {topic.key}: scoring topics needs statements on one scale."


def _of_reversed(definition: Definition) -> Iterator[str]:
    scored = {question.key for question in definition.scored}
    for question in definition.questions():
        if not question.is_reversed:
            continue
        values = question.score_values
        if definition.scoring == "sus":
            yield f"{question.key}: scoring sus reverses the even statements; remove reverse."
        elif question.key not in scored:
            yield f"{question.key} is reversed, but no score of this questionnaire uses it."
        elif {question.from_other_end(value) for value in values} != set(values):
            yield (
                f"{question.key}: a scale with unequal distances from its two ends"
                " cannot be reversed."
            )


def _is_percent(values: Sequence[int]) -> bool:
    return bool(values) and (values[0], values[-1]) == (0, 100)
