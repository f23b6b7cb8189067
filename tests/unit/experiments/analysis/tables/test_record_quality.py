"""The quality of a record: each rule alone, at its bound and beyond."""

import math
from dataclasses import replace

import pytest

from experiments.analysis.tables.summaries import problems_of
from experiments.dataset.records import SessionRecord
from experiments.definition.schema import Quality
from tests.support.analysis.tables import measured

RULES = Quality()
GOOD = {"rate": 4.0, "longest_gap": 0.5, "clock_offset": 0.01}


def record(session=None, **changed):
    session = session or SessionRecord("s", "a", "giraff", first_motion=3.0)
    return measured(session, **GOOD | changed)


def test_a_good_record_is_good():
    assert not problems_of(record(), RULES)


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
    assert [*problems_of(record(**values), RULES)] == [word]


@pytest.mark.parametrize("values", [{"rate": 3.5}, {"longest_gap": 2.0}, {"clock_offset": 0.25}])
def test_a_record_at_a_bound_is_good(values):
    assert not problems_of(record(**values), RULES)


def test_mismatch_and_operator_fail_a_record_if_the_study_requires_it():
    session = SessionRecord(
        "s", "a", "giraff", first_motion=3.0, mismatch="assist off, not steer", operator=True
    )
    lenient = Quality(condition_applied=False, operator_absent=False)
    assert [*problems_of(record(session), RULES)] == ["condition", "operator"]
    assert not problems_of(record(session), lenient)


def test_session_without_a_drive_may_lack_states():
    session = replace(record().session, first_motion=math.nan)
    unknown = dict.fromkeys(("rate", "longest_gap", "clock_offset"), math.nan)
    assert not problems_of(record(session, **unknown), RULES)
