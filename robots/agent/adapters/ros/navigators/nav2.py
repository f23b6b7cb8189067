"""Nav2, by its action NavigateToPose. The bus carries the action; it also cancels, when it is
opened, what an earlier run of the agent has left there.
"""

from typing import Any

from robots.agent.adapters.ros.bus import ActionBus, Subscription


class Nav2:
    """The bus reports the progress of goals."""

    kind = "nav2"
    publications: tuple[tuple[str, str], ...] = ()
    subscriptions: tuple[Subscription, ...] = ()

    def __init__(self, action: str, bus: ActionBus) -> None:
        self._action, self._bus = action, bus

    async def cancel_leftovers(self) -> None:
        """Do nothing: the bus has done it."""

    def send(self, target: dict[str, Any], goal: str) -> None:
        content = {"pose": target, "behavior_tree": ""}
        self._bus.send_goal(self._action, "nav2_msgs/NavigateToPose", content, goal)

    async def cancel(self, goal: str) -> bool:
        return await self._bus.cancel_goal(self._action, goal)

    def server_ended(self) -> None:
        """Do nothing: the bus reports the end of goals."""
