"""Charging and discharging."""

import pytest

from robots.simulator.physics import battery
from robots.world.robot_models import GIRAFF

MODEL = GIRAFF.battery


def after(charge: float, seconds: float, effort: float, *, charging: bool) -> float:
    for _ in range(int(seconds)):
        charge = battery.step(charge, MODEL, effort, 1.0, charging=charging)
    return charge


def test_driving_costs_more_than_standing_and_both_cost() -> None:
    assert after(0.9, 3600, 1.0, charging=False) < after(0.9, 3600, 0.0, charging=False) < 0.9


def test_an_hour_of_standing_costs_idle_power_over_capacity() -> None:
    assert 0.9 - after(0.9, 3600, 0.0, charging=False) == pytest.approx(
        MODEL.idle / MODEL.capacity, rel=1e-6
    )


def test_a_charge_lasts_hours_and_the_dock_fills_it_again() -> None:
    assert after(1.0, 3 * 3600, 0.5, charging=False) > 0.0
    assert after(0.0, 4 * 3600, 0.0, charging=True) == 1.0


def test_charge_stays_between_empty_and_full() -> None:
    assert after(0.01, 7200, 1.0, charging=False) == 0.0


def test_voltage_depends_on_charge_and_charger() -> None:
    assert battery.voltage(1.0, MODEL, charging=False) == pytest.approx(29.0)
    assert battery.voltage(0.2, MODEL, charging=False) == pytest.approx(25.0)
    assert battery.voltage(0.5, MODEL, charging=True) > battery.voltage(0.5, MODEL, charging=False)
