"""When a part of the demo that ended is started again, and when it is given up."""

import pytest

from telepresence_site.demo.supervision import RestartPolicy

POLICY = RestartPolicy(first_delay=1.0, longest_delay=8.0, settled=20.0, quick_deaths=4)


def test_each_quick_death_in_a_row_doubles_the_delay_up_to_a_limit():
    delays = [POLICY.delay(deaths, is_essential=False) for deaths in (1, 2, 3, 4, 5, 10**6)]
    assert delays == [1.0, 2.0, 4.0, 8.0, 8.0, 8.0]


def test_only_an_essential_process_is_given_up_after_enough_quick_deaths():
    assert [POLICY.delay(deaths, is_essential=True) for deaths in (3, 4, 5)] == [4.0, None, None]


@pytest.mark.parametrize(
    ("before", "lived", "deaths"), [(0, 0.1, 1), (2, 19.9, 3), (3, 20.0, 1), (0, 1e6, 1)]
)
def test_a_process_that_lived_long_enough_starts_the_count_again(before, lived, deaths):
    assert POLICY.deaths_in_a_row(before, lived) == deaths
