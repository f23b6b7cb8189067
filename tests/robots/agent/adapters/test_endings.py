"""Every adapter, with every end of what stands on its way: how old an order moves the robot, when it stands, when it drives again.

The agent and its driver are a process in a network of its own, joined to the robot's architecture by a cable. `pytest -m soak -s` prints the
table. What stops a base whose agent is dead is its own watchdog, half a second here: that of ROS's diff_drive_controller (`cmd_vel_timeout`),
that of OpenMORA's MQTTMosquitto (CMQTTMosquitto::Iterate), and for MOOS what connect-a-robot.md asks for. OpenMORA's own program of the
Giraff has none (CRobotGiraffApp::Iterate repeats the last velocity); the row without a watchdog is that one: it runs on for as long as
nobody can tell it anything, and stands as soon as somebody can.
"""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time

import pytest

from tests.support.frozen import ROOT, freeze
from tests.support.moos_robot import MoosRig
from tests.support.namespace import HERE, THERE, namespace
from tests.support.openmora_robot import OpenMoraRig
from tests.support.orders import OLD, DatedOrders
from tests.support.ros1_robot import Ros1Rig
from tests.support.ros2_robot import Ros2Rig
from tests.support.rosbridge_robot import RosbridgeRig

pytestmark = [pytest.mark.soak, pytest.mark.alone]
AWAY = 4.0  # s
STANDS_WITHIN = 0.65  # s
DRIVES_WITHIN = 20.0  # s
DDS = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="{here}" multicast="false"/></Interfaces></General>'
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="{there}"/></Peers></Discovery></Domain></CycloneDDS>'
)
RIGS = {
    "moos": lambda _: MoosRig("giraff", listening=HERE),
    "moos, no watchdog": lambda _: MoosRig("giraff", listening=HERE),
    "openmora_mqtt": lambda directory: OpenMoraRig(directory, host=HERE),
    "ros1": lambda _: Ros1Rig("rhodon", host=HERE),
    "rosbridge": lambda _: RosbridgeRig("rhodon", 2, listening=HERE),
    "ros2": lambda _: Ros2Rig("giraff"),
}
ENDINGS = ("architecture killed", "architecture frozen", "architecture restarted", "cable pulled", "agent killed", "agent stopped")


@pytest.fixture(scope="module")
def network():
    with namespace() as made:
        yield made


class Agent:
    """The process; `start` may be called again."""

    def __init__(self, rca, network, directory):
        self.orders = DatedOrders()
        options = rca.options() | ({"ip": THERE} if rca.adapter_name == "ros1" else {})
        wish = {"adapter": rca.adapter_name, "profile": rca.world.series, "options": options, "directory": str(directory), "began": self.orders.began}
        self._command = ["ip", "netns", "exec", network.name, sys.executable, "-m", "tests.support.driven_agent", json.dumps(wish)]
        self.process = None

    def start(self):
        environment = os.environ | {"CYCLONEDDS_URI": DDS.format(here=THERE, there=HERE)}
        self.process = subprocess.Popen(self._command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL)

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


def drives(rca, agent):
    return lambda: any(agent.orders.age(*each) is not None for each in rca.world.commands[-5:]) and rca.world.sim.motion.linear > 0.1


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
def test_no_old_order_moves_the_robot_it_stands_and_drives_again(name, ending, network, tmp_path, monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", DDS.format(here=HERE, there=THERE))
    with driven(name, network, tmp_path) as (rca, agent):
        assert wait(drives(rca, agent), 30.0) < math.inf, "it never drove"
        commands = rca.world.commands
        seen = len(commands)
        wait(lambda: len(commands) > seen, 1.0)
        ended, before = time.monotonic(), len(commands)
        undo = end(ending, rca, agent, network)
        stood = time.monotonic() - ended + wait(lambda: rca.world.sim.motion.linear == 0.0, AWAY if ending != "architecture restarted" else 2.0)
        time.sleep(max(0.0, ended + AWAY - time.monotonic()) if ending != "architecture restarted" else 0.0)
        undo()
        undone, after = time.monotonic(), len(commands)
        if stood == math.inf:
            stood = time.monotonic() - ended + wait(lambda: rca.world.sim.motion.linear == 0.0, 10.0)
        again = wait(drives(rca, agent), DRIVES_WITHIN)
        ages = [agent.orders.age(*each) for each in commands[before:] if each[1] or each[2]]
        oldest = max((age for age in ages if age is not None), default=0.0)
        print(f"\n{name:18} {ending:23} oldest order {oldest:5.2f} s   stands after {stood:5.2f} s   drives again {again:5.2f} s")
        first = next((each for each in commands[after:] if each[0] > undone), None)
        assert oldest <= OLD
        assert again < math.inf
        if "no watchdog" not in name:
            assert stood <= STANDS_WITHIN + 0.1
        elif ending != "agent stopped":
            assert first is not None
            assert first[1:] == (0.0, 0.0), "the first word was not zero"
    assert not rca.errors
