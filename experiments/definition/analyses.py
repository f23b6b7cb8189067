"""The analyses that a study declares before it has data. The report has a table for each
(experiments/analysis/tables/), and corrects all tests of an analysis together by Holm's method.
"""

from typing import Annotated, Literal

from msgspec import Meta

from experiments.definition.design import TitledPart
from surveys.documents import DocumentPart, Key, Text

# "metric", or "questionnaire.item" with an item, topic or "overall"; where several steps ask the
# questionnaire, "questionnaire.step.item"
_VARIABLE = r"([a-z][a-z0-9-]{0,39}\.([a-z][a-z0-9_]{0,39}\.)?)?"
Measure = Annotated[str, Meta(pattern=rf"^{_VARIABLE}[a-z][a-z0-9_]{{0,39}}$")]
# a factor, one of EFFECTS, or the interaction of factors: "delay:assistance"
ModelEffect = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,39}(:[a-z][a-z0-9_]{0,39}){0,3}$")]
EFFECTS = frozenset({"condition", "period", "order"})  # of models, beside factors
FAMILIES = frozenset({"proportions", "counts", "times"})  # tests whose models have drives
AGE = "age"  # a covariate that no questionnaire needs


class Contrast(DocumentPart, frozen=True, kw_only=True):
    """Two sides of conditions that are compared; a side is averaged for each participant."""

    title: Text
    first: tuple[Key, ...]
    second: tuple[Key, ...]


class DeclaredAnalysis(TitledPart, frozen=True, kw_only=True):
    """One family of tests of each of `measures`.

    Tests are of `means` or `ranks` of participants, or of drives: `proportions` (completed),
    `counts` (per minute) or `times` (censored). They compare each of `contrasts`; without
    contrasts all `conditions` at once (empty: of the study), and with `post_hoc` each pair.

    A model has `effects` instead: `mixed` is a linear model with a random intercept for each
    participant; proportions, counts and times may have effects. Effects are factors, interactions,
    `condition`, `period` (the round) and `order` (of conditions). `covariates` (`age`, or items
    about the person) are in the model but not in the family. `coding` is that of the printed
    coefficients; terms are always tested in sum coding.
    """

    measures: Annotated[tuple[Measure, ...], Meta(max_length=40)] = ()
    test: Literal["means", "ranks", "proportions", "counts", "times", "mixed"] = "means"
    contrasts: Annotated[tuple[Contrast, ...], Meta(max_length=40)] = ()
    conditions: tuple[Key, ...] = ()
    post_hoc: bool = False
    effects: Annotated[tuple[ModelEffect, ...], Meta(max_length=20)] = ()
    covariates: Annotated[tuple[Measure, ...], Meta(max_length=10)] = ()
    coding: Literal["treatment", "sum"] = "treatment"

    @property
    def is_model(self) -> bool:
        """Whether it tests effects instead of contrasts."""
        return self.test == "mixed" or bool(self.effects)

    def interacts(self, factor: str) -> bool:
        return any(":" in effect and factor in effect.split(":") for effect in self.effects)
