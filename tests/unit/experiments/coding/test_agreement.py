"""Agreement of coders: the published examples, bins, tolerance, missing codings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.coding.agreement import (
    Matches,
    aligned,
    alphas,
    block_coincidences,
    block_sums,
    coded_bins,
    event_kappas,
    kappas,
    matched,
    sums_of,
)
from experiments.coding.reliability import event_kappa, reliability
from experiments.coding.scheme import CodedEvent
from tests.support.examples import examples

GAP = np.nan


def test_kappa_of_cohens_own_example():
    # Cohen (1960), table 2: 200 cases in three diagnoses; p_o = .70, p_c = .41, kappa = .492.
    table = np.array([[88, 14, 18], [10, 40, 10], [2, 6, 12]], dtype=float)
    assert cohen_kappa(table) == pytest.approx(0.29 / 0.59)
    assert cohen_kappa(table) == pytest.approx(0.492, abs=5e-4)


def test_kappa_is_unknown_without_variation():
    assert cohen_kappa(np.zeros((2, 2))) is None
    assert cohen_kappa(np.array([[10.0, 0.0], [0.0, 0.0]])) is None


def cohen_kappa(table: np.ndarray) -> float | None:
    found = float(kappas(sums_of(np.array(table, dtype=float)[None]))[0])
    return None if np.isnan(found) else found


def krippendorff_alpha(values: np.ndarray) -> float | None:
    """Alpha of (coders, units) with nan for a missing value, all units in one block."""
    known = np.unique(values[~np.isnan(values)])
    numbered = np.where(np.isnan(values), -1, np.searchsorted(known, values))
    block = np.zeros(values.shape[1], dtype=np.int64)
    found = float(alphas(block_coincidences(numbered, block, (1, len(known))))[0])
    return None if np.isnan(found) else found


def letters(*rows: str) -> np.ndarray:
    return np.array(
        [
            [GAP if sign == "." else float(ord(sign)) for sign in row.replace(" ", "")]
            for row in rows
        ]
    )


@pytest.mark.parametrize(
    ("values", "alpha"),
    [
        # Krippendorff (2011), "Computing Krippendorff's Alpha-Reliability", section A: two
        # observers, binary data.
        (letters("0 1 0 0 0 0 0 0 1 0", "1 1 1 0 0 1 0 0 0 0"), 0.095),
        # Section B: two observers, nominal data.
        (letters("a a b b d c c c e d d a", "b a b b b c c c e d d d"), 0.692),
        # Section C: four observers, nominal data with missing values.
        (
            letters(
                "1 2 3 3 2 1 4 1 2 . . .",
                "1 2 3 3 2 2 4 1 2 5 . 3",
                ". 3 3 3 2 3 4 2 2 5 1 .",
                "1 2 3 3 2 4 4 1 2 5 1 .",
            ),
            0.743,
        ),
    ],
)
def test_alpha_of_krippendorffs_own_examples(values, alpha):
    assert krippendorff_alpha(values) == pytest.approx(alpha, abs=5e-4)


def test_alpha_is_unknown_without_variation_or_pairs():
    assert krippendorff_alpha(np.zeros((2, 5))) is None
    assert krippendorff_alpha(letters("1 2 .", ". . 3")) is None


@examples(50, thorough=1000)
@given(st.lists(st.sampled_from([0.0, 1.0]), min_size=2, max_size=30))
def test_coders_who_agree_in_everything_have_one_or_no_value(values):
    row = np.array(values)
    table = np.array([[(row == 0).sum(), 0], [0, (row == 1).sum()]], dtype=float)
    expected = 1.0 if len(set(values)) == 2 else None
    assert krippendorff_alpha(np.stack([row, row])) == expected
    assert cohen_kappa(table) == (None if expected is None else pytest.approx(1.0))


def point(at: float) -> CodedEvent:
    return CodedEvent("a", at)


def interval(begin: float, end: float, code: str = "b") -> CodedEvent:
    return CodedEvent(code, begin, end)


def test_a_point_counts_in_its_bin_and_an_interval_where_it_covers_the_middle():
    assert coded_bins([point(0.0), point(2.5), point(4.0)], "a", 4.0, 1.0).tolist() == [1, 0, 1, 1]
    assert coded_bins([interval(0.6, 2.5)], "b", 4.0, 1.0).tolist() == [0, 1, 0, 0]
    assert coded_bins([interval(0.5, 2.51)], "b", 4.0, 1.0).tolist() == [1, 1, 1, 0]
    assert coded_bins([], "b", 0.0, 1.0).tolist() == [0]


@pytest.mark.parametrize("width", [0.0, -1.0, 1e-6])
def test_a_width_that_makes_no_sense_is_refused(width):
    with pytest.raises(ValueError, match="bin"):
        coded_bins([], "a", 100.0, width)


def test_events_match_once_within_the_tolerance():
    one, two = [point(1.0), point(1.2), point(5.0)], [point(1.1), point(5.5), point(9.0)]
    assert matched(one, two, "a", 0.5) == Matches(both=2, first=1, second=1)
    assert matched(one, two, "a", 0.4) == Matches(both=1, first=2, second=2)
    assert matched(one, [], "a", 0.5) == Matches(both=0, first=3, second=0)


def test_agreement_over_several_sessions_of_coders_of_whom_one_left_some_out():
    first = (4.0, [[interval(0, 2)], [interval(0, 2)], None])
    second = (4.0, [[interval(0, 4)], [interval(0, 2)], [interval(0, 4)]])
    (found,) = reliability([first, second], ["b"], width=1.0, tolerance=0.5).codes
    values = letters("11001111", "11001100", "....1111")
    assert found.alpha.value == pytest.approx(krippendorff_alpha(values))
    assert found.bins == 8
    assert [pair.coders for pair in found.pairs] == [(0, 1), (0, 2), (1, 2)]
    kappa = cohen_kappa(np.array([[2.0, 0.0], [2.0, 4.0]]))
    assert found.pairs[0].kappa.value == pytest.approx(kappa)
    assert found.pairs[0].agreement.value == pytest.approx(6 / 8)
    assert found.pairs[0].matches == Matches(both=2, first=0, second=0)
    assert found.pairs[1].kappa.value is None


def test_all_codes_together_are_the_set_of_codes_in_a_bin():
    one = [interval(0, 2), interval(1, 3, "c")]
    two = [interval(0, 2), interval(2, 3, "c")]
    found = reliability([(3.0, [one, two])], ["b", "c"], width=1.0, tolerance=0.5)
    together = found.codes[-1]
    assert together.code == ""
    assert together.pairs[0].agreement.value == pytest.approx(2 / 3)  # b|bc|c against b|b|c
    # Cohen (1960) by hand: p_o = 2/3, p_e = (1/3)(2/3) + (1/3)(1/3) = 3/9
    assert together.pairs[0].kappa.value == pytest.approx((2 / 3 - 3 / 9) / (1 - 3 / 9))


def test_without_sessions_nothing_is_known():
    found = reliability([], ["b"], width=1.0, tolerance=0.5)
    assert (found.codes[0].alpha.value, found.codes[0].pairs, found.events) == (None, (), ())


# --- events ---------------------------------------------------------------------------------------


def test_events_near_each_other_of_different_codes_are_confusions():
    one = [point(1.0), interval(5.0, 6.0), point(9.0)]
    two = [point(1.2), CodedEvent("c", 5.3, 6.0), interval(20.0, 21.0)]
    pairs = aligned(one, two, 0.5)
    assert sorted(pairs) == [("", "b"), ("a", ""), ("a", "a"), ("b", "c")]
    assert sorted(aligned(one, two, 0.1)) == [
        *(("", "a"), ("", "b"), ("", "c"), ("a", ""), ("a", ""), ("b", "")),
    ]


def test_kappa_of_events_is_cohens_where_nothing_is_left_out_by_one():
    table = np.array([[[88.0, 14, 18, 0], [10, 40, 10, 0], [2, 6, 12, 0], [0, 0, 0, 0]]])
    assert event_kappas(table)[0] == pytest.approx(0.492, abs=5e-4)


def test_kappa_of_events_takes_the_uncountable_cell_from_what_is_expected():
    # Quasi-independence of [[a, b], [c, -]] fits the three cells exactly when b and c are the only
    # ways to disagree: with one code, expected agreement is all of the observed one.
    assert np.isnan(event_kappas(np.array([[[10.0, 0.0], [0.0, 0.0]]]))[0])
    # two codes, symmetric: rows and columns (12, 12, 4), all cells but the last one free
    table = np.array([[[10.0, 0.0, 2.0], [0.0, 10.0, 2.0], [2.0, 2.0, 0.0]]])
    # By symmetry the fit is x in the four cells of codes and y beside: 2x + y = 12, 2y = 4.
    x = 5.0
    assert event_kappas(table)[0] == pytest.approx((20 - 2 * x) / (28 - 2 * x))


# --- intervals ------------------------------------------------------------------------------------


def test_the_interval_of_independent_units_is_that_of_statsmodels():
    # statsmodels 0.15.0, stats.inter_rater.cohens_kappa of Cohen's table: kappa 0.49152542,
    # 95 % from 0.39156370 to 0.59148715. krippendorff 0.8 on section C gives 0.743421052631579,
    # as above. Each unit is a block of its own here.
    table = np.array([[88, 14, 18], [10, 40, 10], [2, 6, 12]])
    cells = [(a, b) for a in range(3) for b in range(3) for _ in range(table[a, b])]
    values = np.array(cells).T
    sums = block_sums(values, np.arange(200), (200, 3))
    generator = np.random.default_rng(1)
    weights = generator.multinomial(200, np.full(200, 1 / 200), size=2000).astype(float)
    drawn = kappas(type(sums)(*(weights @ part for part in sums)))
    low, high = np.percentile(drawn, [2.5, 97.5])
    assert (low, high) == pytest.approx((0.39156, 0.59149), abs=0.01)


def test_intervals_hold_the_value_and_shrink_with_more_blocks():
    def of(minutes: int):
        generator = np.random.default_rng(2)
        begins = np.sort(generator.choice(minutes * 6, minutes, replace=False)) * 10.0
        one = [interval(t, t + 7.0) for t in begins]
        two = [interval(t + generator.uniform(-2, 2) + 2.0, t + 8.0) for t in begins]
        (found,) = reliability(
            [(minutes * 60.0 + 10.0, [one, two])], ["b"], width=1.0, tolerance=3.0
        ).codes
        return found.pairs[0].kappa

    short, long = of(10), of(200)
    for one in (short, long):
        assert one.low < one.value < one.high
    assert long.high - long.low < (short.high - short.low) / 2


def test_few_blocks_have_no_interval():
    one = event_kappa(np.array([[1.0, 0.0], [0.0, 0.0]]))
    assert (one.value, one.low) == (None, None)
    (found,) = reliability(
        [(270.0, [[interval(0, 50)], [interval(0, 90)]])], ["b"], width=1.0, tolerance=1.0
    ).codes
    assert found.pairs[0].kappa.value is not None
    assert found.pairs[0].kappa.low is None


@examples(20, thorough=200)
@given(st.integers(0, 2**31), st.integers(2, 4))
def test_the_coincidences_of_two_coders_are_their_table_both_ways(seed, categories):
    generator = np.random.default_rng(seed)
    values = generator.integers(-1, categories, size=(2, 30))
    block = np.arange(30) // 7
    table = block_sums(values, block, (5, categories))
    both = block_coincidences(values, block, (5, categories))
    assert both.agreed == pytest.approx(2 * table.agreed)
    assert both.rows == pytest.approx(table.rows + table.columns)
