"""The declared models of made-up studies: mixed models all at once, models of drives one by one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import scipy

from experiments.analysis.power.assumptions import DIFFERENCE
from experiments.analysis.power.draws import Draws, Found, named_test
from experiments.analysis.statistics.mixed_models import RobustTests, grouped, p_of
from experiments.analysis.statistics.models import CannotFitError, Design, design_of
from experiments.analysis.statistics.regression import DriveOutcome, Family, fit_family
from experiments.dataset.columns import Floats
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis
from experiments.definition.schema import StudyDefinition

LINKS: Mapping[str, Callable[[Floats], Floats]] = {
    "proportions": scipy.special.logit,
    "counts": np.log,
    "times": np.log,
}


def modelled(draws: Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
    """Without assumptions, the last level of a factor is raised for the test of this factor, and
    there is nothing to find for interactions, periods and orders.
    """
    data = _ModelData.of(draws, analysis)
    without = data.p_values(draws, analysis, {})
    last = {factor.key: factor.levels[-1].key for factor in draws.study.factors}
    last["condition"] = draws.study.conditions[-1].key
    assumed_null = data.is_null(draws, analysis)
    for number, effect in enumerate(analysis.effects):
        is_assumed = draws.is_assumed(analysis.test)
        is_null = assumed_null[number] if is_assumed else effect not in last
        named = named_test(draws, analysis, measure, effect, is_null=is_null, effect=effect)
        own = without
        if not is_assumed and not is_null:
            own = data.p_values(draws, analysis, {effect: last[effect]})
        yield named, own[:, number], without[:, number]


@dataclass(frozen=True, eq=False)
class _ModelData:
    """The observations of a model: what each has of its terms, whose it is, its condition, and its
    place (kind of participant, participant, condition); and the columns, None where these
    participants are too few for them.
    """

    rows: Sequence[Mapping[str, str | float]]
    who: Sequence[str]
    conditions: Sequence[str]
    places: Sequence[tuple[int, int, int]]
    design: Design | None

    @classmethod
    def of(cls, draws: Draws, analysis: DeclaredAnalysis) -> "_ModelData":
        """Return the observations of an analysis; covariates are numbers that explain nothing."""
        rows: list[Mapping[str, str | float]] = []
        who: list[str] = []
        conditions: list[str] = []
        places: list[tuple[int, int, int]] = []
        rng = np.random.default_rng(len(analysis.covariates))
        for kind, (keys, noise) in enumerate(zip(draws.kinds, draws.noise, strict=True)):
            orders = draws.orders.get(keys, (keys,))
            for person in range(noise.shape[1]):
                order = orders[person % len(orders)]
                given = {name: float(rng.standard_normal()) for name in analysis.covariates}
                for column, key in enumerate(keys):
                    condition = draws.study.condition(key)
                    if condition is None or (
                        analysis.conditions and key not in analysis.conditions
                    ):
                        continue
                    own = {"condition": key, "order": "-".join(order)}
                    period = str(order.index(key) + 1)
                    rows.append({**condition.levels, **own, **given, "period": period})
                    who.append(f"{kind}-{person:06d}")
                    conditions.append(key)
                    places.append((kind, person, column))
        terms = (*analysis.effects, *analysis.covariates)
        try:
            design = design_of(_levels(draws.study, rows), terms, rows)
        except CannotFitError:
            design = None
        return cls(rows, who, conditions, places, design)

    def is_null(self, draws: Draws, analysis: DeclaredAnalysis) -> list[bool]:
        """Tell of each effect whether what is assumed has nothing of it."""
        if self.design is None:
            return [True] * len(analysis.effects)
        means = np.array([draws.location(analysis.test, key) for key in self.conditions])
        if analysis.test in FAMILIES:
            means = LINKS[analysis.test](means)
        estimates = np.linalg.lstsq(self.design.columns, means, rcond=None)[0]
        size = max(1.0, float(np.abs(means).max()))
        own = (self.design.places(number) for number in range(1, len(analysis.effects) + 1))
        return [bool((np.abs(estimates[places]) <= 1e-9 * size).all()) for places in own]

    def p_values(
        self, draws: Draws, analysis: DeclaredAnalysis, raised: Mapping[str, str]
    ) -> Floats:
        """Return the p values of every effect, (studies, effects), where the levels of some factors
        are raised; 1 where the model cannot be fitted.
        """
        samples = draws.samples(analysis.test)
        values = np.stack(
            [samples[kind][:, at, column] for kind, at, column in self.places], axis=1
        )
        for factor, level in raised.items():
            sds = [
                1.0 if analysis.test in FAMILIES else draws.assumption.sd(key)
                for key in self.conditions
            ]
            is_raised = np.array([row[factor] == level for row in self.rows])
            values = values + DIFFERENCE * is_raised * np.array(sds)
        if self.design is None:
            return np.ones((len(values), len(analysis.effects)))
        fitted = self._by_drives if analysis.test in FAMILIES else self._mixed
        return fitted(draws, analysis, values, self.design)

    def _mixed(
        self, draws: Draws, analysis: DeclaredAnalysis, values: Floats, design: Design
    ) -> Floats:
        """All studies at once, at the ratio of variances that is assumed and not an estimate."""
        groups, people = grouped(self.who)
        ratio = draws.assumption.correlation / (1.0 - draws.assumption.correlation)
        p = np.ones((len(values), len(analysis.effects)))
        try:
            robust = RobustTests(design.columns, groups, ratio if len(groups) > people else 0.0)
            for number in range(len(analysis.effects)):
                p[:, number] = p_of(*robust.wald(values, design.places(number + 1)))
        except (CannotFitError, np.linalg.LinAlgError):
            return np.ones_like(p)
        return p

    def _by_drives(
        self, draws: Draws, analysis: DeclaredAnalysis, values: Floats, design: Design
    ) -> Floats:
        drawn = [
            draws.outcome(analysis.test, key, values[:, at])
            for at, key in enumerate(self.conditions)
        ]
        outcomes, weights = (np.stack([one[n] for one in drawn], axis=1) for n in (0, 1))
        terms = (*analysis.effects, *analysis.covariates)
        family = cast("Family", analysis.test)
        p = np.ones((len(values), len(analysis.effects)))
        for study in range(len(values)):
            given = zip(self.who, outcomes[study].tolist(), weights[study].tolist(), strict=True)
            try:
                own = [DriveOutcome(*one) for one in given]
                found = fit_family(family, own, design, terms, with_coefficients=False)
            except CannotFitError:
                continue
            p[study] = [term.p for term in found.terms[: len(analysis.effects)]]
        return p


def _levels(
    study: StudyDefinition, rows: Sequence[Mapping[str, str | float]]
) -> dict[str, list[str]]:
    written = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    written["condition"] = [condition.key for condition in study.conditions]
    given = {name: {row[name] for row in rows if name in row} for name in written}
    found = {
        name: [level for level in levels if level in given[name]]
        for name, levels in written.items()
    }
    return found | {name: sorted({str(row[name]) for row in rows}) for name in ("period", "order")}
