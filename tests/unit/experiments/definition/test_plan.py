"""A plan is checked before it is published: each mistake is a sentence."""

import msgspec
import pytest

from experiments.definition.plan import StudyPlan, deciding_hypotheses
from experiments.definition.problems import problems
from experiments.definition.schema import digest
from surveys.document_forms.problem_text import sentences
from tests.support.analysis.planned import ANALYSES, PLAN, hypothesis, plan_with, planned_study
from tests.support.studies.studies import small_study


def plan_problems(study):
    found = sentences(problems(study))
    return [one.removeprefix("Plan: ") for one in found if one.startswith("Plan: ")]


def with_hypotheses(*found):
    return plan_with(hypotheses=list(found))


def test_a_good_plan_has_no_problems():
    assert plan_problems(planned_study(PLAN)) == []


def test_plan_is_part_of_what_is_frozen():
    assert digest(planned_study(None)) == digest(small_study(analyses=ANALYSES))
    assert digest(planned_study(PLAN)) != digest(planned_study(None))


@pytest.mark.parametrize(
    ("plan", "problem"),
    [
        (with_hypotheses(hypothesis(text=" ")), "hypothesis h1: it has no text."),
        (
            with_hypotheses(hypothesis(analysis="")),
            "hypothesis h1: no analysis tests it; choose one of the declared analyses.",
        ),
        (with_hypotheses(hypothesis(analysis="x")), "hypothesis h1: there is no analysis x."),
        (
            with_hypotheses(hypothesis(measures=["path"])),
            "hypothesis h1: the analysis driving does not measure path.",
        ),
        (
            with_hypotheses(hypothesis(contrast=2)),
            "hypothesis h1: the analysis driving has no contrast 2.",
        ),
        (
            with_hypotheses(hypothesis(effect="delay")),
            "hypothesis h1: the analysis driving has no effect delay.",
        ),
        (with_hypotheses(hypothesis(), hypothesis()), "Hypothesis “h1” appears 2 times."),
        (
            plan_with(families=[{"key": "f", "hypotheses": ["h2"]}]),
            "family f: there is no hypothesis h2.",
        ),
        (plan_with(families=[{"key": "f"}]), "family f: it has no hypothesis."),
        (
            plan_with(families=[{"key": key, "hypotheses": ["h1"]} for key in ("f", "g")]),
            "hypothesis h1: it is in several families.",
        ),
        (
            plan_with(speeders=[{"questionnaire": "sus", "seconds": 5}]),
            "a rule of exclusion names the questionnaire sus, which the study does not ask.",
        ),
        (
            plan_with(speeders=[{"questionnaire": "experience"}]),
            "fast answers to experience: give seconds, or a share of the median.",
        ),
        (
            plan_with(attention_checks=[{"questionnaire": "experience", "item": "q1"}]),
            "attention check experience.q1: its right answer is missing.",
        ),
        (
            plan_with(expected=[{"measure": "task_time", "condition": "x"}]),
            "expected effect on task_time: there is no condition x.",
        ),
        (
            plan_with(expected=[{"measure": "path", "condition": "shut"}]),
            "expected effect on path: no declared analysis measures it.",
        ),
        (
            plan_with(participants=None, stopping="Stop in May."),
            "there is a stopping rule, but no planned number of participants.",
        ),
        (plan_with(notes="\x00"), "a text contains a null character; remove it."),
        (plan_with(notes="x" * 4001), "a text is longer than 4000 characters."),
    ],
)
def test_each_mistake_is_a_sentence(plan, problem):
    assert plan_problems(planned_study(plan)) == [problem]


def test_a_direction_needs_two_sides():
    (driving, answers) = planned_study(None).analyses
    at_once = msgspec.structs.replace(driving, contrasts=())
    study = msgspec.structs.replace(planned_study(PLAN), analyses=(at_once, answers))
    (problem,) = plan_problems(study)
    assert problem.startswith("hypothesis h1: it has a direction, but the analysis driving")


def crossed(**about):
    """A study of two crossed factors, and a hypothesis about the effect of one."""
    names = {"delay": ("none", "long"), "help": ("alone", "helped")}
    factors = [
        {"key": key, "title": {"en": key}, "levels": [{"key": one, "title": {}} for one in levels]}
        for key, levels in names.items()
    ]
    base = planned_study(None).conditions[0]
    conditions = [
        msgspec.structs.replace(base, key=f"{a}_{b}", levels={"delay": a, "help": b})
        for a in names["delay"]
        for b in names["help"]
    ]
    model = {"key": "driving", "title": {}, "measures": ["task_time"], "test": "mixed"}
    plan = plan_with(hypotheses=[hypothesis(effect="delay", direction="less", measures=[])])
    study = planned_study(plan, factors=factors, analyses=[{**model, **about}])
    return msgspec.structs.replace(study, conditions=tuple(conditions))


def test_a_direction_needs_a_factor_that_does_not_interact():
    assert plan_problems(crossed(effects=["delay", "help"])) == []
    (problem,) = plan_problems(crossed(effects=["delay", "help", "delay:help"]))
    assert problem == (
        "hypothesis h1: it has a direction, but the effect of delay depends on another factor in"
        " the analysis driving: declare a contrast, or leave out the interaction."
    )


def test_a_test_decides_on_the_hypotheses_that_name_it():
    study = planned_study(
        with_hypotheses(hypothesis(), hypothesis(key="h2", measures=[], contrast=1))
    )
    keys = lambda measure: [
        one.key for one in deciding_hypotheses(study.plan, study.analyses[0], measure, contrast=1)
    ]
    assert (keys("task_time"), keys("stops")) == (["h1", "h2"], ["h2"])
    assert deciding_hypotheses(study.plan, study.analyses[1], "experience.q1", contrast=1) == ()


def test_everything_in_a_plan_may_be_left_out():
    assert plan_problems(planned_study({})) == []
    assert msgspec.convert({}, StudyPlan).alpha == 0.05
