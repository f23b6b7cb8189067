"""A session in a few numbers."""

import pytest

from sessions.recording.network_summary import summarise_network
from sessions.recording.summary import summarise


def state(stamp, distance, *methods, **more):
    return {
        "stamp": stamp,
        "distance": distance,
        "applied": [{"method": method, "way": "mqtt"} for method in methods],
        **more,
    }


def test_distance_is_the_growth_of_the_odometer_in_each_run():
    first, second = [state(0.0, 100.0), state(1.0, 101.5)], [state(5.0, 0.0), state(6.0, 2.0)]
    assert summarise([("a", first), ("b", second)])["distance"] == pytest.approx(3.5)


def test_commands_are_counted_by_method_and_way():
    first = state(0.0, 0.0, "keyboard", "keyboard")
    last = state(2.0, 0.0, "touch", contacts=2, clearance=0.3)
    found = summarise([("a", [first, last])], missing=4)
    expected = {"commands": 3, "methods": {"keyboard": 2, "touch": 1}, "ways": {"mqtt": 3}}
    expected |= {"states": 2, "seconds": 2.0, "contacts": 2, "least_clearance": 0.3, "missing": 4}
    assert {name: found[name] for name in expected} == expected


def test_a_session_without_states_has_a_summary_too():
    assert summarise([])["states"] == 0
    assert summarise([])["least_clearance"] is None


def test_the_network_has_median_and_nearest_rank_percentile():
    samples = [
        {"way": "mqtt", "roundTrip": n / 100.0, "loss": 0.1, "freezes": n} for n in range(1, 101)
    ]
    found = summarise_network(samples)
    assert (found.round_trip, found.round_trip_95) == (pytest.approx(0.505), 0.95)
    assert (found.freezes, found.ways) == (100, {"mqtt": 100})
    assert (found.loss, found.fps) == (pytest.approx(0.1), None)
    assert summarise_network([{"way": "mqtt", "roundTrip": 0.3}]).round_trip_95 == 0.3
    assert summarise_network([]).round_trip is None
