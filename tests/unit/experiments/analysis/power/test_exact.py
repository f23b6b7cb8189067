import numpy as np
import pytest
from scipy import stats

from experiments.analysis.power.exact import participants_needed, power


# Cohen 1988, table 2.3.5, and what G*Power 3.1 gives for two-sided t tests at 5 % and 80 %.
@pytest.mark.parametrize(
    ("effect", "between", "within"), [(0.2, 394, 199), (0.5, 64, 34), (0.8, 26, 15)]
)
def test_the_numbers_are_those_of_the_tables(effect, between, within):
    assert participants_needed(effect, "between").per_group == between
    assert participants_needed(effect, "between").total == 2 * between
    assert participants_needed(effect, "within").total == within


def test_without_an_effect_the_chance_is_that_of_an_error():
    assert power(0.0, 30, "between") == pytest.approx(0.05)
    assert participants_needed(0.0, "between") is None


def test_the_chance_is_what_many_studies_show():
    rng = np.random.default_rng(5)
    first, second = rng.normal(0.6, 1, (2000, 25)), rng.normal(0, 1, (2000, 25))
    found = stats.ttest_ind(first, second, axis=1).pvalue < 0.05
    assert found.mean() == pytest.approx(power(0.6, 25, "between"), abs=0.035)


def test_more_conditions_need_more_in_each():
    two, four = participants_needed(0.5, "between"), participants_needed(0.5, "between", groups=4)
    assert four.per_group > two.per_group
    assert four.total == 4 * four.per_group


def test_one_participant_finds_nothing():
    assert power(2.0, 1, "within") == 0.0
