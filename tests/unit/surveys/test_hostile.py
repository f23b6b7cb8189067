"""Hostile files and fields: each is read or refused."""

import copy
import json

from hypothesis import given, strategies as st

from surveys.answers import Missing, read_answer
from surveys.definition import to_json
from surveys.documents import BadDefinitionError
from surveys.item import RefusedError
from surveys.page_form import Reader, page_form_of
from surveys.problems import parse
from tests.support.studies.questionnaires import NOW, as_bytes, defined, document, item, rows

PAGES = (
    [
        item("likert", "l", prefer_not=True),
        item("grid", "g", rows=rows("g1", "g2")),
        item("single", "s", order="shuffled"),
        item("multiple", "m", at_least=1, at_most=3, not_applicable=True),
        item("ranking", "r", order="shuffled", prefer_not=True),
        item("number", "n", minimum=-5, maximum="this_year", whole=True),
        item("text", "t", max_length=20),
        item("date", "d", earliest="2020-01-01", latest="today"),
        item("slider", "x", step=5),
    ],
    [
        item("text", "why", show_if={"item": "s", "is": ["c"]}),
        item("text", "more", show_if={"item": "n", "at_least": 2, "robot": ["giraff"]}),
    ],
)
TOPICS = [{"key": "topic", "text": {"en": "Topic"}, "items": ["l", "g1"]}]
WHOLE = document(*PAGES, topics=TOPICS, scoring="likert")
DEFINITION = defined(*PAGES, topics=TOPICS, scoring="likert")
KEYS = [question.key for question in DEFINITION.questions()]
WORDS = st.sampled_from(["en", "today", "likert", "agree", "shuffled", "l", "\x00"])
NUMBERS = st.none() | st.booleans() | st.integers() | st.floats()
JSON = st.recursive(
    NUMBERS | st.text(max_size=8) | WORDS,
    lambda one: st.lists(one, max_size=3) | st.dictionaries(st.text(max_size=6), one, max_size=3),
    max_leaves=6,
)
ODD = "a -1 1 0 2020-02-30 nan 1e400 ~preferred_not ~skipped not_applicable 50 1.a 2.b 3.c 1.c"
SENT = st.text(max_size=30) | st.sampled_from(["", "9" * 400, *ODD.split()])


def places(part, path=()):
    """Return the paths to everything inside a document."""
    inner = ()
    if isinstance(part, dict | list):
        inner = part.items() if isinstance(part, dict) else enumerate(part)
    return [path, *(deeper for name, value in inner for deeper in places(value, (*path, name)))]


def parsed(content):
    """Return the definition or its problems."""
    try:
        return parse(content), []
    except BadDefinitionError as error:
        return None, [str(problem) for problem in error.problems]


def read(key, fields):
    """Return the answer and the reason why it was refused; one of them is there."""
    try:
        return read_answer(DEFINITION.question(key), fields, NOW), ""
    except RefusedError as error:
        return None, str(error)


@given(st.sampled_from(places(WHOLE)[1:]), JSON, st.booleans())
def test_a_file_with_one_thing_changed_is_either_right_or_refused_with_a_reason(path, value, gone):
    changed = copy.deepcopy(WHOLE)
    holder = changed
    for name in path[:-1]:
        holder = holder[name]
    if gone:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    definition, problems = parsed(json.dumps(changed).encode("utf-8", "surrogatepass"))
    assert (definition is None) == bool(problems)
    assert all(problem.endswith(".") for problem in problems)
    if definition is None:
        return
    assert parse(to_json(definition)) == definition
    reader = Reader("en", seed=1, now=NOW, sees_all=True)
    for page in range(len(definition.pages)):
        assert page_form_of(definition, page, reader, range(len(definition.pages))).fieldsets


@given(st.binary(max_size=60))
def test_bytes_are_refused_as_json(content):
    assert parsed(content)[1]


@given(st.sampled_from(KEYS), st.lists(SENT, max_size=4), st.lists(SENT, max_size=2))
def test_any_value_sent_to_a_question_is_an_allowed_answer_or_refused(key, values, reasons):
    answer, refused = read(key, {key: values, f"{key}~": reasons})
    assert (answer is None) == bool(refused)
    if answer is None:
        return
    assert (answer.value is None) == (answer.missing is not None)
    assert answer.missing is not Missing.NOT_REACHED
    if answer.value is not None:
        json.dumps(answer.value, allow_nan=False)
        again = DEFINITION.question(key).item.sent(answer.value)
        assert read(key, {key: again}) == (answer, "")


def test_the_file_that_is_changed_above_is_right():
    assert parse(as_bytes(WHOLE)) == DEFINITION
