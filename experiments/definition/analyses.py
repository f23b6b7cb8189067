"""The analyses that a study declares before it has data: what is compared with what, by which test,
and what is corrected together. The report has a table for each (experiments/analysis/tables/).

An analysis is one family: all of its tests are corrected together by Holm's method.
"""

from typing import Annotated, Literal

from msgspec import Meta

from surveys.documents import DocumentPart, Key, Text

# a metric of the sessions, or a questionnaire's item, topic or "overall" after its name and a point
Measure = Annotated[str, Meta(pattern=r"^([a-z][a-z0-9-]{0,39}\.)?[a-z][a-z0-9_]{0,39}$")]
# a factor or one of EFFECTS, or several factors with colons between: their interaction
ModelEffect = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,39}(:[a-z][a-z0-9_]{0,39}){0,3}$")]
EFFECTS = frozenset({"condition", "period", "order"})  # that a model may have without a factor
FAMILIES = frozenset({"proportions", "counts", "times"})  # tests whose models have drives
AGE = "age"  # a covariate that no questionnaire needs


class Contrast(DocumentPart, frozen=True, kw_only=True):
    """Two sides that are compared: conditions, whose values are averaged for each participant."""

    title: Text
    first: tuple[Key, ...]
    second: tuple[Key, ...]


class DeclaredAnalysis(DocumentPart, frozen=True, kw_only=True):
    """One declared family of tests.

    Each of `measures` is tested: by `means` or `ranks` of participants, or drives as `proportions`
    (completed or not), `counts` (a minute) or `times` (censored where they never came).

    Without `effects`, each of `contrasts` is compared; without contrasts all `conditions` at once
    (none: all of the study), and with `post_hoc` each pair of them. `mixed`, a linear model with an
    intercept for each participant, has `effects`, and so may proportions, counts and times:
    factors, interactions, `condition`, `period` (which round it was) and `order` (the order of
    conditions). `covariates` (`age`, or items of a questionnaire about the person) are in the model
    and in no family. `coding` is that of the printed coefficients; terms are always tested in sum
    coding.
    """

    key: Key
    title: Text
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
        """Whether it tests effects, and not contrasts."""
        return self.test == "mixed" or bool(self.effects)

    def interacts(self, factor: str) -> bool:
        """Tell whether the effect of a factor depends on another one in the model."""
        return any(":" in effect and factor in effect.split(":") for effect in self.effects)
