import numpy as np
import pytest

from experiments.analysis.quality import (
    frozen_video,
    input_lengths,
    never_moved,
    regular_input,
)
from experiments.dataset.columns import columns_of
from experiments.dataset.records import SessionRecord
from experiments.dataset.states import NETWORK, STATES
from experiments.definition.recruitment.quality_flags import Grade

RATE = 5.0  # states in a second


def session(**fields) -> SessionRecord:
    return SessionRecord("S", "P", "giraff", **{"first_frame": 1.0, "ended": 61.0, **fields})


# --- never moved ----------------------------------------------------------------------------------


def test_a_driver_who_saw_the_video_and_never_moved_is_flagged():
    assert never_moved(session(fault_side="visitor")) == (
        Grade.SERIOUS,
        "saw the video for 60 s, never moved",
    )


@pytest.mark.parametrize(
    "fields",
    [
        {"first_motion": 5.0},
        {"ended": 6.0},
        {"first_frame": float("nan")},
        {"ended": float("nan")},
        {"fault_side": "network"},
        {"fault_side": "robot"},
        {"fault_side": "platform"},
        {"fault_side": "operator"},
    ],
)
def test_drivers_who_moved_or_could_not_are_not_flagged(fields):
    assert never_moved(session(**fields)) is None


# --- regular input --------------------------------------------------------------------------------


def states_of(lengths, *, rest: float = 0.0):
    """States of a driver who alternates forward and left for these seconds, with rests between."""
    linear, angular = [], []
    for n, length in enumerate(lengths):
        count = round(length * RATE)
        forward = n % 2 == 0
        linear += [0.3 if forward else 0.0] * count + [np.nan] * round(rest * RATE)
        angular += [0.0 if forward else 0.5] * count + [np.nan] * round(rest * RATE)
    stamps = np.arange(len(linear)) / RATE
    return columns_of(STATES, stamp=stamps, asked_linear=linear, asked_angular=angular)


@pytest.mark.parametrize("rest", [0.0, 1.0])
def test_inputs_of_one_length_are_those_of_a_program(rest):
    found = regular_input(states_of([2.0] * 20, rest=rest))
    assert found is not None
    assert found[0] is Grade.SERIOUS


def test_inputs_that_vary_by_a_sample_are_still_doubtful():
    rng = np.random.default_rng(3)
    found = regular_input(states_of(2.0 + 0.2 * rng.integers(-1, 2, 30)))
    assert found is not None
    assert found[0] >= Grade.DOUBTFUL


@pytest.mark.parametrize("seed", range(20))
def test_inputs_as_varied_as_a_persons_are_not_flagged(seed):
    lengths = np.random.default_rng(seed).lognormal(0.3, 0.6, 40)
    assert regular_input(states_of(lengths)) is None


def test_a_few_inputs_say_nothing():
    assert regular_input(states_of([2.0] * 8)) is None
    assert regular_input(columns_of(STATES)) is None


def test_the_first_and_the_last_input_and_rests_are_left_out():
    states = states_of([9.0, 1.0, 2.0, 1.0, 9.0])
    lengths = input_lengths(states["stamp"], states["asked_linear"], states["asked_angular"])
    assert lengths == pytest.approx([1.0, 2.0, 1.0])


# --- frozen video ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frozen", "grade"),
    [(0, None), (2, None), (3, Grade.NOTE), (12, Grade.DOUBTFUL), (30, Grade.SERIOUS)],
)
def test_seconds_without_a_new_frame_are_graded_by_their_share(frozen, grade):
    rates = [0.0] * frozen + [24.0] * (60 - frozen)
    network = columns_of(NETWORK, stamp=np.arange(1, 61), fps=rates)
    found = frozen_video(network, session())
    assert (found and found[0]) == grade


def test_samples_before_the_first_frame_and_after_the_end_do_not_count():
    stamps = np.arange(-60, 181)
    rates = np.where((stamps >= 1) & (stamps <= 61), 24.0, 0.0)
    assert frozen_video(columns_of(NETWORK, stamp=stamps, fps=rates), session()) is None


def test_a_session_with_few_samples_is_not_judged():
    network = columns_of(NETWORK, stamp=np.arange(1, 10), fps=np.zeros(9))
    assert frozen_video(network, session()) is None
