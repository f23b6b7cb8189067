"""Problems of questionnaires, and where they are corrected."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from surveys.definition import Definition, Page
from surveys.documents import (
    Problem,
    ProblemPlace,
    checked,
    duplicates,
    gettext_noop as _,
    text_problems,
    within,
)
from surveys.item import Item, ItemCondition, Question, ScalePoint
from surveys.questions import TYPES

MAX_BYTES = 512 * 1024
MAX_QUESTIONS = 300
MIN_POINTS, MAX_POINTS = 2, 11
SUS_ITEMS, TLX_ITEMS = 10, 6
ABOUT = ProblemPlace("about")  # the questionnaire itself
Questions = Mapping[str, Question]


def parse(document: bytes) -> Definition:
    """Return the definition in JSON; raises BadDefinitionError as surveys.documents.checked."""
    name = _("question type")
    return checked(document, Definition, problems, limit=MAX_BYTES, kinds=TYPES, kind_name=name)


def problems(definition: Definition) -> Iterator[Problem]:
    yield from within(_of_the_whole(definition), ABOUT)
    yield from _of_texts(definition)
    for name, points in definition.scales.items():
        yield from within(_of_scale(points), ProblemPlace("scales", name), "scale", name)
    for page in definition.pages:
        if not page.items:
            yield from _of_page([Problem(_("This page has no questions. Add one."))], page)
        for item in page.items:
            yield from within(item.problems(definition.scales), _place_of(item), item.key)
    yield from _of_conditions(definition)
    yield from within(_of_scoring(definition), ABOUT)


def _place_of(item: Item) -> ProblemPlace:
    return ProblemPlace("questions", item.key)


def _of_page(found: Iterable[Problem], page: Page) -> Iterator[Problem]:
    return within(found, ProblemPlace("pages", page.key), "page", page.key)


def _of_the_whole(definition: Definition) -> Iterator[Problem]:
    if not definition.pages:
        yield Problem(_("There is no page; add at least one."))
    yield from duplicates(_("Page"), (page.key for page in definition.pages))
    items = [item for page in definition.pages for item in page.items]
    keys = [key for item in items for key in item.keys_asked()]
    groups = [item.key for item in items if item.is_group]
    yield from duplicates(_("Name in the data"), keys + groups)
    if len(keys) > MAX_QUESTIONS:
        words = _("There are %(n)d questions; at most %(most)d are allowed.")
        yield Problem(words, {"n": len(keys), "most": MAX_QUESTIONS})
    yield from duplicates(_("Topic"), (topic.key for topic in definition.topics))
    if not definition.languages:
        yield Problem(_("There is no language; add at least one."))
    yield from duplicates(_("Language"), definition.languages)
    if "\x00" in definition.source + definition.licence:
        yield Problem(_("The source or licence contains a null character; remove it."))


def _of_texts(definition: Definition) -> Iterator[Problem]:
    for one in text_problems(definition, "questionnaire", definition.languages):
        match one.path:
            case ("pages", int(n), "items", int(m), *path):
                place = _place_of(definition.pages[n].items[m])
            case ("pages", int(n), *path):
                place = ProblemPlace("pages", definition.pages[n].key)
            case ("scales", name, *path):
                place, path = ProblemPlace("scales", name), ["points", *path]
            case path:
                place = ABOUT
        yield replace(one, place=place, path=tuple(path))


def _of_scale(points: Sequence[ScalePoint]) -> Iterator[Problem]:
    values = [point.value for point in points]
    if not MIN_POINTS <= len(values) <= MAX_POINTS:
        words = _("A scale needs %(least)d to %(most)d points; this one has %(n)d.")
        yield Problem(words, {"least": MIN_POINTS, "most": MAX_POINTS, "n": len(values)})
    elif values != sorted(set(values)):
        yield Problem(_("The values must increase from point to point."))
    elif not (any(points[0].label.values()) and any(points[-1].label.values())):
        yield Problem(_("Label the first and the last point."))


def _of_conditions(definition: Definition) -> Iterator[Problem]:
    known: dict[str, Question] = {}
    for page in definition.pages:
        found = within(_of_condition(page.show_if, known), None, "show_if")
        yield from _of_page(found, page)
        here: dict[str, Question] = {}
        for item in page.items:
            # The order of a shuffled page is not known; a later page always is later.
            reach = known if page.order == "shuffled" else known | here
            found = within(_of_condition(item.show_if, reach), None, "show_if")
            yield from within(found, _place_of(item), item.key)
            here |= {key: definition.by_key[key] for key in item.keys_asked()}
        known |= here


def _of_condition(condition: ItemCondition | None, earlier: Questions) -> Iterator[Problem]:
    if condition is None:
        return
    if not (condition.robot or condition.outcome or condition.item):
        yield Problem(_("Choose when it is shown, or remove the condition."))
    if bool(condition.item) != (bool(condition.one_of) or condition.is_bounded):
        yield Problem(_("Choose both an earlier question and answers to it."))
    elif condition.item and condition.item not in earlier:
        words = _("The condition refers to a question that does not come earlier.")
        yield Problem(words, names=((condition.item,),))
    elif condition.item:
        yield from _of_expected(condition, earlier[condition.item])


def _of_expected(condition: ItemCondition, question: Question) -> Iterator[Problem]:
    possible = {value for value, _label in question.labelled_values}
    if possible:
        words = _("The condition expects an answer that the question doesn't offer.")
        others = (value for value in condition.one_of if value not in possible)
        yield from (Problem(words, names=(("is", value),)) for value in others)
    if condition.is_bounded and not question.item.is_number:
        yield Problem(_("Only the answer to a number question has a minimum or maximum."))


def _of_scoring(definition: Definition) -> Iterator[Problem]:
    yield from _of_topics(definition)
    yield from _of_reversed(definition)
    scored = [list(question.score_values) for question in definition.scored]
    percents = [values for values in scored if values[:1] + values[-1:] == [0, 100]]
    match definition.scoring:
        case "likert" if len({tuple(values) for values in scored}) != 1:
            yield Problem(_("A mean of all statements needs statements on one scale."))
        case "sus" if scored != [[1, 2, 3, 4, 5]] * SUS_ITEMS:
            yield Problem(_("The SUS needs ten statements on a scale from 1 to 5."))
        case "tlx_raw" if len(scored) != TLX_ITEMS or len(percents) != TLX_ITEMS:
            yield Problem(_("The raw NASA-TLX needs six sliders from 0 to 100."))


def _of_topics(definition: Definition) -> Iterator[Problem]:
    are_scales = definition.scoring == "topics"
    if are_scales and not definition.topics:
        yield Problem(_("A mean of each topic needs topics. Add them."))
    for topic in definition.topics:
        found = {key: definition.question(key) for key in topic.items}
        for key, question in found.items():
            if question is None or not _may_be_in_topic(definition, question):
                words = _("A topic has a question that it can't use.")
                yield Problem(words, names=(("topic", topic.key), (key,)))
        values = {tuple(one.score_values) for one in found.values() if one is not None}
        if are_scales and len(values) != 1:
            words = _("The questions of a topic need the same scale.")
            yield Problem(words, names=(("topic", topic.key),))


def _may_be_in_topic(definition: Definition, question: Question) -> bool:
    if definition.scoring == "topics":
        return "topics" in question.item.scored_by and bool(question.score_values)
    return bool(question.points)


def _of_reversed(definition: Definition) -> Iterator[Problem]:
    scored = {question.key for question in definition.scored}
    for question in definition.questions():
        if not question.is_reversed:
            continue
        values, words = question.score_values, None
        if definition.scoring == "sus":
            words = _("The SUS reverses its statements itself.")
        elif question.key not in scored:
            words = _("It is reversed, but no score uses it.")
        elif {question.from_other_end(value) for value in values} != set(values):
            words = _("A scale that isn't symmetric can't be reversed.")
        if words:
            place = _place_of(question.item)
            yield Problem(words, place=place, names=((question.key,), ("reverse",)))
