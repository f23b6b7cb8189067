"""Mixed models against published fits, and against what must hold in balanced studies."""

import numpy as np
import pytest
from scipy import stats

from experiments.analysis.statistics.mixed_models import CannotFitError, design_of, fit

# Pinheiro and Bates, Mixed-Effects Models in S and S-PLUS (2000): Rail (section 1.1), ergoStool
# (section 1.2), and what their lme prints of them by REML.
RAIL = {
    "1": (55, 53, 54),
    "2": (26, 37, 32),
    "3": (78, 91, 85),
    "4": (92, 100, 96),
    "5": (49, 51, 50),
    "6": (80, 85, 83),
}
STOOLS = np.array(
    [
        (12, 15, 12, 10),
        (10, 14, 13, 12),
        (7, 14, 13, 9),
        (7, 11, 10, 9),
        (8, 11, 8, 7),
        (9, 11, 11, 10),
        (8, 12, 12, 11),
        (7, 11, 8, 7),
        (9, 13, 10, 8),
    ],
    dtype=float,
)


def crossed(table, coding="treatment"):
    """A model of a table of participants and conditions, without the cells that are NaN."""
    n, k = table.shape
    levels = [f"c{number}" for number in range(k)]
    cells = [(row, column) for row in range(n) for column in range(k)]
    cells = [cell for cell in cells if np.isfinite(table[cell])]
    rows = [{"c": levels[column]} for _, column in cells]
    design = design_of({"c": levels}, ("c",), rows, coding)
    return fit(
        np.array([table[cell] for cell in cells]), design, ("c",), [f"P{r}" for r, _ in cells]
    )


def test_the_rails_of_pinheiro_and_bates_have_the_published_fit():
    who = [rail for rail, times in RAIL.items() for _ in times]
    values = np.array([time for times in RAIL.values() for time in times], dtype=float)
    found = fit(values, design_of({}, (), [{}] * len(values), "treatment"), (), who)
    (intercept,) = found.coefficients
    assert intercept.estimate.value == pytest.approx(66.5)
    assert intercept.error == pytest.approx(10.17104, rel=1e-6)
    assert (found.sd_participants, found.sd_residual) == pytest.approx(
        (24.80547, 4.020779), rel=1e-6
    )


def test_the_stools_of_pinheiro_and_bates_have_the_published_fit():
    found = crossed(STOOLS)
    assert [one.estimate.value for one in found.coefficients] == pytest.approx(
        [8.555556, 3.888889, 2.222222, 0.666667], abs=1e-6
    )
    assert [one.error for one in found.coefficients] == pytest.approx(
        [0.5760123, *[0.5186838] * 3], rel=1e-6
    )
    assert {one.df for one in found.coefficients} == {24.0}
    assert (found.sd_participants, found.sd_residual) == pytest.approx(
        (1.332465, 1.100295), rel=1e-6
    )


def analysis_of_variance(table):
    """The F test of the conditions, of the textbook."""
    n, k = table.shape
    residual = table - table.mean(axis=0) - table.mean(axis=1, keepdims=True) + table.mean()
    error = (residual**2).sum() / ((n - 1) * (k - 1))
    f = n * table.mean(axis=0).var(ddof=1) / error
    return f, stats.f.sf(f, k - 1, (n - 1) * (k - 1))


@pytest.mark.parametrize("coding", ["treatment", "sum"])
def test_a_balanced_study_has_the_test_of_the_analysis_of_variance_under_both_codings(coding):
    (term,) = crossed(STOOLS, coding).terms
    assert (term.f, term.p) == pytest.approx(analysis_of_variance(STOOLS))
    assert term.df == (3.0, 24.0)


def test_with_sum_coding_the_intercept_is_the_grand_mean():
    found = crossed(STOOLS, "sum").coefficients
    assert found[0].estimate.value == pytest.approx(STOOLS.mean())
    assert found[1].estimate.value == pytest.approx(STOOLS[:, 0].mean() - STOOLS.mean())


