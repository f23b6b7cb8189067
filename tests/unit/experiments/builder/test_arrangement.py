"""Conditions follow from factors, and steps for each condition are repeated."""

import msgspec
import pytest

from experiments.builder.arrangement import Renamed, arranged, renamed
from experiments.definition.factors import problems, setting_of
from experiments.definition.problems import doubts
from experiments.definition.schema import StudyDefinition
from surveys.document_forms.problem_text import sentences
from tests.support.studies.studies import STUDY, small_study


def factor(key: str, setting: str, *levels: tuple[str, str, object]) -> dict:
    """A factor within participants; a level is (key, title, value of the setting)."""
    written = [
        {"key": level, "title": {"en": title}, "sets": {setting: value}}
        for level, title, value in levels
    ]
    about = {"key": key, "title": {"en": key.title()}, "design": "within"}
    return {**about, "changes": [setting], "levels": written}


DELAY = factor("delay", "video_delay", ("d0", "0 ms", 0.0), ("d300", "300 ms", 0.3))
HELP = factor("help", "assist", ("alone", "None", "off"), ("long", "Long", "steer"))
BLANK = small_study().conditions[0]


def with_factors(study: StudyDefinition, *factors: dict) -> StudyDefinition:
    document = msgspec.to_builtins(study) | {"factors": list(factors)}
    return arranged(msgspec.convert(document, StudyDefinition), study, BLANK)


def test_each_cell_is_a_condition_with_what_its_levels_set():
    study = with_factors(small_study(conditions=[], courses=[]), DELAY, HELP)
    assert [one.key for one in study.conditions] == [
        *("d0_alone", "d0_long", "d300_alone", "d300_long")
    ]
    assert [setting_of(one, "video_delay") for one in study.conditions] == [0.0, 0.0, 0.3, 0.3]
    assert [one.assist for one in study.conditions] == ["off", "steer", "off", "steer"]
    assert study.conditions[3].title == {"en": "300 ms, Long"}
    assert list(problems(study)) == []


def test_arranging_twice_changes_nothing():
    once = with_factors(small_study(), DELAY, HELP)
    assert arranged(once, once, BLANK) == once


def test_own_names_and_titles_of_conditions_are_kept():
    study = with_factors(small_study(), DELAY)
    assert [one.key for one in study.conditions] == ["all_open", "shut"]
    assert [one.doors_closed for one in study.conditions] == [(), ("door",)]
    titles = [one.title["en"] for one in study.conditions]
    assert titles == [one["title"]["en"] for one in STUDY["conditions"]]


def test_automatic_names_follow_the_levels_with_every_reference():
    study = with_factors(small_study(conditions=[], courses=[]), DELAY)
    analysis = {"key": "a", "title": {"en": "A"}, "conditions": ["d0", "d300"]}
    document = msgspec.to_builtins(study) | {"analyses": [analysis]}
    study = msgspec.convert(document, StudyDefinition)
    later = {**DELAY["levels"][1], "key": "late", "title": {"en": "Late"}}
    changed = {**DELAY, "levels": [DELAY["levels"][0], later]}
    names = Renamed(levels={"delay": {"d300": "late"}})
    moved = renamed(msgspec.to_builtins(study), names) | {"factors": [changed]}
    study = arranged(msgspec.convert(moved, StudyDefinition), study, BLANK)
    assert [one.key for one in study.conditions] == ["d0", "late"]
    assert study.conditions[1].title == {"en": "Late"}
    assert study.analyses[0].conditions == ("d0", "late")


def test_references_are_renamed_everywhere_and_two_can_swap():
    document = {
        "conditions": [{"key": "x", "levels": {"delay": "a"}}],
        "analyses": [{"effects": ["delay:help"], "contrasts": [{"first": ["x"], "second": []}]}],
        "plan": {
            "hypotheses": [{"analysis": "main", "effect": "delay"}],
            "expected": [{"condition": "x"}],
            "families": [{"hypotheses": ["h1"]}],
        },
        "steps": [{"leaves": [{"conditions": ["x"], "text": {"en": "delay"}}]}],
    }
    names = Renamed(
        factors={"delay": "lag", "help": "delay"},
        levels={"delay": {"a": "b", "b": "a"}},
        conditions={"x": "y"},
        analyses={"main": "all"},
    )
    found = renamed(document, names)
    assert found["conditions"][0] == {"key": "x", "levels": {"lag": "b"}}
    assert found["analyses"][0]["effects"] == ["lag:delay"]
    assert found["analyses"][0]["contrasts"][0]["first"] == ["y"]
    assert found["plan"]["hypotheses"] == [{"analysis": "all", "effect": "lag"}]
    assert found["plan"]["expected"] == [{"condition": "y"}]
    assert found["steps"][0]["leaves"][0] == {"conditions": ["y"], "text": {"en": "delay"}}


def test_a_removed_factor_leaves_one_condition_for_each_remaining_cell():
    study = with_factors(small_study(conditions=[], courses=[]), DELAY, HELP)
    study = with_factors(study, DELAY)
    assert [one.key for one in study.conditions] == ["d0", "d300"]
    assert [one.levels for one in study.conditions] == [{"delay": "d0"}, {"delay": "d300"}]


def test_questionnaires_after_the_task_are_repeated_with_it():
    study = with_factors(small_study(), DELAY)
    assert [step.repeat for step in study.steps] == [True, True]
    assert list(doubts(study)) == []
    task, questionnaire = study.steps
    steps = (task, msgspec.structs.replace(questionnaire, repeat=False))
    unsure = msgspec.structs.replace(study, steps=steps)
    assert arranged(unsure, unsure, BLANK).steps == unsure.steps, "what was unticked stays so"
    (sentence,) = sentences(doubts(unsure))
    assert "answer this questionnaire only once" in sentence


@pytest.mark.parametrize(
    ("factors", "sentence"),
    [
        (
            [{**DELAY, "changes": []}],
            "the level d0 sets what the factor does not change: delay of the video.",
        ),
        (
            [{**DELAY, "changes": ["video_delay", "assist"]}],
            "the level d0 does not set what the factor changes: assistance.",
        ),
        (
            [DELAY, {**DELAY, "key": "lag"}],
            "another factor changes the same setting: delay of the video.",
        ),
    ],
)
def test_levels_set_exactly_what_their_factor_changes(factors, sentence):
    study = msgspec.to_builtins(small_study()) | {"factors": factors}
    study = msgspec.convert(study, StudyDefinition)
    assert any(sentence in text for text in sentences(problems(study)))


def test_condition_that_differs_from_its_levels_is_a_problem():
    study = with_factors(small_study(), DELAY)
    wrong = msgspec.structs.replace(study.conditions[1], network=BLANK.network)
    study = msgspec.structs.replace(study, conditions=(study.conditions[0], wrong))
    sentence = ["Condition shut: it differs from what its levels set: delay of the video."]
    assert sentences(problems(study)) == sentence


def test_more_cells_than_a_study_may_have_are_refused():
    levels = [{"key": f"l{n}", "title": {"en": "L"}} for n in range(3)]
    many = [{"key": f"f{n}", "title": {"en": "F"}, "levels": levels} for n in range(3)]
    study = with_factors(small_study(), *many)
    assert len(study.conditions) == 2
    assert any("have 27 cells; at most 24" in text for text in sentences(problems(study)))
