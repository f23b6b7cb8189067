"""What a simulation assumes of a measure: means by condition, standard deviations, and the
correlation of a participant's values in two conditions.

They come from the plan of the study, from the drives of bots, or from the defaults below; every
result says from where.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from experiments.analysis.dataset.records import Dataset
from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.tables.declared import Data
from experiments.definition.plan import ExpectedEffect
from experiments.definition.schema import StudyDefinition

DIFFERENCE, SD, CORRELATION = 0.5, 1.0, 0.5
REASONS = (
    (
        "Difference, if the plan expects none: 0.5 SD, which Cohen (1988) calls medium. That is a"
        " convention and says nothing about your effect."
    ),
    "SD, if none is given: 1, so that differences are in units of the SD.",
    (
        "Correlation within participants, if none is given: 0.5. Then d_z of a paired test is the d"
        " between conditions; a greater one gives more power."
    ),
)
LEAST_PAIRS = 3  # participants from whom a correlation is taken


@dataclass(frozen=True)
class Assumption:
    """What is assumed of a measure. Without `means` each test is simulated with the default
    difference on its own; conditions that `sds` lacks have that of the first one it has, or 1.
    """

    source: str = "default"
    means: Mapping[str, float] = field(default_factory=dict)
    sds: Mapping[str, float] = field(default_factory=dict)
    correlation: float = CORRELATION

    def mean(self, condition: str) -> float:
        """Return the mean of a condition."""
        return self.means.get(condition, 0.0)

    def sd(self, condition: str) -> float:
        """Return the standard deviation of a condition."""
        return self.sds.get(condition, next(iter(self.sds.values()), SD))


def assumed(
    study: StudyDefinition, measure: str, observed: Mapping[str, Assumption] | None = None
) -> Assumption:
    """Return what is assumed of a measure: what bots have shown, else what the plan expects, else
    the defaults.
    """
    if observed is not None and measure in observed:
        return observed[measure]
    plan = study.plan
    own = [one for one in plan.expected if one.measure == measure] if plan is not None else []
    return _declared(own) if own else Assumption()


def _declared(own: Sequence[ExpectedEffect]) -> Assumption:
    correlations = [one.correlation for one in own if one.correlation is not None]
    return Assumption(
        "plan",
        {one.condition: one.difference for one in own},
        {one.condition: one.sd for one in own if one.sd is not None},
        correlations[0] if correlations else CORRELATION,
    )


def of_bots(dataset: Dataset) -> dict[str, Assumption]:
    """Return what the bots of a dataset have shown of each declared metric. Their answers to
    questionnaires are made up, and are not read.
    """
    chosen = dataset.counting(("bot",))
    data = Data(chosen, measure_all(chosen))
    declared = {one: None for it in dataset.study.analyses for one in it.measures if "." not in one}
    found = {measure: _observed(data, measure) for measure in declared}
    return {measure: one for measure, one in found.items() if one is not None}


def _observed(data: Data, measure: str) -> Assumption | None:
    values = {one.key: data.of(measure, one.key)[0] for one in data.dataset.study.conditions}
    known = {
        key: np.array(list(own.values()), dtype=np.float64)
        for key, own in values.items()
        if len(own) >= 2
    }
    if not known or len(known) < len(values):
        return None
    sds = {key: float(own.std(ddof=1)) for key, own in known.items()}
    if not all(sds.values()):
        return None
    means = {key: float(own.mean()) for key, own in known.items()}
    correlation = _correlation(list(values.values()))
    return Assumption("bots", means, sds, CORRELATION if correlation is None else correlation)


def _correlation(columns: Sequence[Mapping[str, float]]) -> float | None:
    """Return the mean correlation of all pairs of conditions that participants share, at least 0;
    None where too few share any.
    """
    found = []
    for first, second in combinations(columns, 2):
        shared = sorted(set(first) & set(second))
        if len(shared) >= LEAST_PAIRS:
            pairs = [[one[who] for who in shared] for one in (first, second)]
            found.append(float(np.atleast_2d(np.corrcoef(pairs))[0, 1]))
    known = [one for one in found if not math.isnan(one)]
    return min(max(float(np.mean(known)), 0.0), 0.99) if known else None
