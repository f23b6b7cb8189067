"""Values of simulated studies, drawn from assumptions about a measure: means by condition, standard
deviations, and the correlation of a participant's values in two conditions; or shares, rates or
median times. They come from the study's plan or from the defaults below, which every result states.
Differences between bots are no source: they do not predict those between people.

A participant's values in several conditions correlate equally: each is √r of a part that is the
participant's own, and √(1-r) of one that is not. Values are normal; proportions, counts and times
are quantiles of their distributions (Bernoulli, Poisson, exponential, censored at the time limit)
at the probabilities of normal values that correlate so.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from experiments.analysis.statistics.regression import DriveOutcome
from experiments.dataset.columns import Floats
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis
from experiments.definition.plan import deciding_hypotheses
from experiments.definition.schema import StudyDefinition

MINUTES = 15.0  # of a task, in a study without one
DIFFERENCE, SD, CORRELATION = 0.5, 1.0, 0.5
# Of the first condition: a share, events a minute, and the median of times as a share of the time
# limit of the task.
LEVELS = {"proportions": 0.5, "counts": 1.0, "times": 0.5}
REASONS = (
    (
        "Difference, if the plan expects none: 0.5 SD, which Cohen (1988) calls medium, in one test"
        " at a time, while no other test finds anything but by chance. That is a convention and"
        " says nothing about your effect."
    ),
    "SD, if none is given: 1, so that differences are in units of the SD.",
    (
        "Correlation within participants, if none is given: 0.5. Then d_z of a paired test is the d"
        " between conditions; a greater one gives more power."
    ),
)
Orders = Mapping[tuple[str, ...], Sequence[tuple[str, ...]]]  # those of a kind of participant


@dataclass(frozen=True)
class Assumption:
    """Assumptions about a measure. Without `means` (or `levels`, of proportions, counts and times)
    each test is simulated with the default difference on its own; a condition without an SD has
    the first one of `sds`, or 1.
    """

    source: str = "default"
    means: Mapping[str, float] = field(default_factory=dict)
    levels: Mapping[str, float] = field(default_factory=dict)
    sds: Mapping[str, float] = field(default_factory=dict)
    correlation: float = CORRELATION

    def mean(self, condition: str) -> float:
        return self.means.get(condition, 0.0)

    def sd(self, condition: str) -> float:
        return self.sds.get(condition, next(iter(self.sds.values()), SD))


def assumed(study: StudyDefinition, measure: str) -> Assumption:
    expected = study.plan.expected if study.plan is not None else ()
    own = [one for one in expected if one.measure == measure]
    if not own:
        return Assumption()
    correlations = (one.correlation for one in own if one.correlation is not None)
    means = {one.condition: one.difference for one in own}
    levels = {one.condition: one.level for one in own if one.level is not None}
    sds = {one.condition: one.sd for one in own if one.sd is not None}
    return Assumption("plan", means, levels, sds, next(correlations, CORRELATION))


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


def correlated(rng: np.random.Generator, shape: tuple[int, int, int], correlation: float) -> Floats:
    """Return standard normal values, (studies, participants, conditions), correlated by
    participant.
    """
    own = np.sqrt(correlation) * rng.standard_normal((*shape[:2], 1))
    return np.asarray(own + np.sqrt(1.0 - correlation) * rng.standard_normal(shape))


@dataclass(frozen=True, eq=False)
class Draws:
    """The noise of one measure, and the assumptions about it. `noise` has standard normal values of
    every kind of participant, (studies, participants, conditions), by its conditions.
    """

    study: StudyDefinition
    assumption: Assumption
    orders: Orders
    noise: Mapping[tuple[str, ...], Floats]

    @property
    def limit(self) -> float:
        return 60.0 * (self.study.task.minutes if self.study.task is not None else MINUTES)

    def is_assumed(self, test: str) -> bool:
        return bool(self.assumption.levels if test in FAMILIES else self.assumption.means)

    def location(self, test: str, condition: str) -> float:
        """Return the assumed mean of a condition, or its share, rate or median time."""
        about = self.assumption
        if test not in FAMILIES:
            return about.mean(condition)
        default = LEVELS[test] * (self.limit if test == "times" else 1.0)
        base = about.levels.get(self.study.conditions[0].key, default)
        return about.levels.get(condition, base + about.means.get(condition, 0.0))

    def sds(self, test: str, conditions: Sequence[str]) -> Floats:
        """Return the standard deviations of conditions; 1 of the normal values of `outcome`."""
        return np.array([1.0 if test in FAMILIES else self.assumption.sd(it) for it in conditions])

    def samples(self, test: str, raised: Sequence[str] = ()) -> list[Floats]:
        """Return values of every kind of participant; of proportions, counts and times, the normal
        ones that `outcome` takes. Without assumptions, `raised` conditions lie above the others.
        """
        found = []
        for kind, noise in self.noise.items():
            is_raised = [key in raised and not self.is_assumed(test) for key in kind]
            means = [0.0 if test in FAMILIES else self.assumption.mean(key) for key in kind]
            found.append((noise + DIFFERENCE * np.array(is_raised)) * self.sds(test, kind) + means)
        return found

    def outcome(self, family: str, condition: str, normal: Floats) -> tuple[Floats, Floats]:
        """Return values and weights (DriveOutcome) of drives from normal values."""
        level = self.location(family, condition)
        if family == "proportions":
            ends = scipy.special.ndtri(np.clip(level, 1e-6, 1.0 - 1e-6))
            return (normal > -ends).astype(np.float64), np.ones_like(normal)
        probability = scipy.special.ndtr(normal)
        if family == "counts":
            minutes = np.full_like(normal, self.limit / 120.0)
            return scipy.stats.poisson.ppf(probability, level * minutes), minutes
        times = -np.log1p(-np.minimum(probability, 1.0 - 1e-12)) * level / np.log(2.0)
        return np.minimum(times, self.limit), (times <= self.limit).astype(np.float64)

    def drives(
        self, family: str, who: Sequence[str], conditions: Sequence[str], normal: Floats
    ) -> Iterator[list[DriveOutcome]]:
        """Yield the drives of each study, from normal values (studies, drives)."""
        drawn = [self.outcome(family, key, normal[:, at]) for at, key in enumerate(conditions)]
        values, weights = (np.stack(part, axis=1).tolist() for part in zip(*drawn, strict=True))
        for of_study in zip(values, weights, strict=True):
            yield [DriveOutcome(*one) for one in zip(who, *of_study, strict=True)]

    def test(
        self, analysis: DeclaredAnalysis, measure: str, label: str, *, is_null: bool, **which: Any
    ) -> SimulatedTest:
        """Return a test of an analysis; `which` is its contrast or effect."""
        found = deciding_hypotheses(self.study.plan, analysis, measure, **which)
        # a test of all conditions at once is corrected with its like, as in the table
        family = analysis.key if which else f"{analysis.key} at once"
        hypotheses = tuple(one.key for one in found)
        return SimulatedTest(analysis.key, measure, label, hypotheses, family, is_null)


# tests with their p values, (studies,), as assumed and with nothing to find
Found = Iterator[tuple[SimulatedTest, Floats, Floats]]
