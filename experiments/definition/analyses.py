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


class Contrast(DocumentPart, frozen=True, kw_only=True):
    """Two sides that are compared: conditions, whose values are averaged for each participant."""

    title: Text
    first: tuple[Key, ...]
    second: tuple[Key, ...]


class DeclaredAnalysis(DocumentPart, frozen=True, kw_only=True):
    """One declared family of tests.

    Each of `measures` is tested. With `means` or `ranks`, each of `contrasts` is compared (t tests,
    or the tests of Wilcoxon and of Mann and Whitney); without contrasts all `conditions` at once
    (none: all of the study), and with `post_hoc` each pair of them. With `mixed`, a linear mixed
    model with an intercept for each participant has `effects`: factors, interactions, `condition`,
    `period` (which round it was) and `order` (the order of conditions); `coding` is that of their
    levels.
    """

    key: Key
    title: Text
    measures: Annotated[tuple[Measure, ...], Meta(max_length=40)] = ()
    test: Literal["means", "ranks", "mixed"] = "means"
    contrasts: Annotated[tuple[Contrast, ...], Meta(max_length=40)] = ()
    conditions: tuple[Key, ...] = ()
    post_hoc: bool = False
    effects: Annotated[tuple[ModelEffect, ...], Meta(max_length=20)] = ()
    coding: Literal["treatment", "sum"] = "treatment"
