"""Power by simulation: studies are made up from assumptions, and analysed by the statistics that
will analyse the real one, in the families in which the report corrects them; power is the share of
them in which a test is significant. Tests of which nothing is assumed are in the families, too.

A participant's values in several conditions correlate equally: each is √r of a part that is the
participant's own, and √(1-r) of one that is not. Values are normal; proportions, counts and times
are quantiles of their distributions (Bernoulli, Poisson, exponential, censored at the time limit)
at the probabilities of normal values that correlate so. Answers are simulated as if they were
continuous, measures as if they were independent of each other, and covariates as if they explained
nothing. All studies of one call are analysed together, as arrays (studies, participants,
conditions), but for models by statsmodels.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import cast

import numpy as np
import scipy

from experiments.analysis.dataset.records import Floats
from experiments.analysis.power.assumptions import DIFFERENCE, LEVELS, Assumption, assumed
from experiments.analysis.statistics.comparisons import holm_rows
from experiments.analysis.statistics.conditions import Compared, p_values
from experiments.analysis.statistics.mixed_models import RobustTests, grouped, p_of
from experiments.analysis.statistics.models import CannotFitError, Design, design_of
from experiments.analysis.statistics.regression import (
    DriveOutcome,
    Family,
    compare_drives,
    fit_family,
)
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import deciding_hypotheses
from experiments.definition.schema import StudyDefinition
from surveys.documents import spoken

AT_ONCE = 3_000_000  # values of simulated studies in memory
MINUTES = 15.0  # of a task, in a study without one
LINKS: Mapping[str, Callable[[Floats], Floats]] = {
    "proportions": scipy.special.logit,
    "counts": np.log,
    "times": np.log,
}
Orders = Mapping[tuple[str, ...], Sequence[tuple[str, ...]]]  # those of a kind of participant
Samples = Sequence[Floats]  # of each kind of participant: (studies, participants, conditions)


@dataclass(frozen=True)
class SimulatedTest:
    """One test of the declared analyses: its label in their table, the hypotheses that it decides
    on, its family in that table, and whether it is assumed to have nothing to find.
    """

    analysis: str
    measure: str
    label: str
    hypotheses: tuple[str, ...] = ()
    family: str = ""
    is_null: bool = False


@dataclass(frozen=True, eq=False)
class SimulatedStudies:
    """Studies of one size: `p` (studies, tests), corrected within their families."""

    participants: int
    tests: tuple[SimulatedTest, ...]
    p: Floats

    def power(self, alpha: float) -> list[tuple[int, int]]:
        """Return in how many studies each test was significant, and of how many."""
        return [(int((column < alpha).sum()), len(column)) for column in self.p.T]


def simulate(
    study: StudyDefinition,
    participants: int,
    studies: int,
    seed: int,
    *,
    orders: Orders | None = None,
) -> SimulatedStudies:
    """Return simulated studies.

    Args:
        study: the definition.
        participants: in all, spread evenly over the kinds of participants (those who have the same
            conditions).
        studies: how many are made up.
        seed: of their chance; the same one makes the same studies.
        orders: the orders of conditions of each kind of participant, for models with `period` or
            `order`; else all have that of the definition.
    """
    kinds = conditions_together(study)
    sizes = [
        participants // len(kinds) + (n < participants % len(kinds)) for n in range(len(kinds))
    ]
    measures = dict.fromkeys(one for it in study.analyses for one in it.measures)
    chunk = max(1, AT_ONCE // (participants * max(map(len, kinds))))
    tests: list[SimulatedTest] = []
    found: list[Floats] = []  # p values of each test with what is assumed of it
    alone: list[Floats] = []  # and with nothing to find, while another one has its default effect
    for number, measure in enumerate(measures):
        assumption = assumed(study, measure)
        rng = np.random.default_rng([seed, participants, number])
        parts = []
        for start in range(0, studies, chunk):
            noise = _noise(rng, min(chunk, studies - start), kinds, sizes, assumption.correlation)
            draws = _Draws(study, kinds, assumption, noise, orders or {})
            parts.append(list(_of_measure(draws, measure)))
        tests += [test for test, _, _ in parts[0]]
        for at in range(len(parts[0])):
            found.append(np.concatenate([part[at][1] for part in parts]))
            alone.append(np.concatenate([part[at][2] for part in parts]))
    if not tests:
        return SimulatedStudies(participants, (), np.empty((studies, 0)))
    p = _corrected(study, tests, np.stack(found, axis=1), np.stack(alone, axis=1))
    return SimulatedStudies(participants, tuple(tests), p)


def _noise(
    rng: np.random.Generator,
    studies: int,
    kinds: Sequence[Sequence[str]],
    sizes: Sequence[int],
    correlation: float,
) -> list[Floats]:
    """Return standard normal values, of which those of a participant correlate."""
    return [
        np.sqrt(correlation) * rng.standard_normal((studies, size, 1))
        + np.sqrt(1.0 - correlation) * rng.standard_normal((studies, size, len(kind)))
        for kind, size in zip(kinds, sizes, strict=True)
    ]


def _corrected(
    study: StudyDefinition, tests: Sequence[SimulatedTest], found: Floats, alone: Floats
) -> Floats:
    """Return p values corrected as the report does: within the family of the plan that has a
    hypothesis of the test, otherwise within its analysis. Each is corrected beside the others of
    its family, in which nothing else is found where each test has its default effect.
    """
    corrected = np.empty_like(found)
    families = study.plan.families if study.plan is not None else ()
    for number, one in enumerate(tests):
        planned = [
            set(it.hypotheses) for it in families if set(it.hypotheses) & set(one.hypotheses)
        ]
        own = [
            n
            for n, other in enumerate(tests)
            if (planned and planned[0] & set(other.hypotheses))
            or (not planned and other.family == one.family)
        ]
        values = alone[:, own]
        values[:, own.index(number)] = found[:, number]
        corrected[:, number] = holm_rows(values)[:, own.index(number)]
    return corrected


@dataclass(frozen=True, eq=False)
class _Draws:
    """The noise of one measure, and what is assumed of it."""

    study: StudyDefinition
    kinds: Sequence[tuple[str, ...]]
    assumption: Assumption
    noise: Samples
    orders: Orders

    @property
    def limit(self) -> float:
        """The time limit of the task, in seconds."""
        return 60.0 * (self.study.task.minutes if self.study.task is not None else MINUTES)

    def is_assumed(self, test: str) -> bool:
        """Tell whether anything is assumed of the conditions, beside the defaults."""
        return bool(self.assumption.levels if test in FAMILIES else self.assumption.means)

    def location(self, test: str, condition: str) -> float:
        """Return the mean that is assumed of a condition, or its share, rate or median time."""
        about = self.assumption
        if test not in FAMILIES:
            return about.mean(condition)
        default = LEVELS[test] * (self.limit if test == "times" else 1.0)
        base = about.levels.get(self.study.conditions[0].key, default)
        return about.levels.get(condition, base + about.means.get(condition, 0.0))

    def samples(self, test: str, raised: Sequence[str] = ()) -> list[Floats]:
        """Return values of every kind of participant. Where nothing is assumed, those of `raised`
        conditions lie above the others; of a proportion, a count or a time they are normal, and
        `outcome` makes of them what they stand for.
        """
        about, found = self.assumption, []
        for kind, noise in zip(self.kinds, self.noise, strict=True):
            shift = np.array([DIFFERENCE * (key in raised) for key in kind])
            sds = np.array([1.0 if test in FAMILIES else about.sd(key) for key in kind])
            means = np.array([0.0 if test in FAMILIES else about.mean(key) for key in kind])
            found.append((noise + (0.0 if self.is_assumed(test) else shift)) * sds + means)
        return found

    def outcome(self, family: str, condition: str, normal: Floats) -> tuple[Floats, Floats]:
        """Return values and weights (DriveOutcome) of drives under a condition, from normal
        values.
        """
        level = self.location(family, condition)
        if family == "proportions":
            ends = scipy.special.ndtri(np.clip(level, 1e-6, 1.0 - 1e-6))
            return (normal > -ends).astype(np.float64), np.ones_like(normal)
        probability = scipy.special.ndtr(normal)
        if family == "counts":
            minutes = self.limit / 120.0
            return scipy.stats.poisson.ppf(probability, level * minutes), np.full_like(
                normal, minutes
            )
        times = -np.log1p(-np.minimum(probability, 1.0 - 1e-12)) * level / np.log(2.0)
        return np.minimum(times, self.limit), (times <= self.limit).astype(np.float64)


Found = Iterator[tuple[SimulatedTest, Floats, Floats]]


def _of_measure(draws: _Draws, measure: str) -> Found:
    for analysis in draws.study.analyses:
        if measure in analysis.measures:
            analysed = _modelled if analysis.is_model else _compared
            yield from analysed(draws, analysis, measure)


def _named(
    draws: _Draws,
    analysis: DeclaredAnalysis,
    measure: str,
    label: str,
    *,
    is_null: bool,
    contrast: int | None = None,
    effect: str = "",
) -> SimulatedTest:
    plan = draws.study.plan
    found = deciding_hypotheses(plan, analysis, measure, contrast=contrast, effect=effect)
    # a test of all conditions at once is corrected with its like, as in the table
    at_once = " at once" if contrast is None and not effect else ""
    keys, family = tuple(one.key for one in found), f"{analysis.key}{at_once}"
    return SimulatedTest(analysis.key, measure, label, keys, family, is_null)


# --- contrasts, and several conditions at once ----------------------------------------------------


def _compared(draws: _Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
    study, test = draws.study, analysis.test
    keys = analysis.conditions or tuple(one.key for one in study.conditions)
    if not analysis.contrasts:
        sides = [(key,) for key in keys]
        is_null = draws.is_assumed(test) and len({draws.location(test, key) for key in keys}) == 1
        named = _named(draws, analysis, measure, "all", is_null=is_null)
        yield named, *_with_and_without(draws, test, sides, keys[-1:])
    for number, (label, first, second) in enumerate(_pairs(study, analysis, keys), start=1):
        a, b = (np.mean([draws.location(test, key) for key in side]) for side in (first, second))
        is_null = draws.is_assumed(test) and bool(a == b)
        named = _named(draws, analysis, measure, label, is_null=is_null, contrast=number)
        yield named, *_with_and_without(draws, test, [first, second], first)


def _pairs(
    study: StudyDefinition, analysis: DeclaredAnalysis, keys: Sequence[str]
) -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    if analysis.contrasts:
        language = study.languages[0]
        return [(spoken(it.title, language), it.first, it.second) for it in analysis.contrasts]
    if not analysis.post_hoc:
        return []
    return [(f"{a} − {b}", (a,), (b,)) for a, b in combinations(keys, 2)]


def _with_and_without(
    draws: _Draws, test: str, sides: Sequence[Sequence[str]], raised: Sequence[str]
) -> tuple[Floats, Floats]:
    """Return the p values of a test, (studies,), with what is assumed and with nothing to find; the
    same where anything is assumed.
    """
    found = tested(draws, test, sides, draws.samples(test, raised))
    if draws.is_assumed(test):
        return found, found
    return found, tested(draws, test, sides, draws.samples(test))


def tested(draws: _Draws, test: str, sides: Sequence[Sequence[str]], samples: Samples) -> Floats:
    """Return the p values of a comparison of sides, (studies,): paired where a participant has
    conditions of all of them.
    """
    own = [
        [[at for at, key in enumerate(kind) if key in side] for side in sides]
        for kind in draws.kinds
    ]
    is_paired = any(all(places) for places in own)
    is_single = all(len(places) <= 1 for kind in own for places in kind)
    if test in FAMILIES and not (test == "proportions" and is_single):
        return _by_drives(draws, test, sides, samples)
    if test == "proportions":
        samples = [
            np.stack([draws.outcome(test, key, x[..., at])[0] for at, key in enumerate(kind)], -1)
            for kind, x in zip(draws.kinds, samples, strict=True)
        ]
    groups = [
        np.concatenate(
            [
                x[..., places[side]].mean(axis=-1)
                for x, places in zip(samples, own, strict=True)
                if (all(places) if is_paired else places[side])
            ],
            axis=1,
        )
        for side in range(len(sides))
    ]
    return p_values(groups, is_paired=is_paired, by=cast("Compared", test))


def _by_drives(
    draws: _Draws, family: str, sides: Sequence[Sequence[str]], samples: Samples
) -> Floats:
    """Return the p values of sides of drives, (studies,), a study at a time; 1 without a test."""
    drawn = [
        (side, who, *draws.outcome(family, key, x[..., at]))
        for kind, (keys, x) in enumerate(zip(draws.kinds, samples, strict=True))
        for at, key in enumerate(keys)
        for side, of_side in enumerate(sides)
        if key in of_side
        for who in [[f"{kind}-{person:06d}" for person in range(x.shape[1])]]
    ]
    found = np.ones(len(samples[0]))
    for study in range(len(found)):
        own: dict[str, list[DriveOutcome]] = {str(side): [] for side in range(len(sides))}
        for side, who, values, weights in drawn:
            given = zip(who, values[study].tolist(), weights[study].tolist(), strict=True)
            own[str(side)] += [DriveOutcome(*one) for one in given]
        test = compare_drives(cast("Family", family), own)
        found[study] = test.p if test.is_known else 1.0
    return found


# --- models ---------------------------------------------------------------------------------------


def _modelled(draws: _Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
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
        named = _named(draws, analysis, measure, effect, is_null=is_null, effect=effect)
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
    def of(cls, draws: _Draws, analysis: DeclaredAnalysis) -> "_ModelData":
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

    def is_null(self, draws: _Draws, analysis: DeclaredAnalysis) -> list[bool]:
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
        self, draws: _Draws, analysis: DeclaredAnalysis, raised: Mapping[str, str]
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
        self, draws: _Draws, analysis: DeclaredAnalysis, values: Floats, design: Design
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
        self, draws: _Draws, analysis: DeclaredAnalysis, values: Floats, design: Design
    ) -> Floats:
        drawn = [
            draws.outcome(analysis.test, key, values[:, at])
            for at, key in enumerate(self.conditions)
        ]
        outcomes, weights = (np.stack([one[n] for one in drawn], axis=1) for n in (0, 1))
        terms = (*analysis.effects, *analysis.covariates)
        p = np.ones((len(values), len(analysis.effects)))
        for study in range(len(values)):
            given = zip(self.who, outcomes[study].tolist(), weights[study].tolist(), strict=True)
            try:
                own = [DriveOutcome(*one) for one in given]
                found = fit_family(cast("Family", analysis.test), own, design, terms)
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
