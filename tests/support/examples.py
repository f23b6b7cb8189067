"""The number of examples of a test: more in a thorough run (`make soak`, or `pytest
--hypothesis-profile=search`) than in `make test`, and a fifth in `make check`.
"""

from typing import Any

import numpy as np
from hypothesis import settings
from scipy.special import bdtr

THOROUGH, QUICK = "search", "quick"  # profiles; tests/conftest.py registers them
BY_CHANCE = 0.996  # share of runs whose result is in the band of the true rate


def repetitions(ordinary: int, *, thorough: int) -> int:
    """Return the number for this run. Call it in test modules, where pytest has set the profile."""
    return thorough if settings.get_current_profile_name() == THOROUGH else ordinary


def examples(ordinary: int, *, thorough: int, **others: Any) -> settings:
    """Return Hypothesis's settings for this number of examples, and others."""
    quick = settings.get_current_profile_name() == QUICK
    number = max(ordinary // 5, 5) if quick else repetitions(ordinary, thorough=thorough)
    return settings(max_examples=number, **others)


def binomial_band(rate: float, runs: int) -> tuple[float, float]:
    """Return the shares of `runs` between which an event of this rate happens in `BY_CHANCE` of all
    cases: 0.031 and 0.07 for a rate of 0.05 and 1,000 runs.
    """
    cumulative = bdtr(np.arange(runs + 1), runs, rate)
    tail = (1.0 - BY_CHANCE) / 2.0
    low, high = np.searchsorted(cumulative, [tail, 1.0 - tail]).tolist()
    return low / runs, high / runs
