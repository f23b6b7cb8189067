"""Mixed models against published fits, and against what must hold in balanced studies."""

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.multivariate import test_mvmean as hotelling

from experiments.analysis.statistics.mixed_models import fit, grouped, reml
from experiments.analysis.statistics.models import CannotFitError, design_of

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
    [  # nine persons, four stools each
        *((12, 15, 12, 10), (10, 14, 13, 12), (7, 14, 13, 9), (7, 11, 10, 9), (8, 11, 8, 7)),
        *((9, 11, 11, 10), (8, 12, 12, 11), (7, 11, 8, 7), (9, 13, 10, 8)),
    ],
    dtype=float,
)


def observed(table, coding="sum"):
    """The values of participants under conditions, without the cells that are NaN: outcome, design,
    participants.
    """
    n, k = table.shape
    levels = [f"c{number}" for number in range(k)]
    cells = [(row, column) for row in range(n) for column in range(k)]
    cells = [cell for cell in cells if np.isfinite(table[cell])]
    rows = [{"c": levels[column]} for _, column in cells]
    outcome = np.array([table[cell] for cell in cells])
    return outcome, design_of({"c": levels}, ("c",), rows, coding), [f"P{r}" for r, _ in cells]


def crossed(table, coding="sum"):
    outcome, design, who = observed(table, coding)
    return fit(outcome, design, ("c",), who)


def fitted(table, coding="sum"):
    """The fit itself, whose standard errors are those of the model."""
    outcome, design, who = observed(table, coding)
    return reml(outcome, design.columns, *grouped(who))


def test_rails_of_pinheiro_and_bates_have_the_published_fit():
    who = [rail for rail, times in RAIL.items() for _ in times]
    values = np.array([time for times in RAIL.values() for time in times], dtype=float)
    found = reml(values, np.ones((len(values), 1)), *grouped(who))
    assert found.estimates == pytest.approx([66.5])
    assert np.sqrt(found.covariance) == pytest.approx(10.17104, rel=1e-6)
    assert (found.ratio * found.residual) ** 0.5 == pytest.approx(24.80547, rel=1e-6)
    assert found.residual**0.5 == pytest.approx(4.020779, rel=1e-6)


def test_stools_of_pinheiro_and_bates_have_the_published_fit():
    found = fitted(STOOLS, "treatment")
    assert found.estimates == pytest.approx([8.555556, 3.888889, 2.222222, 0.666667], abs=1e-6)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(
        [0.5760123, *[0.5186838] * 3], rel=1e-6
    )
    spreads = dict(crossed(STOOLS).spreads)
    assert spreads["SD participants"] == pytest.approx(1.332465, rel=1e-6)
    assert spreads["SD residual"] == pytest.approx(1.100295, rel=1e-6)


