"""A simulation that keeps up with clocks."""

from itertools import pairwise

import pytest

from robots.simulator.physics.realtime import LONGEST_LAG, STEP, Playback
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_plan

PLAN, _ = load_plan("office")


def playback(start: str = "corridor-centre") -> Playback:
    return Playback(Simulation(GIRAFF, PLAN, seed=1, start=start), 100.0, 5000.0)


@pytest.fixture
def play() -> Playback:
    return playback()


def test_all_steps_that_are_due_are_taken_and_stamped_with_the_wall_clock(play: Playback) -> None:
    assert play.advance(100.105, 5000.105) == 10
    assert play.stamp() == pytest.approx(5000.1, abs=1e-6)
    assert play.advance(100.105, 5000.105) == 0


def test_after_a_pause_of_the_process_the_lost_time_is_dropped(play: Playback) -> None:
    play.simulation.command(0.7, 0.0)
    play.advance(160.0, 5060.0)
    assert play.simulation.time <= LONGEST_LAG + STEP
    assert play.stamp() == pytest.approx(5060.0, abs=0.02)


def test_stamps_follow_a_wall_clock_that_is_set(play: Playback) -> None:
    play.advance(100.1, 5000.1)
    play.advance(100.2, 9000.2)
    assert play.stamp() == pytest.approx(9000.2, abs=0.02)


def test_history_has_commanded_and_real_speeds_of_every_step(play: Playback) -> None:
    play.simulation.command(0.5, 0.0)
    play.advance(100.2, 5000.2)
    rows = play.history(0.1)
    assert len(rows) == 10
    assert [row[1] for row in rows] == [0.5] * 10
    assert 0.0 < rows[0][3] < rows[-1][3] < 0.5
    assert [b[0] - a[0] for a, b in pairwise(rows)] == pytest.approx([STEP] * 9)
    assert len(play.history(1e9)) == 20
    assert play.history(-1.0) == ()


def test_before_the_first_command_the_truth_has_no_command(play: Playback) -> None:
    assert play.truth().commanded_at == 0.0
    play.advance(100.05, 5000.05)
    play.simulation.command(0.1, 0.0)
    assert play.truth().commanded_at == pytest.approx(5000.05, abs=0.02)