def restricted_deviance(table, ratio):
    """-2 log restricted likelihood by whole matrices (Harville, 1974)."""
    cells = np.argwhere(np.isfinite(table))
    y = table[np.isfinite(table)]
    x = np.column_stack([np.ones(len(y)), *(cells[:, 1] == k for k in range(1, table.shape[1]))])
    v = np.eye(len(y)) + ratio * (cells[:, :1] == cells[:, 0])
    inverse = np.linalg.inv(v)
    information = x.T @ inverse @ x
    b = np.linalg.solve(information, x.T @ inverse @ y)
    rest, df = y - x @ b, len(y) - x.shape[1]
    residual = rest @ inverse @ rest / df
    logs = np.linalg.slogdet(v)[1] + np.linalg.slogdet(information)[1]
    return logs + df * np.log(residual), b, np.sqrt(np.diag(np.linalg.inv(information)) * residual)


@pytest.mark.parametrize("spread", [0.3, 1.0, 30.0])
def test_with_missing_cells_no_other_ratio_of_variances_is_more_likely(spread):
    rng = np.random.default_rng(7)
    table = 50.0 + rng.normal(0.0, spread, (20, 1)) + rng.normal(0.0, 1.0, (20, 3))
    table[rng.random(table.shape) < 0.15] = np.nan
    found = crossed(table)
    ratio = (found.sd_participants / found.sd_residual) ** 2
    least, b, errors = restricted_deviance(table, ratio)
    assert [one.estimate.value for one in found.coefficients] == pytest.approx(b)
    assert [one.error for one in found.coefficients] == pytest.approx(errors)
    for factor in (0.0, 0.5, 0.99, 1.01, 2.0):
        assert restricted_deviance(table, ratio * factor)[0] >= least - 1e-9


def test_participants_who_do_not_differ_have_no_variance_and_the_model_says_so():
    table = np.random.default_rng(8).normal(0.0, 1.0, (20, 3))
    table -= table.mean(axis=1, keepdims=True)  # everybody's mean is 0
    found = crossed(table)
    assert found.is_singular
    assert found.sd_participants == 0.0
    assert not crossed(STOOLS).is_singular


def test_main_effects_interactions_and_between_effects_have_their_degrees_of_freedom():
    rng = np.random.default_rng(9)
    rows, who = [], []
    for number in range(16):
        for delay in ("none", "long"):
            for help_ in ("alone", "assisted"):
                group = "novice" if number % 2 else "expert"
                rows.append({"delay": delay, "help": help_, "group": group})
                who.append(f"P{number}")
    levels = {
        "delay": ["none", "long"],
        "help": ["alone", "assisted"],
        "group": ["novice", "expert"],
    }
    effect = np.array([2.0 * (row["delay"] == "long") for row in rows])
    terms = ("delay", "help", "delay:help", "group")
    found = fit(effect + rng.normal(size=64), design_of(levels, terms, rows, "sum"), terms, who)
    assert {one.name: one.df for one in found.terms} == {
        "delay": (1.0, 45.0),  # 64 observations less 16 participants less 3 coefficients
        "help": (1.0, 45.0),
        "delay:help": (1.0, 45.0),
        "group": (1.0, 14.0),  # 16 participants less intercept and group
    }
    assert found.terms[0].p < 0.001


@pytest.mark.parametrize(
    ("values", "terms", "who", "said"),
    [
        ([1, 2, 3, 4], (), "aabb", "fewer than three participants"),
        ([1, 2, 3, 4], (), "abcd", "no participant was measured twice"),
        ([2, 2, 2, 2, 2, 2], (), "aabbcc", "no variance"),
        ([1, 2, 3, 4, 5, 7], ("x", "y"), "aabbcc", "cannot be told apart"),
        ([1, 2, 1, 2, 1, 2], ("x",), "aabbcc", "the effects explain everything"),
    ],
)
def test_why_a_model_cannot_be_fitted_is_said(values, terms, who, said):
    rows = [{"x": "ab"[n % 2], "y": "ab"[n % 2]} for n in range(len(values))]
    design = design_of({"x": ["a", "b"], "y": ["a", "b"]}, terms, rows, "treatment")
    with pytest.raises(CannotFitError, match=said):
        fit(np.array(values, dtype=float), design, terms, list(who))


@pytest.mark.slow
def test_a_planted_null_is_significant_in_3_to_7_of_100_studies():
    rng = np.random.default_rng(10)
    found = [
        crossed(rng.normal(0.0, 1.0, (12, 1)) + rng.normal(0.0, 1.0, (12, 3))).terms[0].p
        for _ in range(400)
    ]
    assert 0.03 <= np.mean(np.array(found) < 0.05) <= 0.07
