"""A robot of a running site behind each kind of robot control architecture, which the test can kill
and bring back. Only the adapter differs.
"""

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path

from tests.support.agents.truth import Onlooker
from tests.support.architectures.moos_robot import MoosRig
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.architectures.rca_world import RcaRig
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.architectures.rosbridge_robot import RosbridgeRig
from tests.support.sessions.site import LOOPBACK, Site, free_port, wait_for

START = "lab-before-door"  # with much around it, by which it finds its place at once
CAMERA = "lavfi:testsrc=size=320x240:rate=10"


class Outside:
    """An architecture in the test's own process, with its real protocol between it and the agent.
    It has no camera.
    """

    camera = ("--camera", CAMERA)

    def __init__(self, rig: RcaRig) -> None:
        self.rig, self.series, self.adapter_name = rig, rig.world.series, rig.adapter_name
        self.profile = rig.profile
        self.start, self.kill, self.revive = rig.__enter__, rig.kill, rig.revive
        self.options = rig.options

    def place(self) -> tuple[float, float]:
        truth = self.rig.world.truth
        return truth.x, truth.y

    def speed(self) -> float:
        return float(self.rig.world.sim.motion.linear)

    def end(self) -> None:
        self.rig.__exit__(None, None, None)
        assert not self.rig.errors


class Simulator:
    """The simulator as a process of its own; killed, the robot and its world are gone with it."""

    series, profile, adapter_name, camera = "giraff", "giraff", "simulator", ()

    def __init__(self, site: Site) -> None:
        self.site, self.port = site, free_port()
        self._onlooker: Onlooker | None = None

    def options(self) -> dict[str, str]:
        return {"address": f"{LOOPBACK}:{self.port}"}

    def start(self) -> None:
        where = f"--profile {self.series} --listen {LOOPBACK}:{self.port} --start {START}"
        words = f"-m robots.simulator {where} --seed 3 --fps 6".split()
        self.site.start("rca", words)
        wait_for(lambda: self.site.listening(self.port), 30, "the simulator")
        self._onlooker = Onlooker(self.port)

    revive = start

    def place(self) -> tuple[float, float]:
        assert self._onlooker, "it runs"
        truth = self._onlooker.truth()
        return truth.x, truth.y

    def speed(self) -> float:
        return self._onlooker.truth().linear if self._onlooker else 0.0

    def kill(self) -> None:
        self.end(signal.SIGKILL)

    def end(self, number: int = signal.SIGTERM) -> None:
        if self._onlooker is not None:
            self._onlooker.close()
            self._onlooker = None
            self.site.stop("rca", number)


Architecture = Outside | Simulator
ARCHITECTURES = {
    "simulator": lambda site, _: Simulator(site),
    "moos": lambda *_: Outside(MoosRig("giraff")),
    "openmora_mqtt": lambda _, directory: Outside(OpenMoraRig(directory)),
    "ros1": lambda *_: Outside(Ros1Rig("rhodon")),
    "ros2": lambda *_: Outside(Ros2Rig("giraff")),
    "rosbridge": lambda *_: Outside(RosbridgeRig("rhodon", 2)),
}


@contextlib.contextmanager
def robot_behind(adapter: str, site: Site, directory: Path) -> Iterator[Architecture]:
    """The architecture that `adapter` speaks with, and its robot's agent, reached and on line."""
    architecture = ARCHITECTURES[adapter](site, directory)
    try:
        architecture.start()
        options = [f"--option={name}={value}" for name, value in architecture.options().items()]
        kind = ["--adapter", architecture.adapter_name, "--profile", architecture.profile]
        words = [architecture.series, "--var", str(site.var), *kind, *options]
        site.start("agent", ["-m", "robots.agent", *words, *architecture.camera])
        is_online = lambda: site.robot_is_online(architecture.series)
        wait_for(is_online, 30, f"a robot of {adapter}", lambda: site.log("agent"))
        yield architecture
    finally:
        if "agent" in site.processes:
            site.stop("agent")
        architecture.end()
