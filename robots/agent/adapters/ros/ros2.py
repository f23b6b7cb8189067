"""ROS 2, over a node of rclpy in a process of its own (ros2_node.py).

Needs rclpy: a sourced ROS 2 installation (Humble or later), or the extra `ros2`. Options: `python`
(the interpreter that has rclpy; default: the system's when ROS 2 is sourced, else the agent's),
`domain` (default: ROS_DOMAIN_ID), `on_robot`, and those of `base.RosOptions`. The environment
selects the middleware and how it finds the robot, as for every program of ROS 2.
"""

import contextlib
import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from robots.agent.adapters.common.robot_profile import load_profile, settings_of
from robots.agent.adapters.common.velocity_gate import GateParams
from robots.agent.adapters.ros.base import RosAdapter, RosOptions
from robots.agent.adapters.ros.bus import GOAL_ENDED
from robots.agent.adapters.ros.node_bus import NodeBus, outlives_agent
from robots.agent.robot_interface import AdapterError
from robots.api.reasons import ReasonCode

HIGHEST_DOMAIN = 232  # of which the UDP ports are below 65536 (DDSI-RTPS 2.3, 9.6.1.1)
CONFIRMED_WITHIN = 0.8  # s for the node's answer to a cancel, which comes 0.2 s after it at most
# A velocity that is due waits for the next odometry anyway: at 30 Hz, one per odometry.
GATE = GateParams(repeat=0.03, at_latest=0.012)
# Where Fast DDS 3 and 2 look for their profiles
PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
SET_UP_BY_USER = ("FASTDDS_BUILTIN_TRANSPORTS", *PROFILES)
PREFIX = b"telepres"  # the first bytes of the ids of our goals, as in ros2_node.py
NAVIGATE_TO_POSE = "nav2_msgs/NavigateToPose"


class Ros2Options(RosOptions, frozen=True, kw_only=True):
    """`python` has rclpy; the default `domain` is the environment's.

    `on_robot` states that this computer is the robot's: only there no cut link separates the guard
    from the navigation. Where ROS 2 is limited to this computer, that is the default.
    """

    python: str = ""
    on_robot: bool | None = None
    domain: Annotated[int, Meta(ge=0, le=HIGHEST_DOMAIN)] | None = None


def create(profile_name: str, options: Mapping[str, Any]) -> RosAdapter:
    """Return an adapter, nothing started; AdapterError for a wrong profile or option."""
    robot = load_profile(profile_name)
    settings = settings_of(Ros2Options, "ros2", robot, options)
    if settings.navigation == "move_base":
        raise AdapterError("with ROS 2, navigation must be nav2 or none")
    adapter = RosAdapter(robot, settings, Ros2Bus(settings.resolved()), "ROS 2")
    adapter.gate_params = GATE
    return adapter


def python_of(options: Ros2Options) -> str:
    """Return the interpreter that has rclpy: the system's where an installation is sourced."""
    if options.python:
        return options.python
    if sys.platform == "linux" and os.environ.get("AMENT_PREFIX_PATH"):
        return "/usr/bin/python3"
    return sys.executable


def is_limited_to_this_computer() -> bool:
    return (
        os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST"
        or os.environ.get("ROS_LOCALHOST_ONLY") == "1"
    )


def domain_of(options: Ros2Options) -> int:
    """Return the domain as ROS 2 reads it, decimal or 0x… (rcl/src/rcl/domain_id.c); raises
    AdapterError when ROS_DOMAIN_ID is malformed.
    """
    if options.domain is not None:
        return options.domain
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    try:
        domain = int(text, 0)
    except ValueError:
        domain = -1
    if not 0 <= domain <= HIGHEST_DOMAIN:
        raise AdapterError(
            f"ROS_DOMAIN_ID must be a whole number from 0 to {HIGHEST_DOMAIN}, not {text!r}"
        )
    return domain


def _over_udp(environment: dict[str, str]) -> dict[str, str]:
    """Return the environment in which Fast DDS uses UDP only. What a frozen base has not read waits
    in its socket, with a zero behind each velocity. In shared memory the zeros can be lost when
    their sender ends, and a process that was killed can leave a lock at which the next one hangs.

    Where discovery is limited to this computer, rmw_fastrtps adds shared memory (participant.cpp),
    so a profile limits it instead.
    """
    other = not environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps").startswith("rmw_fastrtps")
    if other or any(environment.get(name) for name in SET_UP_BY_USER):
        return environment
    is_local = is_limited_to_this_computer() and not environment.get("ROS_STATIC_PEERS")
    profile = str(Path(__file__).with_name(f"fastdds_{'loopback' if is_local else 'udp'}.xml"))
    environment |= dict.fromkeys(PROFILES, profile)
    if is_local:
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
        environment.pop("ROS_LOCALHOST_ONLY", None)
    return environment


class Ros2Bus(NodeBus):
    """See bus.ActionBus. The node cancels what an earlier one has left before it is ready."""

    version = 2
    answers = False  # an acknowledgement is of the velocity before
    advice = "run the agent on the robot's computer and set on_robot=true, or "
    script = Path(__file__).with_name("ros2_node.py")
    graph_source = "its node"

    def __init__(self, options: Ros2Options) -> None:
        domain = domain_of(options)
        environment = _over_udp(os.environ | {"ROS_DOMAIN_ID": str(domain)})
        is_local = is_limited_to_this_computer() if options.on_robot is None else options.on_robot
        place, guards = f"ROS 2 in domain {domain}", is_local and outlives_agent()
        super().__init__(place, python_of(options), environment, guards=guards)
        self.refusal_prefix = f"{place}: "
        navigates = "none" not in {options.navigation, options.localization}
        settings = {
            "driving": options.cmd_vel,
            "odom": options.odom,
            "action": options.navigate if navigates else "",
            "kind": NAVIGATE_TO_POSE,
        }
        self.arguments = (json.dumps(settings),)
        self._ids: dict[str, str] = {}  # of goals that have not ended, by our names

    def _take(self, message: dict[str, Any]) -> None:
        match message:
            case {"op": "accepted", "goal": goal} if self._goals is not None:
                self._goals.accepted(goal)
            case {"op": "ended", "goal": goal, "status": status, "reason": why} if (
                self._goals is not None
            ):
                end = GOAL_ENDED.get(status, "FAILED")
                self._ids.pop(goal, None)
                usual = "" if end == "FINISHED" else ReasonCode.NAVIGATION_FAILED
                self._goals.ended(goal, end, ReasonCode.RCA.of(why) if why else usual)
        super()._take(message)

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        del kind  # an argument of the node
        self._ids[name] = (PREFIX + time.time_ns().to_bytes(8, "big")).hex()
        self._say(op="goal", action=action, uuid=self._ids[name], goal=name, content=goal)

    async def cancel_goal(self, action: str, name: str) -> bool:
        """Cancel a goal, also of an earlier connection; return whether it has certainly ended."""
        if name not in self._ids:
            return True  # it was never sent
        with contextlib.suppress(TimeoutError):
            answer = await self._answer(
                CONFIRMED_WITHIN, op="cancel", action=action, uuid=self._ids[name]
            )
            return bool(answer["confirmed"])
        return False
