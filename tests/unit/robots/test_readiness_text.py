import json
from pathlib import Path

from robots.readiness_text import REASONS, in_words, reason_of

GOLDEN = json.loads((Path(__file__).parents[2] / "golden/reasons.json").read_text())


def test_reasons_of_the_navigation_have_the_same_names_as_on_the_page():
    assert {said: reason_of(said)[0] for said in GOLDEN} == GOLDEN


def test_every_reason_is_said_in_words_and_none_as_it_stands_on_the_wire():
    assert {name for _pattern, name, _words in REASONS} - set(GOLDEN.values()) <= {
        "no_dock",
        "no_farther",
        "not_found",
    }
    assert [said for said, name in GOLDEN.items() if name and in_words(said) == said] == []
    assert in_words("something stands on the goal; 0.3 m beside it") == (
        "an obstacle is on that spot"
    )


def test_the_words_name_the_door_or_the_room():
    assert in_words("blocked: Lab door is closed") == "a door is closed (Lab door)"
    stands = "blocked: something stands in the way at (3.2, 4.0) in 50 % Hall"
    assert in_words(stands) == "an obstacle is in the way (50 % Hall)"


def test_an_unknown_reason_is_shown_as_the_robot_reported_it():
    assert in_words("the flux compensator hums") == "the flux compensator hums"
    assert in_words("dock") == "driving to its charging station"
