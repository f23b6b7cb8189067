"""move_base, by the topics of its action (actionlib).

The server publishes the status of every goal that has not ended, and for 5 s of those that have
(actionlib/action_server.py, publish_status). It remembers the cancel of a goal that it has not
received yet for as long (internal_cancel_callback): that goal is listed as RECALLING, and never
runs when it arrives.
"""

import asyncio
import contextlib
import math
import time
from dataclasses import dataclass
from typing import Any

from robots.agent.adapters.ros import messages
from robots.agent.adapters.ros.bus import OURS, Bus, Goals, Subscription
from robots.agent.robot_interface import ActionRefusedError
from robots.api.messages import ActionState
from robots.api.reasons import ReasonCode

ENDED: dict[int, ActionState] = {  # actionlib_msgs/GoalStatus
    2: "CANCELLED",
    3: "FINISHED",
    4: "FAILED",
    5: "FAILED",
    8: "CANCELLED",
}
RECALLING = 7


@dataclass(frozen=True)
class MoveBaseParams:
    """All in seconds; the server publishes its status five times a second."""

    status_age: float = 2.0  # after which the server is taken to be hung
    first_status: float = 0.5  # that a new connection waits for
    unlisted: float = 6.0  # of status without a goal, after which the goal never arrives
    cancel_again: float = 0.5


@dataclass
class _Sent:
    listed: bool = False
    cancelled: bool = False
    unlisted_since: float = math.inf


class MoveBase:
    """One action server. `kind` is the guard's name of it."""

    kind = "move_base"

    def __init__(
        self, action: str, bus: Bus, goals: Goals, params: MoveBaseParams | None = None
    ) -> None:
        self._action, self._bus, self._goals = action, bus, goals
        self._params = params or MoveBaseParams()
        self._sent: dict[str, _Sent] = {}  # our goals that have not ended
        self._strangers: dict[str, float] = {}  # goals of earlier runs: when cancelled last
        self._status_at = -math.inf
        self._came = asyncio.Event()
        self.publications: tuple[tuple[str, str], ...] = (
            (f"{action}/goal", "move_base_msgs/MoveBaseActionGoal"),
            (f"{action}/cancel", "actionlib_msgs/GoalID"),
        )
        self.subscriptions: tuple[Subscription, ...] = (
            Subscription(
                f"{action}/status", "actionlib_msgs/GoalStatusArray", self._status, essential=True
            ),
            Subscription(
                f"{action}/result",
                "move_base_msgs/MoveBaseActionResult",
                self._result,
                essential=True,
            ),
        )

    async def cancel_leftovers(self) -> None:
        """Wait a moment for the server's status, which names them; `_status` cancels them."""
        self._came.clear()
        self._strangers.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._params.first_status):
                await self._came.wait()

    def send(self, target: dict[str, Any], goal: str) -> None:
        """Send a goal; raises ActionRefusedError when the server has not published its status
        lately.
        """
        if time.monotonic() - self._status_at > self._params.status_age:
            missing = f"{self._action}/status is not published"
            raise ActionRefusedError(ReasonCode.NAVIGATION_LOST.of(missing))
        content = {
            "header": target["header"],
            "goal_id": {"stamp": messages.time_of(time.time(), 1), "id": goal},
            "goal": {"target_pose": target},
        }
        self._bus.publish(f"{self._action}/goal", content)
        self._sent[goal] = _Sent()

    async def cancel(self, goal: str) -> bool:
        """Cancel a goal by its id; True once the server has listed its end."""
        if goal not in self._sent:
            return True
        self._sent[goal].cancelled = True
        self._publish_cancel(goal)
        return False

    def server_ended(self) -> None:
        for goal in list(self._sent):
            self._end(goal, "FAILED", ReasonCode.NAVIGATION_LOST.of("ended"))

    def _publish_cancel(self, goal: str) -> None:
        # stamp 0: this goal alone (internal_cancel_callback)
        content = {"stamp": messages.time_of(0.0, 1), "id": goal}
        self._bus.publish(f"{self._action}/cancel", content)

    def _status(self, message: dict[str, Any]) -> None:
        now = time.monotonic()
        is_steady = now - self._status_at < self._params.status_age
        self._status_at = now
        listed = {}
        for entry in message.get("status_list", ()):
            goal, status = str(entry.get("goal_id", {}).get("id", "")), entry.get("status")
            listed[goal] = status
            if status in ENDED:
                self._result({"status": entry})
            elif goal in self._sent:
                self._sent[goal].listed |= status != RECALLING
                self._goals.accepted(goal)
            elif goal.startswith(OURS) and (
                now - self._strangers.get(goal, -math.inf) > self._params.cancel_again
            ):
                self._strangers[goal] = now
                self._publish_cancel(goal)
        self._look_for_unlisted(listed, now, is_steady=is_steady)
        self._came.set()

    def _result(self, message: dict[str, Any]) -> None:
        entry = message.get("status", {})
        status = entry.get("status")
        if status in ENDED:
            goal = str(entry.get("goal_id", {}).get("id", ""))
            text = str(entry.get("text", ""))
            self._end(goal, ENDED[status], ReasonCode.RCA.of(text) if text else "")

    def _look_for_unlisted(self, listed: dict[str, Any], now: float, *, is_steady: bool) -> None:
        """End a goal that the server had listed and no longer lists (it was restarted), and a
        cancelled one that it has not received within `unlisted` seconds.
        """
        for goal, sent in list(self._sent.items()):
            if goal in listed and listed[goal] != RECALLING:
                sent.unlisted_since = math.inf
            elif sent.listed and goal not in listed:
                self._end(goal, "FAILED", ReasonCode.NAVIGATION_LOST.of("restarted"))
            elif sent.unlisted_since == math.inf or not is_steady:
                sent.unlisted_since = now
            elif sent.cancelled and now - sent.unlisted_since > self._params.unlisted:
                self._end(goal, "FAILED", ReasonCode.NAVIGATION_LOST.of("goal not received"))

    def _end(self, goal: str, status: ActionState, reason: str) -> None:
        usual = {"FAILED": ReasonCode.NAVIGATION_FAILED, "CANCELLED": ReasonCode.CANCELLED}
        if self._sent.pop(goal, None) is not None:
            is_done = status == "FINISHED"
            self._goals.ended(goal, status, "" if is_done else reason or usual[status])
