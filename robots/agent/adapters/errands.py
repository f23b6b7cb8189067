"""What was ordered of an RCA and has not ended: which errand, until when, and what becomes of it. Pure: `now` is given.

An errand that moves the base and one that moves the head may run at once; of each kind the newer replaces the older. Some RCAs say
when they are done, others only do it: arriving in the dock, leaving it, and the head's angle are seen in the readings. Docking has
ended when the robot is docked (robots/api/docked.py), undocking when its contacts are apart.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from robots.agent.adapters.contract import ActionProgress
from robots.api.docked import DockState
from robots.api.messages import ActionState

LONGEST_TILT = 15.0  # seconds
LONGEST_DOCKING = 300.0
TILT_REACHED = 0.02  # radians

Kind = Literal["goto", "dock", "undock", "tilt"]


@dataclass
class Errand:
    """`goal` is a point in map metres for goto, the angle twice for tilt; `began` and `deadline` are monotonic seconds."""

    action_id: str
    kind: Kind
    began: float
    goal: tuple[float, float] | None = None
    deadline: float = math.inf
    seen_running: bool = False


class Errands:
    """The errands of one robot; `tell` hears what becomes of them."""

    def __init__(self, tell: Callable[[ActionProgress], None]) -> None:
        self.drive: Errand | None = None
        self.head: Errand | None = None
        self._tell = tell

    def begin(self, errand: Errand) -> None:
        """Take an errand that the RCA has accepted."""
        if errand.kind == "tilt":
            self._end(self.head, "CANCELLED", "replaced")
            self.head = errand
        else:
            self._end(self.drive, "CANCELLED", "replaced")
            self.drive = errand
        self._tell(ActionProgress(errand.action_id, "RUNNING"))

    def of(self, action_id: str) -> Errand | None:
        """Return a running errand by its action."""
        return next((each for each in (self.drive, self.head) if each is not None and each.action_id == action_id), None)

    def end(self, action_id: str, status: ActionState, reason: str = "") -> None:
        """Say what became of an errand; nothing when it has ended before."""
        self._end(self.of(action_id), status, reason)

    def end_drive(self, status: ActionState, reason: str = "", *kinds: Kind) -> None:
        """Say what became of whatever moves the base, or only of errands of these kinds."""
        if self.drive is not None and (not kinds or self.drive.kind in kinds):
            self._end(self.drive, status, reason)

    def end_all(self, reason: str) -> None:
        """The RCA is gone, and what it was doing with it."""
        self._end(self.drive, "FAILED", reason)
        self._end(self.head, "FAILED", reason)

    def watch(self, now: float, *, dock: DockState, tilt: float | None) -> None:
        """Look whether something was reached, or takes too long."""
        drive, head = self.drive, self.head
        if drive is not None:
            if (drive.kind == "dock" and dock.docked) or (drive.kind == "undock" and not dock.touching):
                self._end(drive, "FINISHED", "")
            elif now > drive.deadline:
                self._end(drive, "FAILED", "it takes too long")
        if head is not None and head.goal is not None:
            if tilt is not None and abs(tilt - head.goal[0]) < TILT_REACHED:
                self._end(head, "FINISHED", "")
            elif now > head.deadline:
                self._end(head, "FAILED", "the head does not get there")

    def _end(self, errand: Errand | None, status: ActionState, reason: str) -> None:
        if errand is None:
            return
        if errand is self.head:
            self.head = None
        elif errand is self.drive:
            self.drive = None
        else:
            return
        self._tell(ActionProgress(errand.action_id, status, reason))
