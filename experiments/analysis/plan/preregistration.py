"""A study's definition as the text of a preregistration, in Markdown: the questions of the OSF
Preregistration in their order, which include those of AsPredicted. Each is answered from the
definition, or said to be unanswered; nothing is added.
"""

from collections.abc import Iterable, Iterator

from experiments.analysis.dataset.records import FreezeRecord
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.plan import (
    AttentionCheck,
    Hypothesis,
    Speeder,
    StudyPlan,
    hypotheses_of,
    measures_of,
)
from experiments.definition.schema import BalanceFactor, Condition, StudyDefinition
from surveys.documents import spoken

UNANSWERED = "*Unanswered: the definition of the study does not say.*"
NO_PLAN = "**No plan was declared: every analysis of this study is exploratory.**"
ORDERS = {
    "fixed": "in the order of the definition",
    "all": "in one of all orders",
    "balanced": "in an order of a Latin square (Williams)",
}
TESTS = {
    "means": "paired t tests within participants, Welch's t tests between them; of several"
    " conditions at once, Friedman's test within and Welch's analysis of variance between",
    "ranks": "Wilcoxon's signed ranks within participants, Mann-Whitney between them; of several"
    " conditions at once, Friedman's test within and Kruskal-Wallis between",
    "mixed": "a linear mixed model with an intercept for each participant, by REML, with Wald"
    " tests",
}
INCOMPLETE = {
    "keep": "Participants with missing conditions or answers are kept in every test for which they"
    " have values.",
    "drives": "Participants who lack a drive in one of their conditions are excluded.",
    "answers": "Participants who lack a drive in one of their conditions, or a finished"
    " questionnaire of the study, are excluded.",
}
DIRECTIONS = {
    "different": "a difference, two-sided",
    "greater": "the first side is greater; tested two-sided",
    "less": "the first side is smaller; tested two-sided",
}
Answer = tuple[str, Iterable[str]]  # a question, and the paragraphs or lines that answer it


def preregistration(study: StudyDefinition, freeze: FreezeRecord | None) -> str:
    """Return the text of a preregistration of a study.

    Args:
        study: its definition.
        freeze: when it was frozen, if that is known.
    """
    lines = [f"# Preregistration: {_say(study, study.title) or study.slug}", ""]
    lines += [*_freeze_lines(study, freeze), ""]
    if study.plan is None:
        lines += [NO_PLAN, ""]
    plan = study.plan or StudyPlan()
    for section, answers in _sections(study, plan, freeze):
        lines += [f"## {section}", ""]
        for question, given in answers:
            said = [line for line in given if line.strip()]
            lines += [f"### {question}", "", *(said or [UNANSWERED]), ""]
    return "\n".join(lines)


def _freeze_lines(study: StudyDefinition, freeze: FreezeRecord | None) -> Iterator[str]:
    yield f"Study `{study.slug}`, version {study.version}."
    if freeze is None:
        yield "When the definition was frozen is unknown."
        return
    if not freeze.frozen_at:
        yield "This is a draft: the definition is not frozen and may still change."
        yield f"SHA-256 of the draft: `{freeze.sha256}`."
        return
    yield f"Frozen on {freeze.frozen_at} (SHA-256 of the definition: `{freeze.sha256}`)."
    yield f"Before data: {before_data(freeze)}."


def before_data(freeze: FreezeRecord | None) -> str:
    """Return whether a definition was frozen before there were data, and what limits that."""
    if freeze is not None and not freeze.frozen_at:
        return "no, it is a draft"
    if freeze is None or freeze.before_data is None:
        return "unknown"
    told = (
        "yes, no participant of this version had joined"
        if freeze.before_data
        else "no, a participant of this version had already joined"
    )
    if not freeze.earlier:
        return told
    return f"{told}; but {freeze.earlier} had joined earlier versions, whose data were known"


def _sections(
    study: StudyDefinition, plan: StudyPlan, freeze: FreezeRecord | None
) -> Iterator[tuple[str, tuple[Answer, ...]]]:
    yield "Study information", _information(study, plan)
    yield "Design plan", _design(study, plan)
    yield "Sampling plan", _sampling(study, plan, freeze)
    yield "Variables", _variables(study)
    yield "Analysis plan", _analysis(study, plan)
    yield "Other", (("Other", [plan.notes, study.source]),)


def _information(study: StudyDefinition, plan: StudyPlan) -> tuple[Answer, ...]:
    return (
        ("Title", [_say(study, study.title)]),
        ("Description", [_say(study, study.intro)]),
        ("Research question", [plan.question]),
        ("Hypotheses", [_hypothesis(study, one) for one in plan.hypotheses]),
    )


