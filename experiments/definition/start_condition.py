"""Whether a robot is as a study wants it before a participant gets it: docked in the course's
station, sure of its place, charged.

Pure: what the study asks for and what the robot last said come in, one word comes out, or none when
the drive may begin.
"""

from dataclasses import dataclass
from typing import Any, Literal

from experiments.definition.schema import Start
from robots.api.geometry import Pose2D, wrap_angle

Unmet = Literal["", "silent", "not_docked", "lost", "elsewhere", "charge"]


@dataclass(frozen=True, kw_only=True)
class RobotSnapshot:
    """How a robot stands: `pose` in the frame of the map, None when it does not know; `charge` a
    share, None when it does not know.
    """

    docked: bool = False
    pose: Pose2D | None = None
    charge: float | None = None

    def as_stored(self) -> dict[str, Any]:
        """Return it as `Drive.began_with` and `Drive.ended_with` keep it."""
        x, y, theta = self.pose if self.pose is not None else (None, None, None)
        return {"docked": self.docked, "x": x, "y": y, "theta": theta, "charge": self.charge}


def snapshot(state: dict[str, Any]) -> RobotSnapshot:
    """Return how a robot stands by a state (robots.api.messages.State) as it is stored."""
    pose, battery = state.get("pose") or {}, state.get("battery") or {}
    knows = "x" in pose and pose.get("localized", True)
    return RobotSnapshot(
        docked=bool(state.get("docked", False)),
        pose=Pose2D(pose["x"], pose["y"], pose["theta"]) if knows else None,
        charge=battery.get("charge"),
    )


def unmet(start: Start, robot: RobotSnapshot | None, dock: Pose2D) -> Unmet:
    """Return what is not as it should be; the first thing alone, in the order in which somebody
    would mend it.

    Args:
        start: what the study asks for.
        robot: how the robot stands now; None when it has not said so lately.
        dock: the docked pose of the course's station.
    """
    if robot is None:
        return "silent"
    if start.docked and not robot.docked:
        return "not_docked"
    if start.docked and robot.pose is None:
        return "lost"
    if start.docked and robot.pose is not None and not _is_at(start, robot.pose, dock):
        return "elsewhere"
    return "charge" if robot.charge is not None and robot.charge < start.charge else ""


def _is_at(start: Start, pose: Pose2D, dock: Pose2D) -> bool:
    return (
        pose.distance(dock) <= start.distance
        and abs(wrap_angle(pose.theta - dock.theta)) <= start.heading
    )
