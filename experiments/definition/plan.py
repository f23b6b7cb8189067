"""The plan of a study: what its researchers commit themselves to before there are data.

A plan is frozen with the study's version. Its hypotheses name the declared analyses
(experiments/definition/analyses.py) that test them: such tests are *confirmatory*, every other one
is *exploratory*. Its rules of exclusion are applied by experiments/dataset/exclusions.py,
its expected effects are simulated by experiments/analysis/power/.

All texts are the researchers' own, in one language: participants never see them.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from experiments.definition.analyses import DeclaredAnalysis, Measure
from robots.api.messages import Positive
from surveys.documents import DocumentPart, Key, Slug

Direction = Literal["different", "greater", "less"]
Proportion = Annotated[float, Meta(gt=0.0, lt=1.0)]
Correlation = Annotated[float, Meta(ge=0.0, lt=1.0)]
EXPLORATORY = "exploratory"


class Hypothesis(DocumentPart, frozen=True, kw_only=True):
    """A hypothesis, and the tests of one declared analysis that decide on it.

    `measures` are those of the analysis that it is about (none: all of them), `contrast` the number
    of one of its contrasts, from 1 (None: all), `effect` the effect of a mixed model (empty: all).
    With `greater` the first side of the contrast, or the first level of the factor, is expected to
    have the greater values.
    """

    key: Key
    text: str = ""
    direction: Direction = "different"
    analysis: str = ""
    measures: Annotated[tuple[Measure, ...], Meta(max_length=40)] = ()
    contrast: Annotated[int, Meta(ge=1, le=40)] | None = None
    effect: str = ""


class HypothesisFamily(DocumentPart, frozen=True, kw_only=True):
    """Hypotheses whose tests are corrected together by Holm's method. A hypothesis that is in no
    family is corrected with the tests of its analysis.
    """

    key: Key
    hypotheses: tuple[Key, ...] = ()


class AttentionCheck(DocumentPart, frozen=True, kw_only=True):
    """An item with a right answer; participants who give another one are excluded."""

    questionnaire: Slug
    item: Key
    answer: str = ""


class Speeder(DocumentPart, frozen=True, kw_only=True):
    """Participants who answer a questionnaire faster than `seconds`, or than this share of the
    median of all who answered it, are excluded.
    """

    questionnaire: Slug
    seconds: Positive | None = None
    median_share: Proportion | None = None


class ExpectedEffect(DocumentPart, frozen=True, kw_only=True):
    """What is expected of a measure in a condition: by how much its mean differs from that of the
    study's first condition, in the unit of the measure; its standard deviation, and the correlation
    of a participant's values in two conditions. Of a proportion, a count or a time, `level` is what
    is expected in the condition itself: a share, events a minute, or the median in seconds.
    """

    measure: Measure
    condition: str = ""
    difference: float = 0.0
    level: Positive | None = None
    sd: Positive | None = None
    correlation: Correlation | None = None


class StudyPlan(DocumentPart, frozen=True, kw_only=True):
    """What is decided before there are data.

    `participants` are the complete cases that are wanted; `alpha` is the level of significance,
    `power` the wanted chance to find each expected effect. `incomplete` participants are kept, or
    excluded when they lack a drive, or a drive or an answered questionnaire.
    """

    question: str = ""
    hypotheses: Annotated[tuple[Hypothesis, ...], Meta(max_length=40)] = ()
    families: Annotated[tuple[HypothesisFamily, ...], Meta(max_length=20)] = ()
    alpha: Proportion = 0.05
    attention_checks: Annotated[tuple[AttentionCheck, ...], Meta(max_length=40)] = ()
    speeders: Annotated[tuple[Speeder, ...], Meta(max_length=40)] = ()
    incomplete: Literal["keep", "drives", "answers"] = "keep"
    participants: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    rationale: str = ""
    stopping: str = ""
    power: Proportion = 0.8
    expected: Annotated[tuple[ExpectedEffect, ...], Meta(max_length=200)] = ()
    blinding: str = ""
    missing_data: str = ""
    notes: str = ""


def own_texts(plan: StudyPlan) -> Iterator[str]:
    """Yield every text that researchers wrote."""
    yield from (plan.question, plan.rationale, plan.stopping)
    yield from (plan.blinding, plan.missing_data, plan.notes)
    yield from (one.text for one in plan.hypotheses)
    yield from (one.answer for one in plan.attention_checks)


def is_confirmatory(plan: StudyPlan | None) -> bool:
    """Tell whether a plan has hypotheses, so that some tests of its study are confirmatory."""
    return plan is not None and bool(plan.hypotheses)


def measures_of(hypothesis: Hypothesis, analysis: DeclaredAnalysis) -> tuple[Measure, ...]:
    """Return the measures of an analysis that a hypothesis is about."""
    return hypothesis.measures or analysis.measures


def hypotheses_of(plan: StudyPlan | None, analysis: DeclaredAnalysis) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a plan that an analysis tests."""
    known = plan.hypotheses if plan is not None else ()
    return tuple(one for one in known if one.analysis == analysis.key)


def deciding_hypotheses(
    plan: StudyPlan | None,
    analysis: DeclaredAnalysis,
    measure: str,
    *,
    contrast: int | None = None,
    effect: str = "",
) -> tuple[Hypothesis, ...]:
    """Return the hypotheses that one test of an analysis decides on.

    Args:
        plan: of the study, if there is one.
        analysis: one of the study's declared analyses.
        measure: what is tested.
        contrast: the number of the contrast, from 1; None for a test of all conditions at once.
        effect: of a mixed model.
    """
    return tuple(
        one
        for one in hypotheses_of(plan, analysis)
        if measure in measures_of(one, analysis)
        and one.contrast in {None, contrast}
        and one.effect in {"", effect}
    )
