"""The robot's own navigation: one file for each action server that goals can be sent to."""

from typing import Any, Protocol

from robots.agent.adapters.ros.bus import Bus, Goals, Subscription
from robots.agent.adapters.ros.navigators.move_base import MoveBase
from robots.agent.adapters.ros.navigators.nav2 import Nav2


class ActionServer(Protocol):
    """One action server."""

    kind: str  # as the guard knows it
    publications: tuple[tuple[str, str], ...]  # topics and types
    subscriptions: tuple[Subscription, ...]

    async def cancel_leftovers(self) -> None:
        """Cancel what an earlier run of the agent has left there."""

    def send(self, target: dict[str, Any], goal: str) -> None:
        """Send a goal, a geometry_msgs/PoseStamped, under an id of ours.

        Raises:
            ActionRefusedError: the server certainly has not taken it.
            AdapterError: it may have.
        """

    async def cancel(self, goal: str) -> bool:
        """Cancel a goal; return True when it certainly does not run and never will."""

    def server_gone(self) -> None:
        """The server has ended."""


def navigator_of(name: str, action: str, bus: Bus, goals: Goals) -> ActionServer | None:
    """Return the navigator that an option names, None for "none"."""
    makers = {"move_base": MoveBase, "nav2": Nav2}
    return makers[name](action, bus, goals) if name in makers else None
