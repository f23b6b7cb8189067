"""The plan of a study: hypotheses, exclusions and expected effects, decided before there are data
and frozen with the version. Tests of declared analyses that a hypothesis names are *confirmatory*,
all others *exploratory*. experiments/dataset/exclusions.py applies the exclusions,
experiments/analysis/power/ simulates the expected effects. Texts are in one language: participants
never see them.
"""

from typing import Annotated, Literal

from msgspec import Meta

from experiments.definition.analyses import DeclaredAnalysis, Measure
from robots.api.messages import Positive
from surveys.documents import DocumentPart, Key, Slug

Direction = Literal["different", "greater", "less"]
# Of the record of a drive; experiments/dataset/record_quality.py finds them.
Fault = Literal[
    "no_states", "rate", "gap", "clock_unknown", "clock", "condition", "operator", "frozen_video"
]
Proportion = Annotated[float, Meta(gt=0.0, lt=1.0)]
Correlation = Annotated[float, Meta(ge=0.0, lt=1.0)]
EXPLORATORY = "exploratory"


class Hypothesis(DocumentPart, frozen=True, kw_only=True):
    """A hypothesis and the tests of a declared analysis that decide it: those of `measures`
    (empty: all), of the `contrast` with this number from 1 (None: all) or of the `effect` of a
    model (empty: all). `greater`: the first side of the contrast, or the first level of the factor,
    has the greater values.
    """

    key: Key
    text: str = ""
    direction: Direction = "different"
    analysis: str = ""
    measures: Annotated[tuple[Measure, ...], Meta(max_length=40)] = ()
    contrast: Annotated[int, Meta(ge=1, le=40)] | None = None
    effect: str = ""


class HypothesisFamily(DocumentPart, frozen=True, kw_only=True):
    """Hypotheses whose tests are corrected together (Holm); others are with their analysis."""

    key: Key
    hypotheses: tuple[Key, ...] = ()


class AttentionCheck(DocumentPart, frozen=True, kw_only=True):
    """Participants who give another answer to an item are excluded."""

    questionnaire: Slug
    item: Key
    answer: str = ""


class Speeder(DocumentPart, frozen=True, kw_only=True):
    """Excludes participants faster than `seconds`, or than this share of the median."""

    questionnaire: Slug
    seconds: Positive | None = None
    median_share: Proportion | None = None


class ExpectedEffect(DocumentPart, frozen=True, kw_only=True):
    """The expected values of a measure in a condition, for simulating power: the `difference` of
    its mean from the study's first condition, in the unit of the measure, its standard deviation,
    and the correlation of a participant's values in two conditions. Of proportions, counts and
    times `level` is the expected share, events per minute, or median in s.
    """

    measure: Measure
    condition: str = ""
    difference: float = 0.0
    level: Positive | None = None
    sd: Positive | None = None
    correlation: Correlation | None = None


class StudyPlan(DocumentPart, frozen=True, kw_only=True):
    """`participants` is the planned number of complete cases, `alpha` the level of significance,
    `power` the target for each expected effect. `incomplete` participants are kept, or excluded if
    they lack a drive, or a drive or an answered questionnaire; never from success and times.
    A drive whose record has one of `faults` is excluded from every result.
    """

    question: str = ""
    hypotheses: Annotated[tuple[Hypothesis, ...], Meta(max_length=40)] = ()
    families: Annotated[tuple[HypothesisFamily, ...], Meta(max_length=20)] = ()
    alpha: Proportion = 0.05
    attention_checks: Annotated[tuple[AttentionCheck, ...], Meta(max_length=40)] = ()
    speeders: Annotated[tuple[Speeder, ...], Meta(max_length=40)] = ()
    incomplete: Literal["keep", "drives", "answers"] = "keep"
    faults: tuple[Fault, ...] = ()
    participants: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    rationale: str = ""
    stopping: str = ""
    power: Proportion = 0.8
    expected: Annotated[tuple[ExpectedEffect, ...], Meta(max_length=200)] = ()
    blinding: str = ""
    missing_data: str = ""
    notes: str = ""


def is_confirmatory(plan: StudyPlan | None) -> bool:
    return plan is not None and bool(plan.hypotheses)


def measures_of(hypothesis: Hypothesis, analysis: DeclaredAnalysis) -> tuple[Measure, ...]:
    return hypothesis.measures or analysis.measures


def hypotheses_of(plan: StudyPlan | None, analysis: DeclaredAnalysis) -> tuple[Hypothesis, ...]:
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
    """Return the hypotheses that a test decides; a test of all conditions has no `contrast`."""
    contrasts, effects = {None, contrast}, {"", effect}
    known = [one for one in hypotheses_of(plan, analysis) if measure in measures_of(one, analysis)]
    return tuple(one for one in known if one.contrast in contrasts and one.effect in effects)
