"""Simulated robots as processes of their own, and an agent that can be killed."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

from robots.simulator.render.frame_ring import _attach
from tests.support.agents.truth import Onlooker
from tests.support.paths import ROOT
from tests.support.patience import patient


def eventually(condition: Callable[[], bool], seconds: float = 10.0) -> bool:
    """Wait until something holds; tell whether it did in time."""
    deadline = time.monotonic() + patient(seconds)
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


class Simulator:
    """A running `python -m robots.simulator`."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "robots.simulator", *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(self.process.stderr.read())
        self.address = json.loads(line)["address"]
        self.port = int(self.address.rpartition(":")[2])
        self._onlookers: list[Onlooker] = []

    def onlooker(self) -> Onlooker:
        """Return an onlooker that is closed with the simulator."""
        self._onlookers.append(Onlooker(self.port))
        return self._onlookers[-1]

    def end(self) -> None:
        for each in self._onlookers:
            each.close()
        if self.process.poll() is None:
            self.process.terminate()
        self.process.wait(timeout=40)
        self.process.stdout.close()
        self.process.stderr.close()


@contextmanager
def simulator(*arguments: str) -> Iterator[Simulator]:
    robot = Simulator(*arguments)
    try:
        yield robot
    finally:
        robot.end()


@contextmanager
def driving_agent(
    address: str, *, linear: float = 0.5, media: bool = False
) -> Iterator[subprocess.Popen]:
    """Run an agent as its own process that drives ahead, perhaps watches; wait until it does."""
    command = [
        sys.executable,
        "-m",
        "tests.support.agents.driving_agent",
        address,
        str(linear),
        "media" if media else "drive",
    ]
    agent = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert agent.stdout.readline() == "driving\n"
        yield agent
    finally:
        if agent.poll() is None:
            agent.kill()
        agent.wait(timeout=40)
        agent.stdout.close()


def memory_exists(name: str) -> bool:
    try:
        memory: SharedMemory = _attach(name)
    except FileNotFoundError:
        return False
    memory.close()
    return True


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    try:
        return (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
            != "Z"
        )
    except FileNotFoundError:
        return False
