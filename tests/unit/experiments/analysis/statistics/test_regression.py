"""Models of proportions, counts and times agree with R (tests/support/analysis/drives/), and say
why there is no estimate.
"""

import csv
import math
from itertools import product

import pytest
from scipy import stats

from experiments.analysis.statistics.models import CannotFitError, design_of
from experiments.analysis.statistics.regression import (
    DriveOutcome,
    compare_drives,
    fit_family,
    median_time,
)
from tests.support.paths import ROOT

FOLDER = ROOT / "tests" / "support" / "analysis" / "drives"
LEVELS = {"delay": ("none", "long"), "help": ("alone", "helped")}
TERMS = ("delay", "help", "delay:help")
FAMILIES = {"logistic": "proportions", "poisson": "counts", "cox": "times"}


def rows_of(name):
    with (FOLDER / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def outcome(row, family):
    value, weight = {
        "proportions": (row["completed"], 1.0),
        "counts": (row["stops"], row["minutes"]),
        "times": (row["seconds"], row["came"]),
    }[family]
    return DriveOutcome(row["who"], float(value), float(weight))


def fitted(family, rows, terms=TERMS):
    design = design_of(LEVELS, terms, rows)
    return fit_family(family, [outcome(row, family) for row in rows], design, terms)


@pytest.mark.parametrize("model", FAMILIES)
def test_estimates_and_robust_errors_are_those_of_r(model):
    found = fitted(FAMILIES[model], rows_of("drives.csv"))
    expected = [one for one in rows_of("fits.csv") if one["model"] == model]
    people = found.participants
    # Cox's coefficients are of longer times, and its variances are those of R times n / (n - 1)
    sign, factor = (-1.0, math.sqrt(people / (people - 1))) if model == "cox" else (1.0, 1.0)
    assert len(found.coefficients) == len(expected)
    for ours, theirs in zip(found.coefficients, expected, strict=True):
        assert ours.estimate.value == pytest.approx(sign * float(theirs["estimate"]), rel=1e-5)
        assert ours.error == pytest.approx(factor * float(theirs["error"]), rel=1e-4)
        assert ours.df == people - 4


@pytest.mark.parametrize("model", FAMILIES)
def test_terms_have_the_robust_score_tests_that_r_computes(model):
    found = fitted(FAMILIES[model], rows_of("drives.csv"))
    expected = [one for one in rows_of("fits.csv") if one["model"] == f"score-{model}"]
    assert len(found.terms) == len(expected) == 3
    for ours, theirs in zip(found.terms, expected, strict=True):
        assert ours.f == pytest.approx(float(theirs["estimate"]), rel=1e-5)
        assert ours.p == pytest.approx(float(theirs["error"]), rel=1e-5)
    half = next(one.estimate for one in found.coefficients if one.name == "delay none")
    assert found.terms[0].difference.value == pytest.approx(2.0 * half.value)


def test_times_of_different_participants_have_rs_log_rank_test_and_median():
    rows = rows_of("drives.csv")
    alone = [row for row in rows if row["help"] == "alone"]
    sides = {
        level: [
            DriveOutcome(f"{row['who']}-{level}", float(row["seconds"]), float(row["came"]))
            for row in alone
            if row["delay"] == level
        ]
        for level in LEVELS["delay"]
    }
    found = compare_drives("times", sides, is_paired=False)
    expected = {one["model"]: float(one["estimate"]) for one in rows_of("fits.csv")}
    assert found.name == "log-rank χ²"
    assert found.statistic == pytest.approx(expected["log-rank"])
    assert found.p == pytest.approx(stats.chi2.sf(expected["log-rank"], 1))
    assert (found.effect_name, found.effect.value < 1.0) == ("hazard ratio", True)
    everybody = [outcome(row, "times") for row in rows]
    assert median_time(everybody) == pytest.approx(expected["median"])


def drives(*values, start=0):
    return [DriveOutcome(f"P{start + n}", float(value)) for n, value in enumerate(values)]


def test_single_drives_of_different_participants_have_a_test_of_proportions():
    first, second = drives(*[1] * 18, *[0] * 2), drives(*[1] * 10, *[0] * 10, start=20)
    found = compare_drives("proportions", {"a": first, "b": second}, is_paired=False)
    assert (found.name, found.n) == ("N−1 χ²", 40)
    assert found.difference.value == pytest.approx(0.4)


def test_single_drives_of_the_same_participants_have_a_paired_test_of_proportions():
    found = compare_drives(
        "proportions",
        {"a": drives(1, 1, 1, 1, 1, 0, 1), "b": drives(0, 0, 0, 0, 0, 0, 1)},
        is_paired=True,
    )
    assert (found.name, found.n, found.statistic) == ("McNemar mid-p", 7, 5.0)


def test_several_drives_of_a_participant_are_a_cluster():
    first = drives(1, 1, 1, 0, 1, 1) + drives(1, 0, 1, 1, 1, 1)
    second = drives(0, 1, 0, 0, 1, 0) + drives(1, 0, 0, 1, 1, 0)
    sides = {"a": first, "b": second}
    found = compare_drives("proportions", sides, is_paired=True, is_single=False)
    assert (found.name, found.n, found.effect_name) == ("score F (logistic)", 6, "odds ratio")
    assert found.effect.value > 1.0


def test_a_rate_ratio_counts_events_per_minute():
    first = [DriveOutcome(f"P{n}", 10.0 + n % 3, 2.0) for n in range(8)]
    second = [DriveOutcome(f"Q{n}", 10.0 + n % 3, 4.0) for n in range(8)]
    found = compare_drives("counts", {"a": first, "b": second}, is_paired=False)
    assert (found.effect_name, found.effect.value) == ("rate ratio", pytest.approx(2.0))
    assert found.p < 0.001


def test_a_level_without_a_failure_has_a_test_and_no_coefficients():
    rows = [{"delay": delay} for delay in LEVELS["delay"] for _ in range(12)]
    outcomes = drives(*[1] * 12) + drives(*[1, 0, 0] * 4, start=12)
    found = fit_family("proportions", outcomes, design_of(LEVELS, ("delay",), rows), ("delay",))
    assert found.terms[0].p < 0.01
    assert found.coefficients == ()
    assert found.remark == "no estimate: the effects separate the outcomes completely"


def test_error_explains_why_a_model_cannot_be_fitted():
    rows = [{"delay": delay} for delay in LEVELS["delay"] for _ in range(2)]
    design = design_of(LEVELS, ("delay",), rows)
    with pytest.raises(CannotFitError, match="no variance"):
        fit_family("proportions", drives(1, 1, 1, 1), design, ("delay",))
    with pytest.raises(CannotFitError, match="fewer than three participants"):
        fit_family("proportions", drives(1, 0) + drives(0, 1), design, ("delay",))


def test_sides_that_separate_the_outcomes_have_a_test_and_no_ratio():
    own = range(12)
    first = [DriveOutcome(f"P{n}", 100.0 + n) for n in own]
    second = [DriveOutcome(f"P{n}", 200.0 + 3 * n) for n in own]
    found = compare_drives("times", {"a": first, "b": second}, is_paired=True)
    assert (found.name, found.n, found.effect_name) == ("score F (Cox)", 12, "")
    assert found.p < 0.001


def test_the_score_test_of_counts_is_the_test_of_participants_summed_residuals():
    rows = rows_of("drives.csv")
    sides = {
        level: [outcome(row, "counts") for row in rows if row["delay"] == level]
        for level in LEVELS["delay"]
    }
    found = compare_drives("counts", sides, is_paired=True)
    rate = sum(float(row["stops"]) for row in rows) / sum(float(row["minutes"]) for row in rows)
    minutes = {level: sum(one.weight for one in side) for level, side in sides.items()}
    mean = (minutes["none"] - minutes["long"]) / sum(minutes.values())
    scores = dict.fromkeys((row["who"] for row in rows), 0.0)
    for row in rows:
        sign = 1.0 if row["delay"] == "none" else -1.0
        scores[row["who"]] += (sign - mean) * (float(row["stops"]) - rate * float(row["minutes"]))
    expected = stats.ttest_1samp(list(scores.values()), 0.0)
    assert found.statistic == pytest.approx(expected.statistic**2)
    assert found.p == pytest.approx(expected.pvalue)


def test_times_that_never_came_have_no_test_and_no_median():
    never = [DriveOutcome(f"P{n}", 300.0, 0.0) for n in range(6)]
    found = compare_drives("times", {"a": never[:3], "b": never[3:]}, is_paired=False)
    assert (found.is_known, found.remark) == (False, "the time came in no drive")
    assert median_time(never) is None


def test_a_side_of_one_participant_is_left_out():
    found = compare_drives(
        "counts", {"a": drives(1, 2, 3), "b": drives(4, start=9)}, is_paired=False
    )
    assert found.remark == "b: left out, n = 1; fewer than two conditions to compare"


def test_drive_that_ended_before_any_time_came_leaves_the_hazard_ratio_as_it_is():
    first = [DriveOutcome(f"P{n}", 100.0 + 7 * (n % 5), float(n % 4 > 0)) for n in range(12)]
    second = [DriveOutcome(f"P{n}", 110.0 + 9 * (n % 7), float(n % 3 > 0)) for n in range(12)]
    without = compare_drives("times", {"a": first, "b": second}, is_paired=True)
    early = DriveOutcome("P0", 5.0, 0.0)
    found = compare_drives("times", {"a": [*first, early], "b": second}, is_paired=True)
    assert found.effect_name == "hazard ratio"
    assert found.effect.value == pytest.approx(without.effect.value)
    assert found.effect.low == pytest.approx(without.effect.low)


def test_cell_without_a_success_leaves_no_coefficients_with_endless_intervals():
    """Three coefficients share what runs to infinity, so that none of them is very large."""
    seconds = {("none", "alone"): 50.0, ("none", "helped"): 52.0, ("long", "alone"): 60.0}
    outcomes, rows = [], []
    for delay, help_ in product(LEVELS["delay"], LEVELS["help"]):
        came = seconds.get((delay, help_))
        for n in range(4):
            outcomes.append(DriveOutcome(f"{delay}{n}", (came or 72.0) + 3 * n, float(bool(came))))
            rows.append({"delay": delay, "help": help_})
    terms = ["delay", "help", "delay:help"]
    found = fit_family("times", outcomes, design_of(LEVELS, terms, rows), terms)
    assert (found.coefficients, found.terms[0].p < 0.05) == ((), True)


@pytest.mark.parametrize("family", ["proportions", "times"])
def test_effect_beside_others_that_separate_the_outcomes_has_no_test(family):
    """With much delay no participant succeeds. Estimates of the interaction diverge without an
    effect of the help, and the remaining test would depend on where the fit stops.
    """
    cells = {("none", "alone"): [1, 1, 1, 1], ("none", "helped"): [1, 1, 0, 1]}
    outcomes, rows = [], []
    for delay, help_ in product(LEVELS["delay"], LEVELS["help"]):
        for n, value in enumerate(cells.get((delay, help_), [0, 0, 0, 0])):
            seconds = 30.0 + 5.0 * n + 2.0 * len(help_) if value else 100.0
            given = (float(value), 1.0) if family == "proportions" else (seconds, float(value))
            outcomes.append(DriveOutcome(f"{delay}{n}", *given))
            rows.append({"delay": delay, "help": help_})
    found = fit_family(family, outcomes, design_of(LEVELS, TERMS, rows), TERMS)
    delay, help_, both = found.terms
    assert delay.p < 0.01
    assert math.isnan(help_.p)
    assert math.isnan(both.p)
