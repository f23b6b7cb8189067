"""Every adapter, with every part between agent and robot ended: how old a velocity moves the robot,
when it stops, and when it drives again.

The agent and its driver are a process in a network of its own, joined to the robot's architecture
by a cable. `pytest -m soak -s` prints the table. What stops a base whose agent is dead is its own
watchdog, half a second here: that of ROS's diff_drive_controller (`cmd_vel_timeout`), and for MOOS
what connect-a-robot.md asks for. OpenMORA's MQTTMosquitto (CMQTTMosquitto::Iterate) needs up to a
second, and stops at once when its broker reports the agent's death.
OpenMORA's own program of the Giraff has none (CRobotGiraffApp::Iterate repeats the last velocity):
the row without a watchdog moves until it is connected again.
"""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from tests.support.agents.orders import OLD, DatedOrders, caught_at_most_one
from tests.support.architectures.frozen import ROOT, freeze
from tests.support.architectures.moos_robot import MoosRig
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.architectures.rosbridge_robot import RosbridgeRig
from tests.support.programs.namespace import HERE, THERE, namespace

pytestmark = pytest.mark.soak
AWAY = 4.0  # s
STANDS_WITHIN = 0.65  # s
# OpenMORA's MQTT module looks for its time-out as late as a second after the last message
MODULE_STANDS_WITHIN = 1.15  # s
DRIVES_WITHIN = 20.0  # s
STARTED_LATE = 0.1  # s: an order was on its way, and the standstill is looked for now and then
# Shared memory would lead past the cable.
ROS_2 = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_STATIC_PEERS": f"{HERE};{THERE}",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
}
RIGS = {
    "moos": lambda _: MoosRig("giraff", listening=HERE),
    "moos, no watchdog": lambda _: MoosRig("giraff", listening=HERE),
    "openmora_mqtt": lambda directory: OpenMoraRig(directory, host=HERE),
    "ros1": lambda _: Ros1Rig("rhodon", host=HERE),
    "rosbridge": lambda _: RosbridgeRig("rhodon", 2, listening=HERE),
    "ros2": lambda _: Ros2Rig("giraff"),
}
ENDINGS = (
    "architecture killed",
    "architecture frozen",
    "architecture restarted",
    "cable pulled",
    "agent killed",
    "agent stopped",
)


@pytest.fixture(scope="module")
def network():
    with namespace() as made:
        yield made


class Agent:
    """The process; `start` may be called again."""

    def __init__(self, rca, network, directory):
        self.orders = DatedOrders()
        options = rca.options() | ({"ip": THERE} if rca.adapter_name == "ros1" else {})
        wish = {
            "adapter": rca.adapter_name,
            "profile": rca.profile,
            "options": options,
            "directory": str(directory),
            "began": self.orders.began,
        }
        self._command = [
            "ip",
            "netns",
            "exec",
            network.name,
            sys.executable,
            "-m",
            "tests.support.agents.driven_agent",
            json.dumps(wish),
        ]
        self.process = None

    def start(self):
        environment = os.environ | ROS_2
        self.process = subprocess.Popen(
            self._command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL
        )

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextlib.contextmanager
def driven(name, network, directory):
    rca = RIGS[name](directory)
    rca.world.watchdog = math.inf if "no watchdog" in name else 0.5
    with rca:
        rca.reset()
        agent = Agent(rca, network, directory)
        agent.start()
        try:
            yield rca, agent
        finally:
            agent.kill()


def wait(condition, seconds):
    """Return after how many seconds it was so, infinity when it was not."""
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > seconds:
            return math.inf
        time.sleep(0.005)
    return time.monotonic() - began


class Standstill:
    """Notes in a thread when the robot stands for the first time."""

    def __init__(self, world):
        self._world, self._over = world, threading.Event()
        self.began, self.at = time.monotonic(), math.inf
        threading.Thread(target=self._look, daemon=True).start()

    def _look(self):
        while not self._over.is_set() and self.at == math.inf:
            if self._world.sim.motion.linear == 0.0:
                self.at = time.monotonic()
            time.sleep(0.005)

    def after(self):
        """Return after how many seconds it stood, infinity when it drove on."""
        self._over.set()
        return self.at - self.began


def moving_orders(rca, agent, since):
    return [
        (at, agent.orders.age(at, linear, angular))
        for at, linear, angular in list(rca.world.commands)
        if at > since and (linear or angular)
    ]


def end(ending, rca, agent, network):
    """Do it; return how to undo it."""
    match ending:
        case "architecture killed":
            rca.kill()
            return rca.revive
        case "architecture restarted":
            rca.kill()
            rca.revive()
            return lambda: None
        case "architecture frozen":
            rca.freeze(on=True)
            return lambda: rca.freeze(on=False)
        case "cable pulled":
            network.pull()
            return network.plug
        case "agent killed":
            agent.kill()
            return agent.start
        case _:
            freeze(agent.process.pid, on=True)
            return lambda: freeze(agent.process.pid, on=False)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("name", RIGS)
def test_no_old_order_moves_the_robot_it_stands_and_drives_again(
    name, ending, network, tmp_path, monkeypatch
):
    for variable, value in ROS_2.items():
        monkeypatch.setenv(variable, value)
    with driven(name, network, tmp_path) as (rca, agent):
        commands = rca.world.commands
        assert wait(lambda: rca.world.sim.motion.linear > 0.1, 40.0) < math.inf, "it never drove"
        seen = len(commands)
        wait(lambda: len(commands) > seen, 1.0)
        standing = Standstill(rca.world)
        undo = end(ending, rca, agent, network)
        if "restarted" not in ending:
            time.sleep(AWAY)
        undone = time.monotonic()
        undo()
        again = wait(
            lambda: any(
                age is not None and age < OLD for _, age in moving_orders(rca, agent, undone + 0.1)
            ),
            DRIVES_WITHIN,
        )
        stood, old = (
            standing.after(),
            [
                at
                for at, age in moving_orders(rca, agent, standing.began)
                if age is not None and age > OLD
            ],
        )
        oldest = max(
            (age for _, age in moving_orders(rca, agent, standing.began) if age is not None),
            default=0.0,
        )
        stands = f"stands after {stood:5.2f} s" if stood < math.inf else "drives on           "
        sys.stdout.write(
            f"\n{name:18} {ending:23} old orders {len(old)}, oldest {oldest:5.2f} s   {stands}  "
            f" drives again {again:5.2f} s\n"
        )
        assert again < math.inf
        assert caught_at_most_one(old, commands)
        if "no watchdog" not in name and "restarted" not in ending:
            within = MODULE_STANDS_WITHIN if name == "openmora_mqtt" else STANDS_WITHIN
            assert stood <= within + STARTED_LATE
        if "no watchdog" in name and "agent killed" in ending:
            assert next(each for each in commands if each[0] > undone)[1:] == (
                0.0,
                0.0,
            ), "the first word was not zero"
    assert not rca.errors
