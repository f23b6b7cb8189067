"""Actions that were sent to an RCA and have not ended: which, until when, and with which result.
Pure: `now` is given.

An action that moves the base, one that moves the head and one that relocalizes the robot may run at
once. Some RCAs report the end of an action, others only reach it: the dock, the head's angle and
the pose are seen in the readings. Docking has ended when the robot is docked
(robots/api/docked.py), undocking when its contacts are apart.

An action that moves the base is ours from before it is sent until the RCA confirms its end, also
when the connection is lost in between: it is then cancelled over the next one.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from robots.agent.robot_interface import NOWHERE, ActionProgress, ActionRefusedError
from robots.api.docked import DockState
from robots.api.geometry import wrap_angle
from robots.api.messages import ActionState, Pose
from robots.api.reasons import ReasonCode

LONGEST_TILT = 15.0  # seconds
LONGEST_DOCKING = 300.0
LONGEST_RELOCALIZATION = 10.0
TILT_REACHED = 0.02  # radians

Kind = Literal["goto", "dock", "undock", "tilt", "relocalize"]


@dataclass(frozen=True)
class ExpectedArea:
    """Where a relocalized robot must be: a square in map metres, perhaps with a heading in radians.

    A pose counts `settles` seconds after the action began: an RCA first repeats the old pose.
    """

    x: float
    y: float
    half_width: float
    theta: float | None = None
    half_turn: float = math.pi
    settles: float = 0.0

    def holds(self, pose: Pose) -> bool:
        near = max(abs(pose.x - self.x), abs(pose.y - self.y)) <= self.half_width
        return near and (
            self.theta is None or abs(wrap_angle(pose.theta - self.theta)) <= self.half_turn
        )


@dataclass
class PendingAction:
    """`goal` is a point in map metres for goto, the angle twice for tilt; times are monotonic s.

    `place` is the goal by name, `over_at` when the RCA reported the end. `failure` is the reason
    why the adapter itself cancels it; it ends as FAILED for that reason. `first_cancelled_at` and
    `cancelled_at` are when the first and the newest cancel were sent, `goal_id` the RCA's name.
    """

    action_id: str
    kind: Kind
    began: float
    goal: tuple[float, float] | None = None
    deadline: float = math.inf
    seen_running: bool = False
    place: str = ""
    area: ExpectedArea | None = None
    over_at: float = math.inf
    accepted: bool = False
    failure: str = ""
    first_cancelled_at: float | None = None
    cancelled_at: float = -math.inf
    goal_id: str = ""

    @property
    def drives(self) -> bool:
        return self.kind in {"goto", "dock", "undock"}


class PendingActions:
    """The actions of one robot; `drive` may move the base. `tell` receives their progress."""

    def __init__(self, tell: Callable[[ActionProgress], None]) -> None:
        self.drive: PendingAction | None = None
        self.head: PendingAction | None = None
        self.localization: PendingAction | None = None
        self._tell = tell

    def own(self, pending: PendingAction) -> None:
        """Take an action to be sent; raises ActionRefusedError while another may move the base."""
        if self.drive is not None:
            raise ActionRefusedError(ReasonCode.NAVIGATION_DOES_NOT_END)
        self.drive = pending

    def disown(self, action_id: str) -> None:
        """Forget an action that the RCA has certainly not taken."""
        if self.drive is not None and self.drive.action_id == action_id:
            self.drive = None

    def begin(self, pending: PendingAction) -> None:
        """Take an accepted action, which replaces one of the head or of the localization."""
        if pending.kind == "tilt":
            self._end(self.head, "CANCELLED", ReasonCode.REPLACED)
            self.head = pending
        elif pending.kind == "relocalize":
            self._end(self.localization, "CANCELLED", ReasonCode.REPLACED)
            self.localization = pending
        else:
            pending.accepted = True
            self.drive = pending
        self._tell(ActionProgress(pending.action_id, "RUNNING"))

    def of(self, action_id: str) -> PendingAction | None:
        """Return an action that has not ended, or that may still move the base."""
        known = (self.drive, self.head, self.localization)
        return next((each for each in known if each and each.action_id == action_id), None)

    def end(self, action_id: str, status: ActionState, reason: str = "") -> None:
        """Report the end of an action; nothing when it has ended before."""
        self._end(self.of(action_id), status, reason)

    def end_drive(self, status: ActionState, reason: str = "", *kinds: Kind) -> None:
        """Report the end of the action that moves the base, if it is of one of `kinds`."""
        if self.drive is not None and (not kinds or self.drive.kind in kinds):
            self._end(self.drive, status, reason)

    def end_all(self, reason: str) -> None:
        """Report all as failed with the connection, but for what may still move the base."""
        self._end(self.head, "FAILED", reason)
        self._end(self.localization, "FAILED", reason)
        if self.drive is not None:
            self.drive.failure = self.drive.failure or reason

    def watch(
        self,
        now: float,
        *,
        dock: DockState,
        tilt: float | None,
        pose: Pose = NOWHERE,
        fixed_at: float = -math.inf,
    ) -> None:
        """End what has succeeded or is late; what moves the base gets a `failure`, to cancel it.

        `fixed_at` is when the localization reported last, in monotonic seconds; `tilt` is in
        radians, None when unknown.
        """
        self._watch_localization(now, pose, fixed_at)
        if (head := self.head) is not None and head.goal is not None:
            if tilt is not None and abs(tilt - head.goal[0]) < TILT_REACHED:
                self._end(head, "FINISHED", "")
            elif now > head.deadline:
                self._end(head, "FAILED", ReasonCode.NOT_IN_TIME)
        drive = self.drive
        if drive is None or not drive.accepted:
            return
        if (drive.kind == "dock" and dock.docked) or (drive.kind == "undock" and not dock.touching):
            self._end(drive, "FINISHED", "")
        elif now > drive.deadline:
            drive.failure = drive.failure or ReasonCode.NOT_IN_TIME

    def _watch_localization(self, now: float, pose: Pose, fixed_at: float) -> None:
        pending = self.localization
        if pending is None or pending.area is None:
            return
        is_news = fixed_at > pending.began + pending.area.settles
        if is_news and pose.localized and pending.area.holds(pose):
            self._end(pending, "FINISHED", "")
        elif now > pending.deadline:
            why: str = ReasonCode.NO_ANSWER
            if is_news and pose.localized:
                why = ReasonCode.POSE_DISAGREES.of(f"({pose.x:.1f}, {pose.y:.1f})")
            elif is_news:
                why = ReasonCode.NOT_FOUND
            self._end(pending, "FAILED", why)

    def _end(self, pending: PendingAction | None, status: ActionState, reason: str) -> None:
        for name in ("head", "localization", "drive"):
            if pending is not None and getattr(self, name) is pending:
                setattr(self, name, None)
                if pending.failure and status != "FINISHED":
                    status, reason = "FAILED", pending.failure
                self._tell(ActionProgress(pending.action_id, status, reason))
