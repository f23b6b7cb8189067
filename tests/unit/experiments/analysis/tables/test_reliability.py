"""The verdict on a record: each rule alone, at its bound and beyond."""

import math
from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.reliability import judge
from experiments.dataset.records import SessionRecord
from experiments.definition.schema import Quality

RULES = Quality()
GOOD = {"rate": 4.0, "longest_gap": 0.5, "clock_offset": 0.01}


def measured(session=None, **changed):
    session = session or SessionRecord("s", "a", "giraff", first_motion=3.0)
    return Measured(session, Milestones(), GOOD | changed, (), np.empty((0, 2)))


def words(found):
    return [word for word, _ in found.problems]


def test_a_good_record_is_good():
    assert judge(measured(), RULES).good


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"rate": 3.49}, "rate"),
        ({"longest_gap": 2.01}, "gap"),
        ({"clock_offset": 0.26}, "clock"),
        ({"clock_offset": math.nan}, "clock_unknown"),
        ({"rate": math.nan}, "no_states"),
    ],
)
def test_each_rule_alone_fails_a_record(values, word):
    found = judge(measured(**values), RULES)
    assert words(found) == [word]
    assert not found.good


@pytest.mark.parametrize("values", [{"rate": 3.5}, {"longest_gap": 2.0}, {"clock_offset": 0.25}])
def test_a_record_at_a_bound_is_good(values):
    assert judge(measured(**values), RULES).good


def test_what_was_applied_otherwise_and_an_operator_fail_it_where_the_study_says_so():
    session = SessionRecord(
        "s", "a", "giraff", first_motion=3.0, mismatch="assist off, not steer", operator=True
    )
    assert words(judge(measured(session), RULES)) == ["condition", "operator"]
    assert judge(measured(session), Quality(condition_applied=False, operator_absent=False)).good


def test_a_session_that_was_never_driven_is_not_failed_for_having_no_states():
    session = replace(measured().session, first_motion=math.nan)
    assert judge(
        measured(session, rate=math.nan, longest_gap=math.nan, clock_offset=math.nan), RULES
    ).good
