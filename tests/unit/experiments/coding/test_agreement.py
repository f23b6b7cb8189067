"""Agreement of coders: published examples, other programs, bins, tolerance, intervals."""

import warnings

import krippendorff
import numpy as np
import pytest
from hypothesis import given, strategies as st
from statsmodels.stats.inter_rater import cohens_kappa

from experiments.coding.agreement import (
    Matches,
    alpha,
    coded_bins,
    coincidences,
    estimate,
    event_kappa,
    kappa,
    pair_tables,
    reliability,
)
from experiments.coding.alignment import aligned, matched
from experiments.coding.scheme import CodedEvent
from tests.support.examples import binomial_band, examples, repetitions

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
    return estimate(kappa, table[None]).value


def krippendorff_alpha(values: np.ndarray) -> float | None:
    """Alpha of (coders, units) with nan for a missing value, all units in one cluster."""
    known = np.unique(values[~np.isnan(values)])
    numbered = np.where(np.isnan(values), -1, np.searchsorted(known, values))
    cluster = np.zeros(values.shape[1], dtype=np.int64)
    return estimate(alpha, coincidences(numbered, cluster, (1, len(known)))).value


@examples(30, thorough=300)
@given(st.integers(0, 2**31), st.integers(2, 4), st.integers(2, 4))
def test_kappa_and_alpha_equal_those_of_statsmodels_and_krippendorff(seed, coders, categories):
    generator = np.random.default_rng(seed)
    values = generator.integers(0, categories, size=(coders, 40)).astype(float)
    table = np.zeros((categories, categories))
    np.add.at(table, (values[0].astype(int), values[1].astype(int)), 1.0)
    assert cohen_kappa(table) == pytest.approx(cohens_kappa(table).kappa)
    values[generator.random(values.shape) < 0.2] = GAP
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = krippendorff.alpha(values, level_of_measurement="nominal")
    assert krippendorff_alpha(values) == pytest.approx(expected)


def letters(*rows: str) -> np.ndarray:
    return np.array(
        [
            [GAP if sign == "." else float(ord(sign)) for sign in row.replace(" ", "")]
            for row in rows
        ]
    )


