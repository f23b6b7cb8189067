"""Alpha and omega: against published values, other formulas, and samples of a known model."""

import io
import math

import numpy as np
import pytest
from scipy import stats

from experiments.analysis.statistics.internal_consistency import (
    UndefinedCoefficientError,
    against_the_rest,
    cronbach,
    mcdonald,
    one_factor,
)

# Chatterjee and Price (1977), data of R's `attitude`; psych::alpha prints a raw alpha of 0.84
WRITTEN = """
43 51 30 39 61 92 45   63 64 51 54 63 73 47   71 70 68 69 76 86 48   61 63 45 47 54 84 35
81 78 56 66 71 83 47   43 55 49 44 54 49 34   58 67 42 56 66 68 35   71 75 50 55 70 66 41
72 82 72 67 71 83 31   67 61 45 47 62 80 41   64 53 53 58 58 67 34   67 60 47 39 59 74 41
69 62 57 42 55 63 25   68 83 83 45 59 77 35   77 77 54 72 79 77 46   81 90 50 72 60 54 36
74 85 64 69 79 79 63   65 60 65 75 55 80 60   65 70 46 57 75 85 46   50 58 68 54 64 78 52
50 40 33 34 43 64 33   64 61 52 62 66 80 41   53 66 52 50 63 80 37   40 37 42 58 50 57 49
63 54 42 48 66 75 33   66 77 66 63 88 76 72   78 75 58 74 80 78 49   48 57 44 45 51 83 38
85 85 71 71 77 74 55   82 82 39 59 64 78 39
"""
ATTITUDE = np.loadtxt(io.StringIO(WRITTEN.replace("   ", "\n")))
LOADINGS, UNIQUENESSES = np.array([1.0, 0.8, 0.6, 0.5]), np.array([0.5, 0.7, 1.0, 0.4])
OMEGA = LOADINGS.sum() ** 2 / (LOADINGS.sum() ** 2 + UNIQUENESSES.sum())


def drawn(rng, n):
    """Answers of n people by the model with one factor."""
    noise = rng.normal(size=(n, 4)) * np.sqrt(UNIQUENESSES)
    return rng.normal(size=(n, 1)) * LOADINGS + noise


def by_expectation(correlations):
    """The loadings that Rubin and Thayer's (1982) EM algorithm ends at."""
    loadings, own = np.full(len(correlations), 0.5), np.full(len(correlations), 0.75)
    for _ in range(5000):
        weights = np.linalg.solve(np.outer(loadings, loadings) + np.diag(own), loadings)
        second = 1.0 - weights @ loadings + weights @ correlations @ weights
        loadings = correlations @ weights / second
        own = 1.0 - loadings * (correlations @ weights)
    return loadings


def test_alpha_is_the_published_one_and_hoyts_by_the_analysis_of_variance():
    alpha = cronbach(ATTITUDE)
    n, k = ATTITUDE.shape
    assert round(alpha.value, 2) == 0.84
    rows = k * ATTITUDE.mean(axis=1).var(ddof=1)
    centred = (
        ATTITUDE - ATTITUDE.mean(axis=1, keepdims=True) - ATTITUDE.mean(axis=0) + ATTITUDE.mean()
    )
    rest = (centred**2).sum() / ((n - 1) * (k - 1))
    assert alpha.value == pytest.approx(1.0 - rest / rows)
    low = 1.0 - (1.0 - alpha.value) * stats.f.ppf(0.975, n - 1, (n - 1) * (k - 1))
    assert alpha.low == pytest.approx(low)
    assert alpha.low < alpha.value < alpha.high < 1.0


def test_loadings_are_those_that_another_algorithm_finds():
    correlations = np.corrcoef(ATTITUDE, rowvar=False)
    found = one_factor(np.cov(ATTITUDE, rowvar=False))
    sd = ATTITUDE.std(axis=0, ddof=1)
    assert found.loadings / sd == pytest.approx(by_expectation(correlations), abs=1e-5)
    omega, at_bound = mcdonald(ATTITUDE)
    common = found.loadings.sum() ** 2
    assert omega.value == pytest.approx(common / (common + found.uniquenesses.sum()), abs=1e-6)
    assert at_bound == ()


def test_a_known_model_is_found_in_its_own_covariances():
    found = one_factor(np.outer(LOADINGS, LOADINGS) + np.diag(UNIQUENESSES))
    assert found.loadings == pytest.approx(LOADINGS, abs=1e-5)
    assert found.uniquenesses == pytest.approx(UNIQUENESSES, abs=1e-5)


@pytest.mark.slow
def test_intervals_of_omega_hold_the_true_value_in_about_95_of_100_samples():
    rng = np.random.default_rng(61)
    found = [mcdonald(drawn(rng, 120))[0] for _ in range(200)]
    assert 0.90 <= np.mean([one.low <= OMEGA <= one.high for one in found]) <= 0.99
    assert np.mean([one.value for one in found]) == pytest.approx(OMEGA, abs=0.01)


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        (np.ones((9, 1)), "one item"),
        (np.ones((1, 3)), "fewer than two participants"),
        (np.ones((9, 3)), "no variance of the sum"),
    ],
)
def test_missing_alpha_has_a_reason(items, reason):
    with pytest.raises(UndefinedCoefficientError, match=reason):
        cronbach(items)


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        (drawn(np.random.default_rng(62), 20)[:, :2], "fewer than three items"),
        (drawn(np.random.default_rng(62), 4), "4 participants for 4 items"),
        (np.column_stack((drawn(np.random.default_rng(62), 9), np.ones(9))), "without variance"),
        (drawn(np.random.default_rng(62), 9)[:, [0, 1, 2, 0]], "follows from the others"),
    ],
)
def test_missing_omega_has_a_reason(items, reason):
    with pytest.raises(UndefinedCoefficientError, match=reason):
        mcdonald(items)


def test_an_item_that_points_the_other_way_correlates_negatively_with_the_rest():
    items = drawn(np.random.default_rng(63), 200)
    items[:, 2] *= -1.0
    found = against_the_rest(items)
    assert [value < 0.0 for value in found] == [False, False, True, False]
    assert found[2] == pytest.approx(
        np.corrcoef(items[:, 2], items[:, [0, 1, 3]].sum(axis=1))[0, 1]
    )
    assert math.isnan(against_the_rest(np.ones((4, 2)))[0])


def test_a_factor_that_is_not_identified_has_no_omega():
    # one item is unrelated to the others, whose covariance alone does not give two loadings
    items = [[1, 2, 2], [1, -1, 2], [0, 1, 0], [0, 1, 1], [1, 1, 1], [2, 2, 1]]
    with pytest.raises(UndefinedCoefficientError, match="not identified"):
        mcdonald(np.array(items, dtype=np.float64))


def test_omega_of_few_participants_is_not_that_of_a_local_minimum():
    """R's factanal finds the minimum at a bound; from the usual start, there is one of 0.863."""
    answers = """
        -1 -1 -2 -2  1  1  1 -2
         0 -1  1  0  1 -2 -2 -1
        -2 -2 -2 -2 -2 -1 -2 -2
         1  2  2  1  1  2  0  2
         1  1  0  2  2  2  0  0
         1  1  2  1  2  1  2  1
         0 -2 -1  0  1  1 -1  1
         1  2  2 -1  0 -1  0  2
        -2  1  1  2 -2 -1 -2  0
    """
    items = np.array([line.split() for line in answers.strip().splitlines()], dtype=float)
    omega, at_bound = mcdonald(items)
    assert omega.value == pytest.approx(0.845202, abs=1e-5)
    assert at_bound == (0,)