@pytest.mark.parametrize("coding", ["treatment", "sum"])
def test_a_balanced_study_has_the_test_of_an_unstructured_covariance(coding):
    (term,) = crossed(STOOLS, coding).terms
    contrasts = STOOLS[:, 1:] - STOOLS[:, :1]
    expected = hotelling(contrasts)
    assert (term.f, term.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert term.df == pytest.approx((3.0, 6.0))


def test_two_conditions_have_the_paired_t_test():
    found = crossed(STOOLS[:, :2])
    expected = stats.ttest_rel(STOOLS[:, 0], STOOLS[:, 1])
    (term,) = found.terms
    assert (term.p, term.df[1]) == pytest.approx((expected.pvalue, 8.0))
    low, high = expected.confidence_interval()
    assert (term.difference.low, term.difference.high) == pytest.approx((low, high))
    assert term.difference.value == pytest.approx((STOOLS[:, 0] - STOOLS[:, 1]).mean())


def test_a_factor_of_a_2x2_study_has_the_paired_test_of_each_participants_means():
    rng = np.random.default_rng(3)
    values = rng.normal(0.0, 1.0, (14, 1)) + rng.normal(0.0, (1.0, 1.0, 2.0, 4.0), (14, 4))
    cells = [(a, b) for a in ("x", "y") for b in ("u", "v")]
    rows = [{"a": a, "b": b} for _ in range(14) for a, b in cells]
    terms = ("a", "b", "a:b")
    design = design_of({"a": ("x", "y"), "b": ("u", "v")}, terms, rows)
    found = fit(values.ravel(), design, terms, [f"P{n // 4}" for n in range(56)])
    expected = stats.ttest_rel(values[:, :2].mean(axis=1), values[:, 2:].mean(axis=1))
    assert (found.terms[0].p, found.terms[0].df[1]) == pytest.approx((expected.pvalue, 13.0))
    crossing = values[:, 0] - values[:, 1] - values[:, 2] + values[:, 3]
    assert found.terms[2].p == pytest.approx(stats.ttest_1samp(crossing, 0.0).pvalue)


def test_two_groups_measured_once_have_welchs_t_and_its_standard_error():
    rng = np.random.default_rng(4)
    first, second = rng.normal(1.0, 3.0, 12), rng.normal(0.0, 1.0, 12)
    rows = [{"g": "a"}] * 12 + [{"g": "b"}] * 12
    design = design_of({"g": ("a", "b")}, ("g",), rows)
    found = fit(np.concatenate((first, second)), design, ("g",), [f"P{n}" for n in range(24)])
    expected = stats.ttest_ind(first, second, equal_var=False)
    (term,) = found.terms
    assert term.f == pytest.approx(expected.statistic**2)
    assert term.difference.value == pytest.approx(first.mean() - second.mean())
    assert dict(found.spreads).keys() == {"SD residual"}


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
    found = fitted(table, "treatment")
    least, b, errors = restricted_deviance(table, found.ratio)
    assert found.estimates == pytest.approx(b)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(errors)
    for factor in (0.0, 0.5, 0.99, 1.01, 2.0):
        assert restricted_deviance(table, found.ratio * factor)[0] >= least - 1e-9


def test_equal_participants_have_zero_variance_and_a_remark():
    table = np.random.default_rng(8).normal(0.0, 1.0, (20, 3))
    table -= table.mean(axis=1, keepdims=True)  # everybody's mean is 0
    found = crossed(table)
    assert found.remark == "participants do not differ (variance 0)"
    assert dict(found.spreads)["SD participants"] == 0.0
    assert crossed(STOOLS).remark == ""


def test_terms_within_and_between_have_degrees_of_freedom_by_participants():
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
    found = fit(effect + rng.normal(size=64), design_of(levels, terms, rows), terms, who)
    assert {one.name: one.df[1] for one in found.terms} == pytest.approx(
        {"delay": 15.0, "help": 15.0, "delay:help": 15.0, "group": 14.0}
    )
    assert found.terms[0].p < 0.001


def test_a_number_is_one_column_around_its_mean_and_has_no_difference():
    ages = [20.0, 30.0, 70.0, 40.0]
    rows = [{"age": age, "g": "ab"[n % 2]} for n, age in enumerate(ages)]
    design = design_of({"age": (), "g": ("a", "b")}, ("age", "g", "age:g"), rows)
    assert design.names == ("(intercept)", "age", "g a", "age:g a")
    assert design.columns[:, 1].tolist() == [-20.0, -10.0, 30.0, 0.0]
    half = crossed(STOOLS[:, :2]).coefficients[1].estimate
    assert np.isnan(design.difference(1, half).value)
    assert np.isnan(design.difference(3, half).value)
    assert design.difference(2, half).value == 2.0 * half.value


@pytest.mark.parametrize(
    ("values", "terms", "who", "said"),
    [
        ([1, 2, 3, 4], (), "aabb", "fewer than three participants"),
        ([2, 2, 2, 2, 2, 2], (), "aabbcc", "no variance"),
        ([1, 2, 3, 4, 5, 7], ("x", "y"), "aabbcc", "cannot be told apart"),
        ([1, 2, 1, 2, 1, 2], ("x",), "aabbcc", "the effects explain everything"),
        ([1, 2, 3, 5, 9, 7], ("z",), "aabbcc", "only one level of z has data"),
    ],
)
def test_error_explains_why_a_model_cannot_be_fitted(values, terms, who, said):
    rows = [{"x": "ab"[n % 2], "y": "ab"[n % 2], "z": "a"} for n in range(len(values))]
    levels = {"x": ["a", "b"], "y": ["a", "b"], "z": ["a"]}
    outcome = np.array(values, dtype=float)
    with pytest.raises(CannotFitError, match=said):
        fit(outcome, design_of(levels, terms, rows), terms, list(who))
