"""The robot's own navigation: one file for each action server that goals can be sent to."""

from typing import cast

from robots.agent.adapters.ros.bus import ActionBus, Bus, Goals
from robots.agent.adapters.ros.navigators.move_base import MoveBase
from robots.agent.adapters.ros.navigators.nav2 import Nav2


def navigator_of(name: str, action: str, bus: Bus, goals: Goals) -> MoveBase | Nav2 | None:
    """Return the navigator that an option names, None for "none"; ROS 2 carries actions."""
    if name == "nav2":
        return Nav2(action, cast("ActionBus", bus))
    return MoveBase(action, bus, goals) if name == "move_base" else None
