"""What kind of number a metric is decides which tests and names it has."""

import pytest

from experiments.analysis.metrics.definitions import (
    CENSORED,
    KINDS,
    METRICS,
    OF_COMPLETED,
    PER_MINUTE,
    label_of,
    unfit_for,
)


def test_every_metric_with_a_kind_is_one():
    known = {column.name for column in METRICS}
    assert set(KINDS) | PER_MINUTE | OF_COMPLETED | CENSORED <= known


@pytest.mark.parametrize(
    ("test", "measure", "instead"),
    [
        ("proportions", "completed", ""),
        ("means", "completed", "proportions"),
        ("mixed", "completed", "proportions"),
        ("counts", "stops", ""),
        ("means", "stops", ""),
        ("counts", "speed", "means, ranks, mixed"),
        ("times", "stops", "means, ranks, mixed, counts"),
        ("times", "task_time", ""),
        ("ranks", "experience.q1", ""),
        ("proportions", "experience.q1", "means, ranks, mixed"),
    ],
)
def test_a_test_that_does_not_fit_a_measure_names_those_that_do(test, measure, instead):
    assert unfit_for(test, measure) == instead


def test_a_rate_and_a_total_of_completed_sessions_say_so():
    assert [label_of(name) for name in ("stops", "path", "speed")] == [
        "stops per min",
        "path (completed)",
        "speed",
    ]
