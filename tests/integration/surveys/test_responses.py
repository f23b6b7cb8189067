"""Each respondent has one response for a context, also when requests are repeated."""

import datetime
from concurrent.futures import ThreadPoolExecutor

import pytest
from django.db import connection

from surveys.models import Answer, Questionnaire, Response
from surveys.questionnaires import store
from surveys.responses import (
    ClosedError,
    Context,
    Respondent,
    Saving,
    finish,
    leave_page,
    place,
    save_one,
    save_page,
)
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined, item
from tests.support.studies.responses import ANNA, begun

pytestmark = pytest.mark.django_db
LATER = NOW + datetime.timedelta(minutes=10)
SAVING = Saving(now=LATER, language="en")


def started(*pages, **more):
    definition = defined(*pages, **more)
    return begun(store(definition, NOW), seed=3), definition


def saved(row, definition, key: str, value: str, **more) -> Answer:
    """Save one answer ten minutes after the beginning, and return its row."""
    save_one(
        row, definition, key, {key: [value]}, Saving(**{"now": LATER, "language": "en"} | more)
    )
    return Answer.objects.get()


def test_beginning_again_gives_the_same_response_with_what_was_recorded_first():
    first, _ = started([item("text", "a")])
    context = Context(key="c", outcome="timed_out")
    again = begun(Questionnaire.objects.get(), ANNA, context, language="es", seed=99, now=LATER)
    assert (again.pk, again.seed, again.started_at, again.outcome) == (first.pk, 3, NOW, "")
    assert Questionnaire.objects.get().frozen_at == NOW


def test_another_context_and_another_respondent_are_other_responses():
    started([item("text", "a")])
    questionnaire = Questionnaire.objects.get()
    others = [(ANNA, "c2"), (Respondent(key="bert"), "c"), (Respondent(user=person()), "c")]
    for respondent, key in others:
        begun(questionnaire, respondent, Context(key=key))
    assert Response.objects.count() == 4


def test_a_response_to_an_older_version_continues_with_it():
    first, _ = started([item("text", "a")])
    newer = store(defined([item("text", "b")], version=2), LATER)
    assert begun(newer, now=LATER).questionnaire_id == first.questionnaire_id
    assert newer.frozen_at is None


@pytest.mark.parametrize("wrong", [{}, {"user": object(), "key": "x"}])
def test_a_respondent_is_a_user_or_a_key(wrong):
    with pytest.raises(ValueError, match="either a user or a key"):
        Respondent(**wrong)


def test_an_answer_has_language_text_version_position_and_time():
    row, definition = started([item("single", "a"), item("single", "b")])
    answer = saved(row, definition, "b", "c", seconds={"b": 4.321})
    assert (answer.value, answer.position, answer.seconds) == ("c", 2, 4.32)
    assert (answer.answered_at, answer.language) == (LATER, "en")
    assert answer.text_version == definition.question("b").fingerprint("en")
    assert Response.objects.get().seen_at == LATER


@pytest.mark.parametrize(("sent", "kept"), [(-5.0, 0.0), (1e9, 600.0), (2.0, 2.0)])
def test_seconds_are_never_less_than_none_nor_more_than_have_passed(sent, kept):
    row, definition = started([item("single", "a")])
    assert saved(row, definition, "a", "c", seconds={"a": sent}).seconds == kept


def test_an_old_request_of_the_same_page_that_arrives_late_changes_nothing():
    row, definition = started([item("single", "a")])
    for value, writing in (("a", 1), ("c", 3), ("b", 2), ("d", 3)):
        answer = saved(row, definition, "a", value, writer="page", writing=writing)
    assert answer.value == "c"
    assert saved(row, definition, "a", "e", writer="other page", writing=1).value == "e"


def test_a_change_keeps_the_moment_of_the_first_answer():
    row, definition = started([item("single", "a")])
    saved(row, definition, "a", "a", now=NOW)
    answer = saved(row, definition, "a", "b")
    assert (answer.first_at, answer.answered_at, answer.value) == (NOW, LATER, "b")


def test_a_question_that_an_answer_takes_away_asks_for_nothing():
    why = item("text", "why", required=True, show_if={"item": "a", "is": ["c"]})
    row, definition = started([item("single", "a"), why])
    sent = {"fields": {"a": ["b"], "why": [""]}, "offered": ["a", "why"]}
    assert save_page(row, definition, 0, **sent, saving=SAVING).is_done


def test_pages_without_questions_for_this_respondent_are_passed_over():
    for_rhodon = {"robot": ["rhodon"]}
    row, definition = started(
        [item("text", "a", show_if=for_rhodon)],
        [item("text", "b")],
        [item("text", "c", show_if=for_rhodon)],
        [item("text", "d")],
    )
    assert place(row, definition) == 1
    assert leave_page(row, definition, 1) == 3
    assert place(row, definition) == 3
    assert leave_page(row, definition, 3) is None
    assert finish(row, definition, LATER) is None
    assert (row.finished_at, row.reached) == (LATER, 4)


def test_a_questionnaire_that_asks_this_respondent_nothing_is_finished_at_once():
    row, definition = started([item("text", "a", show_if={"robot": ["rhodon"]})])
    assert place(row, definition) is None
    assert finish(row, definition, NOW) is None
    assert row.response_statuses(definition, row.given())["a"].missing == "not_asked"


def test_a_response_does_not_finish_without_a_required_answer():
    row, definition = started(
        [item("single", "a")],
        [item("single", "must", required=True, show_if={"item": "a", "is": ["c"]})],
        [item("text", "t")],
    )
    save_page(row, definition, 0, fields={"a": ["b"]}, offered=["a"], saving=SAVING)
    assert leave_page(row, definition, 0) == 2
    save_one(row, definition, "a", {"a": ["c"]}, SAVING)
    assert finish(row, definition, NOW) == 1
    assert row.finished_at is None


def test_a_finished_response_takes_no_more_answers_and_keeps_its_time():
    row, definition = started([item("single", "a")])
    finish(row, definition, NOW)
    with pytest.raises(ClosedError):
        save_one(row, definition, "a", {"a": ["a"]}, SAVING)
    with pytest.raises(ClosedError):
        save_page(row, definition, 0, fields={}, offered=["a"], saving=SAVING)
    finish(row, definition, LATER)
    assert Response.objects.get().finished_at == NOW
    assert row.response_statuses(definition, row.given())["a"].missing == "skipped"


@pytest.mark.django_db(transaction=True)
def test_two_pages_at_the_same_moment_make_one_response_and_one_answer():
    questionnaire = store(defined([item("single", "a")]), NOW)

    def race(value: str):
        try:
            row = begun(questionnaire)
            save_one(row, row.questionnaire.as_definition(), "a", {"a": [value]}, SAVING)
            return row.pk
        finally:
            connection.close()

    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(race, "abcd"))) == 1
    assert Answer.objects.get().value in "abcd"
