"""The last report of a robot that is ready in its charging station."""

from typing import Any

from robots.models import FloorPlan


def report_in_dock(plan: FloorPlan, series: str, **changes: Any) -> dict[str, Any]:
    """Return a stored state in the station, or at the origin of a site without one."""
    dock = next(
        (dock for dock in plan.plan.get("docks", ()) if dock["type"] == series),
        {"x": 0.0, "y": 0.0, "theta": 0.0},
    )
    pose = {"x": dock["x"], "y": dock["y"], "theta": dock["theta"]}
    return {
        "boot": "",
        "seq": 1,
        "docked": True,
        "chargerContact": True,
        "pose": pose,
        "battery": {"charge": 0.9},
    } | changes
