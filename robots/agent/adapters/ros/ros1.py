"""ROS 1, over a node of rospy in a process of its own (ros1_node.py).

Needs rospy: Debian and Ubuntu have it as `python3-rospy`, ROS itself brings it. Options: `master`
(default: ROS_MASTER_URI), `ip` (how others reach this computer: ROS_IP), `python` (the interpreter
that has rospy), and those of `base.RosOptions`.
"""

import os
import socket
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from robots.agent.adapters.common.robot_profile import load_profile, settings_of
from robots.agent.adapters.ros.base import RosAdapter, RosOptions
from robots.agent.adapters.ros.bus import Goals
from robots.agent.adapters.ros.graph import master_restarted
from robots.agent.adapters.ros.node_bus import NodeBus, outlives_agent
from robots.agent.robot_interface import AdapterError


class Ros1Options(RosOptions, frozen=True, kw_only=True):
    """Where the master is, and which Python has rospy."""

    master: str = ""
    ip: str = ""
    python: str = "python" if sys.platform == "win32" else "/usr/bin/python3"


def create(profile_name: str, options: Mapping[str, Any]) -> RosAdapter:
    """Return an adapter, nothing started; AdapterError for a wrong profile or option."""
    robot = load_profile(profile_name)
    settings = settings_of(Ros1Options, "ros1", robot, options)
    if settings.navigation == "nav2":
        raise AdapterError("with ROS 1, navigation must be move_base or none")
    return RosAdapter(robot, settings, Ros1Bus(settings), "ROS 1")


class Ros1Bus(NodeBus):
    """See bus.Bus. The child counts as a guard only on the computer of the ROS master, where no cut
    link separates it from the robot, and not in a container that ends with the agent.
    """

    version = 1
    answers = True
    advice = "run the agent on the computer of the ROS master, or "
    script = Path(__file__).with_name("ros1_node.py")
    graph_source = "the ROS master"

    def __init__(self, options: Ros1Options) -> None:
        uri = _master_of(options)
        environment = {**os.environ, "ROS_MASTER_URI": uri, "ROS_PYTHON_LOG_CONFIG_FILE": ""}
        if options.ip:
            environment["ROS_IP"] = options.ip
        guards = outlives_agent() and _is_here(urlsplit(uri).hostname or "")
        super().__init__(f"ROS 1 at {uri}", options.python, environment, guards=guards)
        # slave APIs by name, of nodes that the master knows, and of running nodes that it knew only
        # on an earlier connection
        self.known: dict[str, str] = {}
        self._old: dict[str, str] = {}

    @property
    def problems(self) -> tuple[str, ...]:
        return (*((master_restarted(self._old),) if self._old else ()), *super().problems)

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        self._old |= self.known
        self.known = {}
        await super().open(lost, goals)

    def _take(self, message: dict[str, Any]) -> None:
        if message["op"] == "gone" and self._goals is not None:
            self._goals.server_ended()
        super()._take(message)

    def _before(self) -> dict[str, Any]:
        return {"old": self._old}

    def _described(self, answer: dict[str, Any]) -> None:
        if "nodes" in answer:
            self.known = answer["nodes"]
            self._old = {name: self._old[name] for name in answer["forgotten"]}


def _master_of(options: Ros1Options) -> str:
    """Return the master's address, set by option or environment; AdapterError if malformed."""
    uri = options.master or os.environ.get("ROS_MASTER_URI") or "http://localhost:11311"
    try:
        parts = urlsplit(uri)
        is_address = parts.scheme == "http" and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_address = False
    if not is_address:
        raise AdapterError(
            f"{'master' if options.master else 'ROS_MASTER_URI'} must be the address of the ROS"
            f" master, such as http://192.168.1.30:11311, not {uri!r}"
        )
    return uri


def _is_here(host: str) -> bool:
    """Return whether an address is one of this computer's."""
    if host == "localhost" or host.startswith("127."):
        return True
    try:
        address = socket.getaddrinfo(host, 0, type=socket.SOCK_DGRAM)[0]
        with socket.socket(address[0], socket.SOCK_DGRAM) as probe:
            probe.bind(address[4])
    except OSError:
        return False
    return True
