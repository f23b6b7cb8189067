"""A robot of ROS 1 whose base and planner are real nodes in processes of their own, and an agent
that sends it to a goal: each can be frozen and killed.
"""

import contextlib
import math
import tempfile
import time
from pathlib import Path

from tests.support.agents.agent_process import AgentProcess, JsonProcess
from tests.support.architectures.ros1_robot import PYTHON, RosMaster

SCRIPT = Path(__file__).with_name("ros1_navigation.py")
MOVES = 0.03  # m/s


class Ros1Processes:
    """Use as a context manager, as `planner` and `agent`, which may be started again."""

    def __init__(self, directory, host="127.0.0.1"):
        self.directory = directory
        self.master = RosMaster(host)

    def __enter__(self):
        self.master.start()
        self.base = self._node("base")
        return self

    def __exit__(self, *_):
        self.base.kill()
        self.master.kill()

    @property
    def options(self):
        return {"master": self.master.uri, "ip": self.master.host}

    def _node(self, *words):
        environment = self.master.environment | {
            "ROS_MASTER_URI": self.master.uri,
            "ROS_LOG_DIR": str(self.directory),
        }
        return JsonProcess([PYTHON, str(SCRIPT), *words], environment)

    @contextlib.contextmanager
    def planner(self, habit, topic="/cmd_vel"):
        """Yield a planner that takes goals."""
        planner = self._node("planner", habit, topic)
        try:
            planner.wait_for(lambda event: "ready" in event, within=60.0)
            yield planner
        finally:
            planner.kill()

    @contextlib.contextmanager
    def agent(self, options, prefix=()):
        """Yield a connected agent."""
        agent = AgentProcess(
            "ordered_agent",
            prefix=prefix,
            adapter="ros1",
            profile="rhodon",
            directory=tempfile.mkdtemp(dir=self.directory),
            options=self.options | options,
        )
        try:
            yield agent
        finally:
            agent.kill()

    def drives(self, speed):
        """Wait until the base drives nearly at a speed in m/s."""
        is_fast = lambda event: event.get("v", 0.0) > speed - 0.02
        self.base.wait_for(is_fast, time.monotonic(), 30.0)

    def after(self, event, until):
        """Return the metres driven from `event` to `until`, the seconds after `event` when the base
        moved last, and the metres driven after its first standstill.
        """
        rows = [row for row in self.base.events(event) if "v" in row and row["at"] < until]
        moving = [row["at"] for row in rows if row["v"] > MOVES]
        stood = next((row["at"] for row in rows if row["v"] <= MOVES), math.inf)
        later = [row["x"] for row in rows if row["at"] >= stood]
        return (
            rows[-1]["x"] - rows[0]["x"],
            (max(moving) if moving else event) - event,
            later[-1] - later[0] if later else math.inf,
        )
