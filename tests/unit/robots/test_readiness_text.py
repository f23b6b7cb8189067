import string

import pytest
from django.utils import translation

from robots.api.reasons import ReasonCode
from robots.readiness_text import in_words


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        ("dock", "driving to its charging station"),
        ("door_closed: 50 % {Lab} door", "a door is closed (50 % {Lab} door)"),
        ("goal_taken: 0.3 m", "an obstacle is on that spot"),
        ("rca: /dock: no dock: in sight", "/dock: no dock: in sight"),
    ],
)
def test_a_reason_is_shown_as_a_clause_with_its_value(reason, text):
    assert in_words(reason) == text


def test_a_reason_is_translated_where_it_is_shown():
    with translation.override("es"):
        assert in_words("boxed_in") != "it has no room to move"


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        ("blocked: Lab door is closed", "blocked: Lab door is closed"),
        ("the flux_2 compensator: hums", "the flux_2 compensator: hums"),
        ("shelf_in_the_way: Kitchen: 2", "shelf in the way: Kitchen: 2"),
        ("too_many", "too many"),
        ("", ""),
    ],
    ids=["of an older agent", "of another adapter", "of a newer agent", "without text", "none"],
)
def test_a_reason_without_a_known_text_is_readable(reason, text):
    assert in_words(reason) == text


@pytest.mark.parametrize("code", ReasonCode)
def test_the_texts_of_a_reason_have_no_other_value_than_its_own(code):
    for text in (code.clause or "", code.sentence):
        assert {name for _, name, _, _ in string.Formatter().parse(text)} <= {None, "what"}
    assert not code.sentence or code.sentence.endswith(".")
