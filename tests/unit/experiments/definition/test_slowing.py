"""What safety limits leave of a drive over a network."""

import pytest
from hypothesis import given, strategies as st

from experiments.definition.schema import Impairment, Network
from experiments.definition.slowing import REAL_COMMANDS, longest_video_delay, predicted
from tests.support.examples import examples

LIMITS = 0.25, 1.0


def held(delay, jitter=0.0):
    return Network(control=Impairment(delay=delay, jitter=jitter))


def test_without_impairment_nothing_is_slowed():
    found = predicted(Network(), *LIMITS)
    assert (found.share, found.refused, found.is_slowed) == (1.0, 0.0, False)


def test_a_delay_of_200_ms_leaves_about_a_quarter_of_the_speed():
    """Drives with that delay went at 0.08 m/s instead of 0.28 m/s."""
    found = predicted(held(0.2), *LIMITS)
    assert found.share == pytest.approx(0.08 / 0.28, abs=0.01)
    assert found.refused == 0.0


def test_jitter_makes_some_commands_too_old():
    found = predicted(held(0.2, 0.07), *LIMITS)
    assert found.refused == pytest.approx(0.25, abs=0.03)
    assert found.is_slowed


@examples(50, thorough=1000)
@given(st.floats(0.0, 0.4), st.floats(0.0, 0.4), st.floats(0.01, 0.2))
def test_more_delay_never_leaves_more(delay, video, more):
    network = Network(control=Impairment(delay=delay), video=Impairment(delay=video))
    later = Network(control=Impairment(delay=delay + more), video=Impairment(delay=video))
    before, after = predicted(network, *LIMITS), predicted(later, *LIMITS)
    assert (1.0 - after.refused) * after.share <= (1.0 - before.refused) * before.share


@examples(50, thorough=1000)
@given(st.floats(0.0, 0.5))
def test_slowing_begins_at_half_of_the_age_and_the_longest_video_delay_is_below(delay):
    assert predicted(held(delay), *LIMITS).is_slowed == (delay + REAL_COMMANDS > 0.125 + 1e-9)
    longest = longest_video_delay(1.0)
    video = Network(video=Impairment(delay=min(delay, longest)))
    assert not predicted(video, *LIMITS).is_slowed
