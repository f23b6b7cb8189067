"""Values of made-up studies, and what a test of them is called.

A participant's values in several conditions correlate equally: each is √r of a part that is the
participant's own, and √(1-r) of one that is not. Values are normal; proportions, counts and times
are quantiles of their distributions (Bernoulli, Poisson, exponential, censored at the time limit)
at the probabilities of normal values that correlate so.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from experiments.analysis.power.assumptions import DIFFERENCE, LEVELS, Assumption
from experiments.dataset.columns import Floats
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis
from experiments.definition.plan import deciding_hypotheses
from experiments.definition.schema import StudyDefinition

MINUTES = 15.0  # of a task, in a study without one
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


def correlated(
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


@dataclass(frozen=True, eq=False)
class Draws:
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


# tests with their p values, (studies,), as assumed and with nothing to find
Found = Iterator[tuple[SimulatedTest, Floats, Floats]]


def named_test(
    draws: Draws,
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
