"""Whether a robot meets a study's start condition: docked in its station, localized, charged."""

from dataclasses import dataclass
from typing import Any, Literal

from experiments.definition.schema import Start
from robots.api.geometry import Pose2D, wrap_angle

Unmet = Literal["", "silent", "not_docked", "lost", "elsewhere", "charge"]


@dataclass(frozen=True, kw_only=True)
class RobotSnapshot:
    """`pose` is in the frame of the map, `charge` a share; both are None when unknown."""

    docked: bool = False
    pose: Pose2D | None = None
    charge: float | None = None

    def as_stored(self) -> dict[str, Any]:
        """Return it as `Drive.began_with` and `Drive.ended_with` store it."""
        x, y, theta = self.pose if self.pose is not None else (None, None, None)
        return {"docked": self.docked, "x": x, "y": y, "theta": theta, "charge": self.charge}


def snapshot(state: dict[str, Any]) -> RobotSnapshot:
    """Return the snapshot of a stored robots.api.messages.State."""
    pose, battery = state.get("pose") or {}, state.get("battery") or {}
    knows = "x" in pose and pose.get("localized", True)
    return RobotSnapshot(
        docked=bool(state.get("docked", False)),
        pose=Pose2D(pose["x"], pose["y"], pose["theta"]) if knows else None,
        charge=battery.get("charge"),
    )


def unmet(start: Start, robot: RobotSnapshot | None, dock: Pose2D) -> Unmet:
    """Return the first unmet requirement, "" for none. `robot` is None when it has not sent a state
    lately, `dock` the docked pose of the course's station.
    """
    if robot is None:
        return "silent"
    if start.docked:
        if not robot.docked:
            return "not_docked"
        if robot.pose is None:
            return "lost"
        turned = abs(wrap_angle(robot.pose.theta - dock.theta))
        if robot.pose.distance(dock) > start.distance or turned > start.heading:
            return "elsewhere"
    return "charge" if robot.charge is not None and robot.charge < start.charge else ""
