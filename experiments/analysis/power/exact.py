"""Exact power of Student's t tests, two-sided (Cohen, Statistical Power Analysis, chapter 2)."""

import math
from dataclasses import dataclass
from typing import Any, Literal

Compared = Literal["between", "within"]
SMALL, MEDIUM, LARGE = 0.2, 0.5, 0.8  # Cohen's words for standardized differences
MOST = 100_000


@dataclass(frozen=True)
class Need:
    """Participants for a standardized difference; within participants in one group."""

    effect: float
    per_group: int
    total: int


def _test(design: Compared) -> Any:
    from statsmodels.stats.power import TTestIndPower, TTestPower  # noqa: PLC0415 - not on robots

    return TTestIndPower() if design == "between" else TTestPower()


def power(effect: float, participants: int, design: Compared, alpha: float = 0.05) -> float:
    """Return the power for d between groups, or d_z within, of so many participants a group."""
    if participants < 2:
        return 0.0
    return float(_test(design).power(abs(effect), participants, alpha))


def participants_needed(
    effect: float, design: Compared, *, groups: int = 2, target: float = 0.8, alpha: float = 0.05
) -> Need | None:
    """Return how many participants give an effect the `target` power, None above MOST a group. The
    pairs of more than two groups share alpha (Bonferroni).
    """
    shared = alpha / max(1, groups * (groups - 1) // 2)
    if effect == 0.0 or power(effect, MOST, design, shared) < target:
        return None
    least = 2
    if power(effect, least, design, shared) < target:
        found = _test(design).solve_power(abs(effect), alpha=shared, power=target)
        least = math.ceil(float(found) - 1e-6)
    return Need(effect, least, least * groups if design == "between" else least)
