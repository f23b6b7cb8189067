"""What a simulation assumes of a measure: means by condition, standard deviations, and the
correlation of a participant's values in two conditions; or shares, rates or median times.

They come from the plan of the study or from the defaults below; every result says from where.
Bots are no source: how much they differ says nothing about people.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from experiments.definition.schema import StudyDefinition

DIFFERENCE, SD, CORRELATION = 0.5, 1.0, 0.5
# What is assumed of the first condition: a share, events a minute, and the median of times as a
# share of the time limit of the task.
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


@dataclass(frozen=True)
class Assumption:
    """What is assumed of a measure. Without `means` (or `levels`, of proportions, counts and times)
    each test is simulated with the default difference on its own; conditions that `sds` lacks have
    that of the first one it has, or 1.
    """

    source: str = "default"
    means: Mapping[str, float] = field(default_factory=dict)
    levels: Mapping[str, float] = field(default_factory=dict)
    sds: Mapping[str, float] = field(default_factory=dict)
    correlation: float = CORRELATION

    def mean(self, condition: str) -> float:
        """Return the mean of a condition."""
        return self.means.get(condition, 0.0)

    def sd(self, condition: str) -> float:
        """Return the standard deviation of a condition."""
        return self.sds.get(condition, next(iter(self.sds.values()), SD))


def assumed(study: StudyDefinition, measure: str) -> Assumption:
    """Return what is assumed of a measure: what the plan expects, else the defaults."""
    expected = study.plan.expected if study.plan is not None else ()
    own = [one for one in expected if one.measure == measure]
    if not own:
        return Assumption()
    correlations = [one.correlation for one in own if one.correlation is not None]
    return Assumption(
        "plan",
        {one.condition: one.difference for one in own},
        {one.condition: one.level for one in own if one.level is not None},
        {one.condition: one.sd for one in own if one.sd is not None},
        correlations[0] if correlations else CORRELATION,
    )
