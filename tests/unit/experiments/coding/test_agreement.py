"""Agreement of coders: the published examples, bins, tolerance, missing codings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.coding.agreement import (
    Matches,
    agreement,
    cohen_kappa,
    in_bins,
    krippendorff_alpha,
    matched,
)
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
    assert in_bins([point(0.0), point(2.5), point(4.0)], "a", 4.0, 1.0).tolist() == [1, 0, 1, 1]
    assert in_bins([interval(0.6, 2.5)], "b", 4.0, 1.0).tolist() == [0, 1, 0, 0]
    assert in_bins([interval(0.5, 2.51)], "b", 4.0, 1.0).tolist() == [1, 1, 1, 0]
    assert in_bins([], "b", 0.0, 1.0).tolist() == [0]


@pytest.mark.parametrize("width", [0.0, -1.0, 1e-6])
def test_a_width_that_makes_no_sense_is_refused(width):
    with pytest.raises(ValueError, match="bin"):
        in_bins([], "a", 100.0, width)


def test_events_match_once_within_the_tolerance():
    one, two = [point(1.0), point(1.2), point(5.0)], [point(1.1), point(5.5), point(9.0)]
    assert matched(one, two, "a", 0.5) == Matches(both=2, first=1, second=1)
    assert matched(one, two, "a", 0.4) == Matches(both=1, first=2, second=2)
    assert matched(one, [], "a", 0.5) == Matches(both=0, first=3, second=0)


def test_agreement_over_several_sessions_of_coders_of_whom_one_left_some_out():
    first = (4.0, [[interval(0, 2)], [interval(0, 2)], None])
    second = (4.0, [[interval(0, 4)], [interval(0, 2)], [interval(0, 4)]])
    (found,) = agreement([first, second], ["b"], width=1.0, tolerance=0.5)
    values = letters("11001111", "11001100", "....1111")
    assert found.alpha == pytest.approx(krippendorff_alpha(values))
    assert [pair.coders for pair in found.pairs] == [(0, 1), (0, 2), (1, 2)]
    kappa = cohen_kappa(np.array([[2.0, 0.0], [2.0, 4.0]]))
    assert found.pairs[0].kappa == pytest.approx(kappa)
    assert found.pairs[0].matches == Matches(both=2, first=0, second=0)
    assert found.pairs[1].kappa is None


def test_without_sessions_nothing_is_known():
    (found,) = agreement([], ["b"], width=1.0, tolerance=0.5)
    assert (found.alpha, found.pairs) == (None, ())