@pytest.mark.parametrize(
    ("values", "expected"),
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
def test_alpha_of_krippendorffs_own_examples(values, expected):
    assert krippendorff_alpha(values) == pytest.approx(expected, abs=5e-4)


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
def test_invalid_width_of_a_bin_is_refused(width):
    with pytest.raises(ValueError, match="bin"):
        coded_bins([], "a", 100.0, width)


def test_events_match_once_within_the_tolerance():
    def sizes(*args):
        return tuple(len(part) for part in matched(*args))

    one, two = [point(1.0), point(1.2), point(5.0)], [point(1.1), point(5.5), point(9.0)]
    assert sizes(one, two, "a", 0.5) == (2, 1, 1)
    assert sizes(one, two, "a", 0.4) == (1, 2, 2)
    assert sizes(one, [], "a", 0.5) == (0, 3, 0)


def test_agreement_over_several_sessions_of_which_one_coder_skipped_some():
    first = (4.0, [[interval(0, 2)], [interval(0, 2)], None])
    second = (4.0, [[interval(0, 4)], [interval(0, 2)], [interval(0, 4)]])
    (found,) = reliability([first, second], ["b"], width=1.0, tolerance=0.5).codes
    values = letters("11001111", "11001100", "....1111")
    assert found.alpha.value == pytest.approx(krippendorff_alpha(values))
    assert found.bins == 8
    assert [pair.coders for pair in found.pairs] == [(0, 1), (0, 2), (1, 2)]
    expected = cohen_kappa(np.array([[2.0, 0.0], [2.0, 4.0]]))
    assert found.pairs[0].kappa.value == pytest.approx(expected)
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


def test_agreement_without_sessions_is_unknown():
    found = reliability([], ["b"], width=1.0, tolerance=0.5)
    assert (found.codes[0].alpha.value, found.codes[0].pairs, found.events) == (None, (), ())


# --- events ---------------------------------------------------------------------------------------


def test_events_near_each_other_of_different_codes_are_confusions():
    one = [point(1.0), interval(5.0, 6.0), point(9.0)]
    two = [point(1.2), CodedEvent("c", 5.3, 6.0), interval(20.0, 21.0)]
    assert sorted(aligned(one, two, 0.5)) == [
        *((1.0, "a", "a"), (5.0, "b", "c"), (9.0, "a", ""), (20.0, "", "b")),
    ]
    assert [codes for _at, *codes in sorted(aligned(one, two, 0.1))] == [
        *(["a", ""], ["", "a"], ["b", ""], ["", "c"], ["a", ""], ["", "b"]),
    ]


def test_kappa_of_events_is_cohens_without_omitted_events():
    table = np.array([[88.0, 14, 18, 0], [10, 40, 10, 0], [2, 6, 12, 0], [0, 0, 0, 0]])
    assert event_kappa(table) == pytest.approx(0.492, abs=5e-4)


def test_kappa_of_events_expects_no_count_in_the_uncountable_cell():
    # Quasi-independence of [[a, b], [c, -]] fits the three cells exactly when b and c are the only
    # ways to disagree: with one code, expected agreement is all of the observed one.
    assert np.isnan(event_kappa(np.array([[10.0, 0.0], [0.0, 0.0]])))
    # two codes, symmetric: rows and columns (12, 12, 4), all cells but the last one free
    table = np.array([[10.0, 0.0, 2.0], [0.0, 10.0, 2.0], [2.0, 2.0, 0.0]])
    # By symmetry the fit is x in the four cells of codes and y beside: 2x + y = 12, 2y = 4.
    x = 5.0
    assert event_kappa(table) == pytest.approx((20 - 2 * x) / (28 - 2 * x))


# --- intervals ------------------------------------------------------------------------------------


def test_the_interval_of_independent_units_is_about_that_of_statsmodels():
    # Cohen's table: kappa 0.4915, 95 % from 0.3916 to 0.5915. Each unit is a cluster here.
    table = np.array([[88, 14, 18], [10, 40, 10], [2, 6, 12]])
    cells = [(a, b) for a in range(3) for b in range(3) for _ in range(table[a, b])]
    found = estimate(kappa, pair_tables(np.array(cells).T, np.arange(200), (200, 3)))
    expected = cohens_kappa(table)
    assert found.low == pytest.approx(expected.kappa_low, abs=0.01)
    assert found.high == pytest.approx(expected.kappa_upp, abs=0.01)


def coded_alike(generator, sessions: int):
    """Codings of sessions, in each of which the coders agree more or less as a whole."""
    found = []
    for _ in range(sessions):
        shift = abs(generator.normal(0.0, 4.0))  # one coder lags, differently in each session
        begins = np.arange(5.0, 160.0, 20.0)
        one = [interval(t, t + 8.0) for t in begins]
        two = [interval(t + shift, t + 8.0 + shift) for t in begins]
        found.append((180.0, [one, two]))
    return found


def kappa_of(sessions):
    return reliability(sessions, ["b"], width=1.0, tolerance=3.0).codes[0].pairs[0].kappa


@pytest.mark.parametrize("sessions", [6, 15])
def test_intervals_cover_the_kappa_of_all_sessions_in_95_of_100_studies(sessions):
    """Agreement differs between sessions: blocks of 30 s, taken as independent, would be far too
    narrow.
    """
    generator, runs = np.random.default_rng(5), repetitions(500, thorough=10_000)

    def tables(count):
        """(n, 2, 2): 180 bins of each session, of which one coder misses and adds a share."""
        share = generator.beta(2, 6, count)
        on = generator.binomial(180, 0.4, count)
        missed, added = generator.binomial(on, share), generator.binomial(180 - on, share * 0.6)
        return np.array([[180 - on - added, added], [missed, on - missed]]).transpose(2, 0, 1)

    truth = kappa(tables(100_000).sum(axis=0))
    found = [estimate(kappa, tables(sessions)) for _ in range(runs)]
    low, high = binomial_band(0.95, runs)
    covered = np.mean([one.low <= truth <= one.high for one in found])
    assert low - 0.01 <= covered <= high + 0.01, covered


def test_intervals_contain_the_value_and_shrink_with_more_sessions():
    generator = np.random.default_rng(2)
    few, many = (kappa_of(coded_alike(generator, count)) for count in (8, 200))
    for one in (few, many):
        assert one.low < one.value < one.high
    assert many.high - many.low < (few.high - few.low) / 2


def test_few_sessions_have_no_interval_and_one_has_its_blocks():
    generator = np.random.default_rng(3)
    assert kappa_of(coded_alike(generator, 3)).low is None
    assert kappa_of(coded_alike(generator, 1)).low is not None
    (found,) = reliability(
        [(100.0, [[interval(0, 50)], [interval(0, 90)]])], ["b"], width=1.0, tolerance=1.0
    ).codes
    assert found.pairs[0].kappa.value is not None
    assert found.pairs[0].kappa.low is None


@examples(20, thorough=200)
@given(st.integers(0, 2**31), st.integers(2, 4))
def test_the_coincidences_of_two_coders_are_their_table_both_ways(seed, categories):
    generator = np.random.default_rng(seed)
    values = generator.integers(-1, categories, size=(2, 30))
    cluster = np.arange(30) // 7
    table = pair_tables(values, cluster, (5, categories))
    assert coincidences(values, cluster, (5, categories)) == pytest.approx(
        table + table.transpose(0, 2, 1)
    )
