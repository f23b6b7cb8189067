"""Problems of declared analyses are found before publishing."""

import pytest

from experiments.definition.problems import problems
from surveys.document_forms.problem_text import sentences
from tests.support.studies.studies import STUDY, small_study

GOOD = {"key": "doors", "title": {"en": "Doors"}, "measures": ["task_time", "experience.q1"]}
SIDES = {"title": {"en": "Shut"}, "first": ["shut"], "second": ["all_open"]}


def test_an_analysis_that_makes_sense_is_accepted():
    assert sentences(problems(small_study(analyses=[{**GOOD, "contrasts": [SIDES]}]))) == []


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"measures": []}, "it measures nothing; add at least one measure."),
        ({"measures": ["sus.score"]}, "the study does not ask the questionnaire sus."),
        ({"conditions": ["ajar"]}, "there is no condition ajar."),
        (
            {"contrasts": [{**SIDES, "first": ["all_open"]}]},
            "a contrast compares two different sides of at least one condition each.",
        ),
        ({"effects": ["condition"]}, "tests of means and ranks have contrasts, and no effects."),
        ({"test": "mixed"}, "a mixed model needs at least one effect."),
        (
            {"test": "counts", "effects": ["condition"], "post_hoc": True},
            "a model has effects, and neither contrasts nor post-hoc tests.",
        ),
        ({"covariates": ["age"]}, "only a model with effects has covariates."),
        (
            {"test": "mixed", "effects": ["condition"], "covariates": ["experience.q1"]},
            (
                "the covariate experience.q1 is neither age nor an item of a questionnaire about"
                " the person, such as ict.games."
            ),
        ),
        ({"test": "mixed", "effects": ["delay:help"]}, "there is no factor delay."),
    ],
)
def test_contradictions_are_problems_of_the_analysis(changes, problem):
    found = sentences(problems(small_study(analyses=[{**GOOD, **changes}])))
    assert f"Analysis doors: {problem}" in found


def test_measures_name_the_step_where_several_ask_a_questionnaire():
    before = {"kind": "questionnaire", "key": "before", "questionnaire": "experience"}
    steps = [{**before, "title": {"en": "Before"}}, *STUDY["steps"]]
    problem = (
        "Analysis doors: several steps ask the questionnaire experience; name the step in its"
        " measures, as in experience.{}.overall."
    )
    (key,) = (one["key"] for one in STUDY["steps"] if one["kind"] == "questionnaire")
    found = sentences(problems(small_study(analyses=[GOOD], steps=steps)))
    assert found == [problem.format(key)]
    good = {**GOOD, "measures": ["experience.before.q1", f"experience.{key}.q1"]}
    assert sentences(problems(small_study(analyses=[good], steps=steps))) == []


def test_participants_who_do_one_condition_each_may_have_a_model_with_age():
    model = {**GOOD, "test": "mixed", "effects": ["condition"], "covariates": ["age"]}
    assert sentences(problems(small_study(analyses=[model]))) == []
