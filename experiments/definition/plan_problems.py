"""What is wrong with the plan of a study, in sentences that say where. Asks nothing but the study
itself.
"""

from collections.abc import Iterator

from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.plan import (
    AttentionCheck,
    ExpectedEffect,
    Hypothesis,
    Speeder,
    StudyPlan,
    own_texts,
)
from experiments.definition.schema import StudyDefinition
from surveys.documents import MAX_TEXT, duplicates


def problems(study: StudyDefinition) -> Iterator[str]:
    """Yield what is wrong with the plan of a study; nothing where there is none."""
    plan = study.plan
    if plan is None:
        return
    yield from _of_texts(plan)
    yield from duplicates("hypothesis", (one.key for one in plan.hypotheses))
    for one in plan.hypotheses:
        yield from (f"hypothesis {one.key}: {told}" for told in _of_hypothesis(one, study))
    yield from _of_families(plan)
    for rule in (*plan.attention_checks, *plan.speeders):
        yield from _of_rule(rule, study)
    for expected in plan.expected:
        yield from _of_expected(expected, study)
    yield from _of_the_same(plan)
    if plan.stopping and plan.participants is None:
        yield "there is a stopping rule, but no planned number of participants."


def _of_texts(plan: StudyPlan) -> Iterator[str]:
    for text in own_texts(plan):
        if "\x00" in text:
            yield "a text contains a null character; remove it."
        if len(text) > MAX_TEXT:
            yield f"a text is longer than {MAX_TEXT} characters."


def _of_hypothesis(one: Hypothesis, study: StudyDefinition) -> Iterator[str]:
    if not one.text.strip():
        yield "it has no text."
    if not one.analysis:
        yield "no analysis tests it; choose one of the declared analyses."
        return
    analysis = next((it for it in study.analyses if it.key == one.analysis), None)
    if analysis is None:
        yield f"there is no analysis {one.analysis}."
        return
    for measure in one.measures:
        if measure not in analysis.measures:
            yield f"the analysis {analysis.key} does not measure {measure}."
    yield from _of_contrast(one, analysis)
    yield from _of_effect(one, analysis, study)


def _of_contrast(one: Hypothesis, analysis: DeclaredAnalysis) -> Iterator[str]:
    if one.contrast is not None and one.contrast > len(analysis.contrasts):
        yield f"the analysis {analysis.key} has no contrast {one.contrast}."
    if analysis.test != "mixed" and one.direction != "different" and not analysis.contrasts:
        yield (
            f"it has a direction, but the analysis {analysis.key} compares all conditions at once:"
            " add a contrast."
        )


def _of_effect(
    one: Hypothesis, analysis: DeclaredAnalysis, study: StudyDefinition
) -> Iterator[str]:
    if one.effect and one.effect not in analysis.effects:
        yield f"the analysis {analysis.key} has no effect {one.effect}."
    if analysis.test == "mixed" and one.direction != "different":
        levels = next((len(it.levels) for it in study.factors if it.key == one.effect), 0)
        if levels != 2:
            yield "in a mixed model, only the effect of a factor with two levels has a direction."


def _of_families(plan: StudyPlan) -> Iterator[str]:
    yield from duplicates("family", (one.key for one in plan.families))
    known = {one.key for one in plan.hypotheses}
    for family in plan.families:
        if not family.hypotheses:
            yield f"family {family.key}: it has no hypothesis."
        for key in family.hypotheses:
            if key not in known:
                yield f"family {family.key}: there is no hypothesis {key}."
    named = [key for family in plan.families for key in dict.fromkeys(family.hypotheses)]
    for key in dict.fromkeys(key for key in named if named.count(key) > 1):
        yield f"hypothesis {key}: it is in several families."


def _of_rule(rule: AttentionCheck | Speeder, study: StudyDefinition) -> Iterator[str]:
    if rule.questionnaire not in {step.questionnaire for step in study.asking}:
        yield (
            f"a rule of exclusion names the questionnaire {rule.questionnaire}, which the study"
            " does not ask."
        )
    if isinstance(rule, AttentionCheck):
        if not rule.answer.strip():
            yield f"attention check {rule.questionnaire}.{rule.item}: its right answer is missing."
    elif rule.seconds is None and rule.median_share is None:
        yield f"speeders of {rule.questionnaire}: give seconds, or a share of the median."


def _of_the_same(plan: StudyPlan) -> Iterator[str]:
    checks = (f"{one.questionnaire}.{one.item}" for one in plan.attention_checks)
    yield from duplicates("attention check", checks)
    yield from duplicates("rule on speeders of", (one.questionnaire for one in plan.speeders))
    expected = (f"{one.measure} in {one.condition}" for one in plan.expected)
    yield from duplicates("expected effect on", expected)


def _of_expected(one: ExpectedEffect, study: StudyDefinition) -> Iterator[str]:
    if study.condition(one.condition) is None:
        yield f"expected effect on {one.measure}: there is no condition {one.condition or '–'}."
    if one.measure not in {measure for it in study.analyses for measure in it.measures}:
        yield f"expected effect on {one.measure}: no declared analysis measures it."