def _hypothesis(study: StudyDefinition, one: Hypothesis) -> str:
    analysis = next((it for it in study.analyses if it.key == one.analysis), None)
    if analysis is None:
        return f"- **{one.key}**: {one.text}"
    parts = [
        f"analysis `{analysis.key}`",
        ", ".join(f"`{it}`" for it in measures_of(one, analysis)),
    ]
    if one.contrast is not None and one.contrast <= len(analysis.contrasts):
        parts.append(f"contrast “{_say(study, analysis.contrasts[one.contrast - 1].title)}”")
    if one.effect:
        parts.append(f"effect `{one.effect}`")
    expected = f"Expected: {DIRECTIONS[one.direction]}."
    return f"- **{one.key}**: {one.text} {expected} Tested by: {'; '.join(parts)}."


# --- design and sampling --------------------------------------------------------------------------


def _design(study: StudyDefinition, plan: StudyPlan) -> tuple[Answer, ...]:
    return (
        ("Study type", ["Experiment: participants are assigned to conditions."]),
        ("Blinding", [plan.blinding]),
        ("Study design", list(_study_design(study))),
        ("Randomization", [_randomization(study)]),
    )


def _study_design(study: StudyDefinition) -> Iterator[str]:
    within = study.allocation.design == "within"
    often = "do all of their conditions" if within else "do one condition each"
    yield f"Participants {often}."
    for factor in study.factors:
        levels = ", ".join(_say(study, level.title) for level in factor.levels)
        yield f"- Factor `{factor.key}`, {factor.design} participants: {levels}"
    for condition in study.conditions:
        yield f"- Condition `{condition.key}`: {described(study, condition)}"


def described(study: StudyDefinition, condition: Condition) -> str:
    """Return what a condition is, in words."""
    parts = [
        _say(study, condition.title),
        f"robot {condition.robot} at {condition.site}",
        f"assistance {condition.assist}",
        f"controllers {', '.join(condition.controllers) or 'none'}",
    ]
    if condition.actions:
        parts.append(f"actions {', '.join(condition.actions)}")
    if condition.doors_closed:
        parts.append(f"closed {', '.join(condition.doors_closed)}")
    if condition.speed.linear is not None:
        parts.append(f"at most {condition.speed.linear:g} m/s")
    if condition.network.control is not None or condition.network.video is not None:
        parts.append("impaired network")
    if condition.access == "invitation":
        parts.append("by invitation")
    parts.extend(
        f"pages {', '.join(map(str, pages))} of the instructions `{step.key}`, for some conditions"
        " only"
        for step in study.steps
        if (pages := step.own_pages(condition.key))
    )
    return "; ".join(part for part in parts if part)


def _balance_factor(factor: BalanceFactor) -> str:
    limits = ", ".join(f"{limit:g}" for limit in factor.limits)
    return f"{factor.item} (from {limits})" if limits else factor.item


def _randomization(study: StudyDefinition) -> str:
    allocation = study.allocation
    when = (
        "Before reading instructions that depend on the condition"
        if study.tells_condition
        else "On first getting the robot"
    )
    told = (
        f"{when}, a participant is assigned to the cell with the fewest places filled or in"
        f" progress with probability {allocation.best_probability:g}, otherwise to one of the"
        " others; ties and chance follow from a seed that is kept."
    )
    if allocation.balance:
        factors = ", ".join(_balance_factor(one) for one in allocation.balance)
        alike = (
            "each of these factors, added up (minimization)"
            if allocation.balancing == "minimization"
            else "all of these factors (strata)"
        )
        told += f" The places that count are those of participants alike in {alike}: {factors}."
    told += (
        " A participant who has seen nothing of the condition gives up the place and is assigned"
        " again."
    )
    if allocation.design == "within":
        told += f" Conditions are done {ORDERS[allocation.order]}."
    return told


def _sampling(
    study: StudyDefinition, plan: StudyPlan, freeze: FreezeRecord | None
) -> tuple[Answer, ...]:
    quota = study.allocation.quota
    size = [f"{plan.participants} complete cases."] if plan.participants is not None else []
    size += [f"At most {quota} participants in each cell."] if quota is not None else []
    has_started = freeze is not None and bool(freeze.frozen_at)
    existing = f"Frozen before data: {before_data(freeze)}." if has_started else ""
    return (
        ("Existing data", [existing]),
        ("Data collection procedures", [study.recruitment, study.compensation]),
        ("Sample size", size),
        ("Sample size rationale", [plan.rationale, *_expected(plan)]),
        ("Stopping rule", [plan.stopping]),
    )


