"""A robot of ROS 1 whose base and planner are real nodes in processes of their own, and an agent
that sends it to a goal: each can be frozen and killed.
"""

import itertools
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.support.architectures.ros1_robot import PYTHON, RosMaster
from tests.support.paths import ROOT
from tests.support.patience import patient

SCRIPT = Path(__file__).with_name("ros1_navigation.py")
MOVES = 0.03  # m/s


class Process:
    """One process; `events` are the JSON lines that it has written."""

    def __init__(self, command, log, environment=None, **more):
        self._log = log
        self.process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL, **more
        )

    def events(self, since=0.0):
        text = self._log.read_text() if self._log.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        return [each for each in map(json.loads, whole.splitlines()) if each["at"] >= since]

    def wait_for(self, found, since=0.0, within=20.0):
        """Return the first event that is `found`."""
        deadline = time.monotonic() + patient(within)
        while time.monotonic() < deadline:
            for event in self.events(since):
                if found(event):
                    return event
            assert self.process.poll() is None, self.events()[-5:]
            time.sleep(0.02)
        raise AssertionError(self.events()[-5:])

    def freeze(self, *, on):
        self.process.send_signal(signal.SIGSTOP if on else signal.SIGCONT)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def request(self, word):
        self.process.stdin.write(f"{word}\n".encode())
        self.process.stdin.flush()


class Ros1Processes:
    """Use as a context manager; `agent()` may be started again."""

    def __init__(self, directory, host="127.0.0.1"):
        self.directory = directory
        self.master = RosMaster(host)
        self._running = []
        self._numbers = itertools.count()

    def __enter__(self):
        self.master.start()
        self.base = self._node("base", ["base"])
        return self

    def __exit__(self, *_):
        for each in reversed(self._running):
            each.kill()
        self.master.kill()

    def _node(self, name, words):
        log = self.directory / f"{name}.log"
        environment = {
            "ROS_MASTER_URI": self.master.uri,
            "ROS_IP": self.master.host,
            "ROS_LOG_DIR": str(self.directory),
            "PATH": "/usr/bin:/bin",
        }
        command = [PYTHON, str(SCRIPT), *words, str(log)]
        return self._keep(Process(command, log, environment, stdout=subprocess.DEVNULL))

    def stop(self, process):
        self._running.remove(process)
        process.kill()

    def _keep(self, process):
        self._running.append(process)
        return process

    def plan(self, habit, topic="/cmd_vel"):
        """Start a planner and wait until it takes goals."""
        planner = self._node(f"planner{next(self._numbers)}", ["planner", habit, topic])
        planner.wait_for(lambda event: "ready" in event, within=60.0)
        return planner

    def agent(self, options, prefix=(), module="navigating_agent"):
        """Start an agent and wait until it is connected."""
        log = self.directory / f"agent{next(self._numbers)}.log"
        wish = {
            "adapter": "ros1",
            "profile": "rhodon",
            "directory": str(self.directory / log.stem),
            "options": {"master": self.master.uri, "ip": self.master.host, **options},
        }
        command = [
            *prefix,
            sys.executable,
            "-m",
            f"tests.support.agents.{module}",
            json.dumps(wish),
        ]
        (self.directory / log.stem).mkdir()
        with log.open("w") as out:
            agent = self._keep(Process(command, log, stdin=subprocess.PIPE, stdout=out))
        agent.wait_for(lambda event: "connected" in event, within=60.0)
        return agent

    def drives(self):
        """Wait until the base drives as fast as the planner wants."""
        self.base.wait_for(lambda event: event.get("v", 0.0) > 0.28, time.monotonic(), 30.0)

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
