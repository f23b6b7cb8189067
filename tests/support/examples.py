"""How often a test tries something: an ordinary number in `make test`, and a larger one for a
thorough run, `pytest --hypothesis-profile=search`, which `make soak` does. In `make check`, a
property is tried with a fifth of its examples.
"""

from typing import Any

import numpy as np
from hypothesis import settings
from scipy.special import bdtr

THOROUGH, QUICK = "search", "quick"  # profiles; tests/conftest.py registers them
BY_CHANCE = 0.996  # of all runs of a true rate fall into its band


def repetitions(ordinary: int, *, thorough: int) -> int:
    """Return how many times this run tries something. Ask when a test's module is imported or
    later: before that, pytest has not chosen the profile.
    """
    return thorough if settings.get_current_profile_name() == THOROUGH else ordinary


def examples(ordinary: int, *, thorough: int, **others: Any) -> settings:
    """Return the settings of a property that Hypothesis tries with so many examples; `others` are
    more of its settings.
    """
    quick = settings.get_current_profile_name() == QUICK
    number = max(ordinary // 5, 5) if quick else repetitions(ordinary, thorough=thorough)
    return settings(max_examples=number, **others)


def binomial_band(rate: float, runs: int) -> tuple[float, float]:
    """Return between which shares of so many runs something of the given rate happens, in
    `BY_CHANCE` of all cases: 0.031 and 0.07 for one in twenty of 1,000, and wider for fewer.
    """
    cumulative = bdtr(np.arange(runs + 1), runs, rate)
    tail = (1.0 - BY_CHANCE) / 2.0
    low, high = np.searchsorted(cumulative, [tail, 1.0 - tail]).tolist()
    return low / runs, high / runs
