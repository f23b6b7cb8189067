"""The settings in force in a drive, from its stored record, to compare with those assigned
(experiments/definition/conditions.py).
"""

from dataclasses import replace
from typing import Any

import msgspec

from experiments.definition.conditions import Applied
from experiments.definition.start_condition import snapshot
from experiments.models import Drive
from experiments.participation.drive_status import kind_of
from robots.api.messages import State
from sessions.models import SessionEvent
from sessions.visitor_motion import BY_ITSELF, VisitorMotion

DONE = frozenset({"FINISHED", "CANCELLED"})


class ManipulationCheck:
    """Takes the states and events of a drive, in any order of the two; `moved` tells whether the
    robot was seen to move for its visitor.
    """

    def __init__(self, drive: Drive) -> None:
        robot, site = kind_of(drive.session.robot)
        self.applied = Applied(robot=robot, site=site)
        self.moved = drive.session.first_motion_at is not None
        self._motion = VisitorMotion()
        # Doors are as the server has set them until the robot reports otherwise; of doors that a
        # person closes, only reports count.
        self._doors = dict(drive.assigned.get("terms", {}).get("doors", {}))
        self._changes: list[tuple[float, str, str]] = []
        self._is_driven = False
        self._first: State | None = None
        self._last: State | None = None
        self._interfaces: set[str] = set()

    def take(self, row: State | SessionEvent) -> None:
        if isinstance(row, State):
            self._take_state(row)
        else:
            self._take_event(row)

    def _take_state(self, state: State) -> None:
        if self._first is None or state.stamp < self._first.stamp:
            self._first = state
        if self._last is None or state.stamp >= self._last.stamp:
            self._last = state
        # before the visitor first drove, the robot's settings applied to no participant
        self._is_driven = self._is_driven or bool(state.applied) or state.mode in BY_ITSELF
        if self._is_driven:
            self.applied.see(state)
        self.moved = self._motion.take(state) or self.moved

    def _take_event(self, event: SessionEvent) -> None:
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
        """Return snapshots of the first and last state by the robot's clock."""
        first, last = (
            snapshot(msgspec.to_builtins(state)).as_stored() if state is not None else {}
            for state in (self._first, self._last)
        )
        return first, last

    def result(self) -> Applied:
        doors = self._doors | {name: state for _, name, state in sorted(self._changes)}
        self.applied.doors_closed = {name for name, state in doors.items() if state == "closed"}
        # several interfaces give a text that no condition has
        self.applied.interface = " ".join(sorted(self._interfaces))
        return self.applied


def as_stored(applied: Applied) -> dict[str, Any]:
    """Return the form of `Drive.applied`: sets as sorted lists, networks as on the wire."""
    values = msgspec.to_builtins(replace(applied, impaired=set()), order="deterministic")
    return {name: v for name, v in values.items() if name != "impaired" and v is not None}