def _expected(plan: StudyPlan) -> Iterator[str]:
    if plan.expected:
        yield f"Expected effects, to be found with a power of {plan.power:g}:"
    for one in plan.expected:
        more = "" if one.sd is None else f", SD {one.sd:g}"
        more += "" if one.correlation is None else f", correlation {one.correlation:g}"
        where = f"`{one.measure}` in `{one.condition}`"
        yield f"- {where}: {one.difference:+g} against the first condition{more}"


# --- variables and analysis -----------------------------------------------------------------------


def _variables(study: StudyDefinition) -> tuple[Answer, ...]:
    manipulated = [f"- `{one.key}`: {_say(study, one.title)}" for one in study.factors]
    if not manipulated:
        manipulated = [f"- `{one.key}`: {_say(study, one.title)}" for one in study.conditions]
    measures = dict.fromkeys(measure for one in study.analyses for measure in one.measures)
    asked = dict.fromkeys(step.questionnaire for step in study.asking)
    return (
        ("Manipulated variables", manipulated),
        ("Measured variables", [f"- `{one}`" for one in measures]),
        ("Indices", [f"- Scores of the questionnaire `{one}`" for one in asked]),
    )


def _analysis(study: StudyDefinition, plan: StudyPlan) -> tuple[Answer, ...]:
    is_answered = study.plan is not None
    return (
        ("Statistical models", [_model(study, one) for one in study.analyses]),
        ("Transformations", []),
        ("Inference criteria", list(_criteria(study, plan)) if is_answered else []),
        ("Data exclusion", list(_rules(plan)) if is_answered else [FAULTS]),
        ("Missing data", [plan.missing_data, *([INCOMPLETE[plan.incomplete]] * is_answered)]),
        ("Exploratory analysis", list(_exploratory(study)) if is_answered else []),
    )


FAULTS = "- Drives that were ended by a fault of the platform are excluded."


def _model(study: StudyDefinition, one: DeclaredAnalysis) -> str:
    contrasts = "; ".join(_say(study, it.title) for it in one.contrasts)
    told = f"- `{one.key}` ({_say(study, one.title)}): {TESTS[one.test]}. Measures: "
    told += ", ".join(f"`{measure}`" for measure in one.measures) + "."
    told += f" Contrasts: {contrasts}." if contrasts else ""
    told += " Each pair of conditions is compared as well." if one.post_hoc else ""
    told += f" Effects: {', '.join(one.effects)}; {one.coding} coding." if one.effects else ""
    return told


def _criteria(study: StudyDefinition, plan: StudyPlan) -> Iterator[str]:
    yield f"p values are two-sided; a corrected p below {plan.alpha:g} is significant."
    if study.analyses:
        yield "The tests of one analysis are corrected together by Holm's method."
    for family in plan.families:
        named = ", ".join(family.hypotheses)
        yield f"- The tests of {named} are corrected together (family `{family.key}`)."


def _rules(plan: StudyPlan) -> Iterator[str]:
    for check in plan.attention_checks:
        yield f"- {rule_in_words(check)}"
    for speeder in plan.speeders:
        yield f"- {rule_in_words(speeder)}"
    yield f"- {INCOMPLETE[plan.incomplete]}"
    yield FAULTS


def rule_in_words(rule: AttentionCheck | Speeder) -> str:
    """Return a rule of exclusion as a sentence."""
    if isinstance(rule, AttentionCheck):
        return (
            f"Attention check: participants whose answer to `{rule.questionnaire}.{rule.item}` is"
            f" not “{rule.answer}” are excluded."
        )
    limits = [] if rule.seconds is None else [f"{rule.seconds:g} s"]
    if rule.median_share is not None:
        limits.append(f"{rule.median_share:g} of the median time")
    return (
        f"Speeders: participants who answer `{rule.questionnaire}` in less than"
        f" {' or '.join(limits)} are excluded."
    )


def _exploratory(study: StudyDefinition) -> Iterator[str]:
    others = [one.key for one in study.analyses if not hypotheses_of(study.plan, one)]
    yield "Every test that no hypothesis names is exploratory, and is marked so in the report."
    if others:
        yield f"Declared without a hypothesis: {', '.join(f'`{key}`' for key in others)}."


def _say(study: StudyDefinition, text: dict[str, str]) -> str:
    return spoken(text, study.languages[0] if study.languages else "en")
