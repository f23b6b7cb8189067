"""The problems of a plan in itself."""

from collections.abc import Iterator

from msgspec.structs import astuple

from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.plan import (
    AttentionCheck,
    ExpectedEffect,
    Hypothesis,
    Speeder,
    StudyPlan,
)
from experiments.definition.schema import StudyDefinition
from surveys.documents import MAX_TEXT, Problem, duplicates, gettext_noop as _, within


def problems(study: StudyDefinition) -> Iterator[Problem]:
    plan = study.plan
    if plan is None:
        return
    parts = [*astuple(plan), *(one.text for one in plan.hypotheses)]
    parts += [one.answer for one in plan.attention_checks]
    for text in (one for one in parts if isinstance(one, str)):
        if "\x00" in text:
            yield Problem(_("a text contains a null character; remove it."))
        if len(text) > MAX_TEXT:
            yield Problem(_("a text is longer than %(n)d characters."), {"n": MAX_TEXT})
    yield from duplicates(_("Hypothesis"), (one.key for one in plan.hypotheses))
    for one in plan.hypotheses:
        yield from within(_of_hypothesis(one, study), None, _("hypothesis"), one.key)
    yield from _of_families(plan)
    rules: list[AttentionCheck | Speeder] = [*plan.attention_checks, *plan.speeders]
    for rule in rules:
        yield from _of_rule(rule, study)
    for expected in plan.expected:
        yield from _of_expected(expected, study)
    checks = (f"{one.questionnaire}.{one.item}" for one in plan.attention_checks)
    yield from duplicates(_("Attention check"), checks)
    yield from duplicates(_("Rule on fast answers"), (one.questionnaire for one in plan.speeders))
    effects = (f"{one.measure}, {one.condition}" for one in plan.expected)
    yield from duplicates(_("Expected effect"), effects)
    if plan.stopping and plan.participants is None:
        yield Problem(_("there is a stopping rule, but no planned number of participants."))


def _of_hypothesis(one: Hypothesis, study: StudyDefinition) -> Iterator[Problem]:
    if not one.text.strip():
        yield Problem(_("it has no text."))
    if not one.analysis:
        yield Problem(_("no analysis tests it; choose one of the declared analyses."))
        return
    analysis = next((it for it in study.analyses if it.key == one.analysis), None)
    if analysis is None:
        yield Problem(_("there is no analysis %(key)s."), {"key": one.analysis})
        return
    for measure in one.measures:
        if measure not in analysis.measures:
            words = _("the analysis %(key)s does not measure %(measure)s.")
            yield Problem(words, {"key": analysis.key, "measure": measure})
    if one.contrast is not None and one.contrast > len(analysis.contrasts):
        words = _("the analysis %(key)s has no contrast %(n)d.")
        yield Problem(words, {"key": analysis.key, "n": one.contrast})
    if one.effect and one.effect not in analysis.effects:
        words = _("the analysis %(key)s has no effect %(effect)s.")
        yield Problem(words, {"key": analysis.key, "effect": one.effect})
    if one.direction != "different":
        yield from _of_direction(one, analysis, study)


def _of_direction(
    one: Hypothesis, analysis: DeclaredAnalysis, study: StudyDefinition
) -> Iterator[Problem]:
    levels = next((len(it.levels) for it in study.factors if it.key == one.effect), 0)
    if not analysis.is_model:
        if not analysis.contrasts:
            words = _(
                "it has a direction, but the analysis %(key)s compares all conditions at once: add "
                "a contrast."
            )
            yield Problem(words, {"key": analysis.key})
    elif levels != 2:
        yield Problem(_("in a model, only the effect of a factor with two levels has a direction."))
    elif analysis.interacts(one.effect):
        words = _(
            "it has a direction, but the effect of %(key)s depends on another factor in the"
            " analysis %(analysis)s: declare a contrast, or leave out the interaction."
        )
        yield Problem(words, {"key": one.effect, "analysis": analysis.key})


def _of_families(plan: StudyPlan) -> Iterator[Problem]:
    yield from duplicates(_("Family"), (one.key for one in plan.families))
    known = {one.key for one in plan.hypotheses}
    for family in plan.families:
        name = ((_("family"), family.key),)
        if not family.hypotheses:
            yield Problem(_("it has no hypothesis."), names=name)
        for key in family.hypotheses:
            if key not in known:
                yield Problem(_("there is no hypothesis %(key)s."), {"key": key}, names=name)
    named = [key for family in plan.families for key in dict.fromkeys(family.hypotheses)]
    for key in dict.fromkeys(key for key in named if named.count(key) > 1):
        yield Problem(_("it is in several families."), names=((_("hypothesis"), key),))


def _of_rule(rule: AttentionCheck | Speeder, study: StudyDefinition) -> Iterator[Problem]:
    if rule.questionnaire not in {step.questionnaire for step in study.questionnaire_steps}:
        words = _(
            "a rule of exclusion names the questionnaire %(name)s, which the study does not ask."
        )
        yield Problem(words, {"name": rule.questionnaire})
    if isinstance(rule, AttentionCheck):
        if not rule.answer.strip():
            name = (_("attention check"), f"{rule.questionnaire}.{rule.item}")
            yield Problem(_("its right answer is missing."), names=(name,))
    elif rule.seconds is None and rule.median_share is None:
        name = (_("fast answers to"), rule.questionnaire)
        yield Problem(_("give seconds, or a share of the median."), names=(name,))


def _of_expected(one: ExpectedEffect, study: StudyDefinition) -> Iterator[Problem]:
    name = ((_("expected effect on"), one.measure),)
    if study.condition(one.condition) is None:
        words = _("there is no condition %(key)s.")
        yield Problem(words, {"key": one.condition or "–"}, names=name)
    if one.measure not in {measure for it in study.analyses for measure in it.measures}:
        yield Problem(_("no declared analysis measures it."), names=name)
