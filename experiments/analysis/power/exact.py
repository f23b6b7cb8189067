"""How many participants an effect needs: exact power of Student's t tests, two-sided (Cohen,
Statistical Power Analysis, chapter 2), by statsmodels.
"""

import math
from dataclasses import dataclass
from typing import Literal

Compared = Literal["between", "within"]
SMALL, MEDIUM, LARGE = 0.2, 0.5, 0.8  # Cohen's words for standardized differences
MOST = 100_000


@dataclass(frozen=True)
class Need:
    """What a standardized difference needs: participants a group, and in all. With `within`
    everybody is in the one group.
    """

    effect: float
    per_group: int
    total: int


def power(effect: float, participants: int, design: Compared, alpha: float = 0.05) -> float:
    """Return the chance to find a difference.

    Args:
        effect: the standardized difference of the means: Cohen's d between groups, d_z of the
            differences within.
        participants: in each group; those who do both conditions within.
        design: whether the same people are compared with themselves.
        alpha: how often a difference is found where there is none.
    """
    from statsmodels.stats.power import TTestIndPower, TTestPower  # noqa: PLC0415 - not on robots

    if participants < 2:
        return 0.0
    test = TTestIndPower() if design == "between" else TTestPower()
    return float(test.power(abs(effect), participants, alpha))


def participants_needed(
    effect: float, design: Compared, *, groups: int = 2, target: float = 0.8, alpha: float = 0.05
) -> Need | None:
    """Return how many participants find an effect with a chance of `target` at least; None where no
    number that can be had does.

    With more than two groups the pair that differs by `effect` is compared at an alpha that is
    shared by all pairs (Bonferroni).
    """
    from statsmodels.stats.power import TTestIndPower, TTestPower  # noqa: PLC0415 - not on robots

    shared = alpha / max(1, groups * (groups - 1) // 2)
    if effect == 0.0 or power(effect, MOST, design, shared) < target:
        return None
    least = 2
    if power(effect, least, design, shared) < target:
        test = TTestIndPower() if design == "between" else TTestPower()
        found = test.solve_power(abs(effect), alpha=shared, power=target)
        least = math.ceil(float(found) - 1e-6)
    return Need(effect, least, least * groups if design == "between" else least)
