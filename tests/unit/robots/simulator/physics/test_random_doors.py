"""Doors that move by themselves."""

import numpy as np

from robots.simulator.physics.random_doors import RandomDoors


def random_doors(mean: float = 10.0, doors: tuple[str, ...] = ("a", "b", "c")) -> RandomDoors:
    return RandomDoors(doors, mean, np.random.default_rng(1))


def test_at_most_one_door_is_closed_at_any_time() -> None:
    doors, air = dict.fromkeys("abc", "open"), random_doors()
    for second in range(2000):
        doors |= air.due(float(second))
        assert list(doors.values()).count("closed") <= 1


def test_doors_move_about_as_often_as_set() -> None:
    air = random_doors()
    assert 150 < sum(bool(air.due(0.1 * step)) for step in range(20000)) < 250


def test_without_doors_or_without_wind_nothing_moves() -> None:
    assert random_doors(mean=0.0).due(1e6) == {}
    assert random_doors(doors=()).due(1e6) == {}


def test_a_door_without_random_motion_stays_still() -> None:
    air = random_doors()
    air.leave({"a", "b"})
    assert {name for second in range(2000) for name in air.due(float(second))} == {"c"}
    air.leave({"c"})
    assert air.due(1e9) == {}
