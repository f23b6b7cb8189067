"""What was in force in a drive, gathered from its stored record: to be compared with what was
assigned (experiments/definition/conditions.py).
"""

from dataclasses import fields
from typing import Any

import msgspec

from experiments.definition.conditions import Applied
from experiments.definition.start_condition import snapshot
from experiments.models import Drive
from experiments.participation.drive_status import series_of
from robots.api.messages import State
from sessions.models import SessionEvent

BY_ITSELF = frozenset({"goto", "docking"})
DONE = frozenset({"FINISHED", "CANCELLED"})


class Gathering:
    """Takes the states and the events of a drive, in any order of the two; `moved` tells whether
    the robot was moved for its visitor.
    """

    def __init__(self, drive: Drive) -> None:
        robot = drive.session.robot
        self.applied = Applied(
            robot=series_of(robot), site=robot.floor_plan.name if robot.floor_plan else ""
        )
        self.moved = drive.session.first_motion_at is not None
        # What the server has set counts until the robot says otherwise; of doors that somebody has
        # to close by hand, only what is said.
        self._doors = dict(drive.assigned.get("terms", {}).get("doors", {}))
        self._changes: list[tuple[float, str, str]] = []
        self._drives = False
        self._first: State | None = None
        self._last: State | None = None
        self._interfaces: set[str] = set()

    def see(self, state: State) -> None:
        """Take a state. What the robot was like before its visitor first drove it was not in force
        on anybody.
        """
        self._first = (
            state if self._first is None or state.stamp < self._first.stamp else self._first
        )
        self._last = state if self._last is None or state.stamp >= self._last.stamp else self._last
        self._drives = self._drives or bool(state.applied) or state.mode in BY_ITSELF
        if self._drives:
            self.applied.see(state)
        moved = any(command.linear or command.angular for command in state.applied)
        self.moved = self.moved or moved or state.mode in BY_ITSELF

    def hear(self, event: SessionEvent) -> None:
        data = event.data
        if event.source == SessionEvent.Source.PAGE:
            if event.type == "layout" and isinstance(data.get("interface"), str):
                self._interfaces.add(data["interface"])
        elif event.type == "action":
            if data.get("status") in DONE and not str(data.get("actionId", "")).startswith("home-"):
                self.applied.actions.add(str(data.get("type", "")))
        elif event.type == "door_changed":
            name, _, state = str(data.get("detail", "")).rpartition(" ")
            self._changes.append((event.stamp, name, state))

    def ends(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return how the robot stood in the first and in the last state by its clock; empty without
        any.
        """
        first, last = (
            snapshot(msgspec.to_builtins(state)).as_stored() if state is not None else {}
            for state in (self._first, self._last)
        )
        return first, last

    def done(self) -> Applied:
        doors = self._doors | {name: state for _, name, state in sorted(self._changes)}
        self.applied.doors_closed = {name for name, state in doors.items() if state == "closed"}
        # More than one is none that a condition could name.
        self.applied.interface = " ".join(sorted(self._interfaces))
        return self.applied


def as_stored(applied: Applied) -> dict[str, Any]:
    """Return what was in force as `Drive.applied` keeps it: sets as sorted lists, what robots
    report of networks as on the wire.
    """
    values = {
        field.name: getattr(applied, field.name)
        for field in fields(applied)
        if field.name != "impaired"
    }
    values = {
        name: sorted(value) if isinstance(value, set) else value for name, value in values.items()
    }
    told = {
        name: msgspec.to_builtins(values.pop(name)) for name in ("control_network", "video_network")
    }
    return values | {name: report for name, report in told.items() if report is not None}
