"""Every test that a report prints is tried on null data, and every interval on a true value
(benchmarks/studies/type_one_error.py); the rates of 2,000 studies each are in the documentation.
"""

import pytest

from benchmarks.studies.type_one_error import HELD, INTERVALS, NULLS, REJECTED, REPORTS, rates
from experiments.analysis.documents.sentences import METHODS
from tests.support.examples import binomial_band, repetitions
from tests.support.paths import ROOT

SLOW = ("Wald", "score", "whole", "coefficient", "rate", "hazard")  # names of slower cases
PRINTED = (ROOT / "docs" / "explanation" / "statistics.md").read_text(encoding="utf-8")


def rows_of(words):
    """The rates in the table below a head with some words, by the first two cells."""
    lines = PRINTED.splitlines()
    start = next(n for n, line in enumerate(lines) if line.startswith(f"| {words} |")) + 2
    found = {}
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        what, data, rate, _ = (cell.strip() for cell in line.strip("|").split("|"))
        found[what, data] = float(rate)
    return found


def test_every_printed_test_is_tried_on_null_data():
    tried = " ".join(case.what for case in NULLS)
    assert [name for name in METHODS if name not in tried] == []


@pytest.mark.parametrize(
    ("head", "cases", "bounds"),
    [("test", (*NULLS, *REPORTS), REJECTED), ("interval of", INTERVALS, HELD)],
)
def test_documented_rates_are_within_their_bounds(head, cases, bounds):
    found = rows_of(head)
    assert {data for _, data in found} == {case.data for case in cases}
    assert all(any(what.startswith(case.what) for what, _ in found) for case in cases)
    outside = {key: rate for key, rate in found.items() if not bounds[0] <= rate <= bounds[1]}
    assert outside == {}


def outside_of_the_band(case, rate):
    """The rates of a case that are too far from the true one."""
    runs = repetitions(30 if case.what.startswith(SLOW) else 200, thorough=2000)
    low, high = binomial_band(rate, runs)
    found = {name: share / 100.0 for name, (share, _) in rates(case, runs).items()}
    return {name: one for name, one in found.items() if not low - 0.02 <= one <= high + 0.02}


@pytest.mark.slow
@pytest.mark.parametrize("case", [*NULLS, *REPORTS], ids=lambda case: f"{case.what}-{case.data}")
def test_a_true_null_is_rejected_in_5_of_100_studies(case):
    assert outside_of_the_band(case, 0.05) == {}


@pytest.mark.slow
@pytest.mark.parametrize("case", INTERVALS, ids=lambda case: f"{case.what}-{case.data}")
def test_an_interval_holds_the_true_value_in_95_of_100_studies(case):
    assert outside_of_the_band(case, 0.95) == {}
