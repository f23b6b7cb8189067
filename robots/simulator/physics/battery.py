"""A battery that is drained by standing and driving, and charged in the dock."""

from robots.world.robot_models import BatteryModel

SECONDS_AN_HOUR = 3600.0
CHARGER_VOLTAGE = 0.6  # what a charger lifts the terminals by


def step(charge: float, model: BatteryModel, effort: float, dt: float, *, charging: bool) -> float:
    """Return the charge (0 to 1) after `dt` seconds at `effort`, a share of full speed."""
    power = model.charge - model.idle if charging else -(model.idle + model.drive * effort)
    return min(1.0, max(0.0, charge + power * dt / SECONDS_AN_HOUR / model.capacity))


def voltage(charge: float, model: BatteryModel, *, charging: bool) -> float:
    rest = model.empty_voltage + (model.full_voltage - model.empty_voltage) * charge
    return rest + (CHARGER_VOLTAGE if charging else 0.0)
