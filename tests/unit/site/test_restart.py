"""When a part of the demo that ended is started again, and when it is given up."""

import pytest

from telepresence_site.demo.restart import (
    GiveUp,
    Restart,
    RestartPolicy,
    after_death,
    deaths_in_a_row,
)

POLICY = RestartPolicy(first_delay=1.0, longest_delay=8.0, settled=20.0, quick_deaths=4)


def test_each_quick_death_in_a_row_doubles_the_delay_up_to_the_longest():
    delays = [after_death(POLICY, deaths, is_essential=False) for deaths in range(1, 7)]
    assert delays == [
        Restart(1.0),
        Restart(2.0),
        Restart(4.0),
        Restart(8.0),
        Restart(8.0),
        Restart(8.0),
    ]
    assert after_death(POLICY, 10**6, is_essential=False) == Restart(8.0)


def test_only_what_nothing_works_without_is_given_up_and_not_before_it_died_so_often_in_a_row():
    assert [after_death(POLICY, deaths, is_essential=True) for deaths in (3, 4, 5)] == [
        Restart(4.0),
        GiveUp(),
        GiveUp(),
    ]


@pytest.mark.parametrize(
    ("before", "lived", "deaths"), [(0, 0.1, 1), (2, 19.9, 3), (3, 20.0, 1), (0, 1e6, 1)]
)
def test_a_process_that_has_lived_long_enough_begins_anew(before, lived, deaths):
    assert deaths_in_a_row(POLICY, before, lived) == deaths
