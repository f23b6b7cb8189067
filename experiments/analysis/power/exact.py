"""How many participants an effect needs: exact power of Student's t tests, two-sided (Cohen,
Statistical Power Analysis, chapter 2).

The power is the chance that |t| passes its critical value when t has a noncentral distribution,
whose noncentrality grows with the effect and the root of the number of participants.
"""

import math
from dataclasses import dataclass
from typing import Literal

import scipy

Design = Literal["between", "within"]
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


def power(effect: float, participants: int, design: Design, alpha: float = 0.05) -> float:
    """Return the chance to find a difference.

    Args:
        effect: the standardized difference of the means: Cohen's d between groups, d_z of the
            differences within.
        participants: in each group; those who do both conditions within.
        design: whether the same people are compared with themselves.
        alpha: how often a difference is found where there is none.
    """
    least = 2
    if participants < least:
        return 0.0
    freedom = 2 * participants - 2 if design == "between" else participants - 1
    noncentrality = abs(effect) * math.sqrt(
        participants / 2.0 if design == "between" else participants
    )
    critical = scipy.stats.t.isf(alpha / 2.0, freedom)
    return float(
        scipy.stats.nct.sf(critical, freedom, noncentrality)
        + scipy.stats.nct.cdf(-critical, freedom, noncentrality)
    )


def participants_needed(
    effect: float, design: Design, *, groups: int = 2, target: float = 0.8, alpha: float = 0.05
) -> Need | None:
    """Return how many participants find an effect with a chance of `target` at least; None where no
    number that can be had does.

    With more than two groups the pair that differs by `effect` is compared at an alpha that is
    shared by all pairs (Bonferroni).
    """
    pairs = groups * (groups - 1) // 2
    shared = alpha / max(1, pairs)
    if effect == 0.0 or power(effect, MOST, design, shared) < target:
        return None
    low, high = 1, 2
    while power(effect, high, design, shared) < target:
        low, high = high, high * 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (
            (low, middle) if power(effect, middle, design, shared) >= target else (middle, high)
        )
    return Need(effect, high, high * groups if design == "between" else high)
