"""The declared models of simulated studies: mixed models all at once, those of drives singly."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import scipy

from experiments.analysis.power.draws import DIFFERENCE, Draws, Found
from experiments.analysis.statistics.mixed_models import RobustTests, grouped, p_of
from experiments.analysis.statistics.models import CannotFitError, Design, Row, design_of
from experiments.analysis.statistics.regression import Family, fit_family
from experiments.analysis.tables.declared import levels_of
from experiments.dataset.columns import Floats
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis

LINKS: Mapping[str, Callable[[Floats], Floats]] = {
    "proportions": scipy.special.logit,
    "counts": np.log,
    "times": np.log,
}


def modelled(draws: Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
    """Yield the tests of a model. Without assumptions, the last level of a factor is raised for the
    test of this factor, and there is nothing to find for interactions, periods and orders.
    """
    data = _ModelData.of(draws, analysis)
    without = data.p_values()
    last = {factor.key: factor.levels[-1].key for factor in draws.study.factors}
    last["condition"] = draws.study.conditions[-1].key
    is_assumed, assumed_null = draws.is_assumed(analysis.test), data.is_null()
    for number, effect in enumerate(analysis.effects):
        is_null = assumed_null[number] if is_assumed else effect not in last
        own = without if is_assumed or is_null else data.p_values({effect: last[effect]})
        named = draws.test(analysis, measure, effect, is_null=is_null, effect=effect)
        yield named, own[:, number], without[:, number]


@dataclass(frozen=True, eq=False)
class _ModelData:
    """The observations of a model, each at its place (kind of participant, participant, condition).
    `design` is None where there are too few participants.
    """

    draws: Draws
    analysis: DeclaredAnalysis
    rows: Sequence[Row]
    places: Sequence[tuple[int, int, int]]
    design: Design | None

    @classmethod
    def of(cls, draws: Draws, analysis: DeclaredAnalysis) -> "_ModelData":
        """Return the observations of an analysis; covariates are numbers that explain nothing."""
        rows: list[Row] = []
        places: list[tuple[int, int, int]] = []
        rng = np.random.default_rng(len(analysis.covariates))
        written = {one.key: one for one in draws.study.conditions}
        wanted = set(analysis.conditions or written)
        for kind, (keys, noise) in enumerate(draws.noise.items()):
            orders = draws.orders.get(keys, (keys,))
            for person in range(noise.shape[1]):
                order = orders[person % len(orders)]
                given: dict[str, str | float] = {"order": "-".join(order)}
                given |= {name: float(rng.standard_normal()) for name in analysis.covariates}
                for column, key in enumerate(keys):
                    if key in wanted:
                        own = {"condition": key, "period": str(order.index(key) + 1)}
                        rows.append({**written[key].levels, **own, **given})
                        places.append((kind, person, column))
        terms = (*analysis.effects, *analysis.covariates)
        try:
            design = design_of(levels_of(draws.study, rows), terms, rows)
        except CannotFitError:
            design = None
        return cls(draws, analysis, rows, places, design)

    @property
    def who(self) -> list[str]:
        return [f"{kind}-{person:06d}" for kind, person, _ in self.places]

    @property
    def conditions(self) -> list[str]:
        return [str(row["condition"]) for row in self.rows]

    def is_null(self) -> list[bool]:
        test, effects = self.analysis.test, self.analysis.effects
        if self.design is None:
            return [True] * len(effects)
        means = np.array([self.draws.location(test, key) for key in self.conditions])
        if test in FAMILIES:
            means = LINKS[test](means)
        estimates = np.linalg.lstsq(self.design.columns, means, rcond=None)[0]
        size = max(1.0, float(np.abs(means).max()))
        own = (self.design.places(number) for number in range(1, len(effects) + 1))
        return [bool((np.abs(estimates[places]) <= 1e-9 * size).all()) for places in own]

    def p_values(self, raised: Mapping[str, str] | None = None) -> Floats:
        """Return the p values of every effect, (studies, effects); 1 where the model cannot be
        fitted. `raised` has the levels that are higher than others, by factor.
        """
        test, samples = self.analysis.test, self.draws.samples(self.analysis.test)
        values = np.stack([samples[kind][:, who, at] for kind, who, at in self.places], axis=1)
        for factor, level in (raised or {}).items():
            is_raised = np.array([row[factor] == level for row in self.rows])
            values += DIFFERENCE * is_raised * self.draws.sds(test, self.conditions)
        p = np.ones((len(values), len(self.analysis.effects)))
        if self.design is None:
            return p
        fitted = self._by_drives if test in FAMILIES else self._mixed
        return fitted(values, self.design, p)

    def _mixed(self, values: Floats, design: Design, p: Floats) -> Floats:
        """Test all studies at once, at the ratio of variances that is assumed, not estimated."""
        groups, people = grouped(self.who)
        correlation = self.draws.assumption.correlation
        ratio = correlation / (1.0 - correlation) if len(groups) > people else 0.0
        try:
            robust = RobustTests(design.columns, groups, ratio)
            terms = (design.places(number + 1) for number in range(p.shape[1]))
            found = [p_of(*robust.wald(values, places)) for places in terms]
        except (CannotFitError, np.linalg.LinAlgError):
            return p
        return np.stack(found, axis=1)

    def _by_drives(self, values: Floats, design: Design, p: Floats) -> Floats:
        family = cast("Family", self.analysis.test)
        terms = (*self.analysis.effects, *self.analysis.covariates)
        drives = self.draws.drives(family, self.who, self.conditions, values)
        for of_study, own in zip(p, drives, strict=True):
            try:
                found = fit_family(family, own, design, terms, with_coefficients=False)
            except CannotFitError:
                continue
            of_study[:] = [term.p for term in found.terms[: len(of_study)]]
        return p
