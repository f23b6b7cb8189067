"""Every adapter, with each part between agent and robot ended: how old a velocity moves the robot,
when it stops, and when it drives again.

The agent and its driver are a process in a network of its own, joined to the robot's architecture
by a cable. `pytest -m soak -s` prints the table. A base whose agent is dead is stopped by its own
watchdog, 0.5 s here: that of ROS's diff_drive_controller (`cmd_vel_timeout`), and for MOOS the one
that connect-a-robot.md requires. OpenMORA's MQTTMosquitto (CMQTTMosquitto::Iterate) needs up to a
second, and stops at once when its broker reports the agent's death. OpenMORA's program of the
Giraff has none (CRobotGiraffApp::Iterate repeats the last velocity): the row without a watchdog
moves until it is connected again.
"""

import contextlib
import math
import os
import time

import pytest

from tests.support.agents.agent_process import AgentProcess, wait
from tests.support.agents.orders import OLD, DatedOrders, caught_at_most_one
from tests.support.architectures.moos_robot import MoosRig
from tests.support.architectures.motion import Motion
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.architectures.rosbridge_robot import RosbridgeRig
from tests.support.programs.namespace import HERE, THERE, namespace

pytestmark = pytest.mark.soak
AWAY = 4.0  # s
STANDS_WITHIN = 0.65  # s
# OpenMORA's MQTT module checks its time-out as late as a second after the last message
MODULE_STANDS_WITHIN = 1.15  # s
DRIVES_WITHIN = 20.0  # s
STARTED_LATE = 0.1  # s: an order was in transit, and the motion is sampled
# Shared memory would bypass the cable.
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


class RestartableAgent:
    """An agent in the network's namespace, and the orders of its driver."""

    def __init__(self, rca, network, directory):
        self.orders = DatedOrders()
        options = rca.options() | ({"ip": THERE} if rca.adapter_name == "ros1" else {})
        self._arguments = {
            "prefix": ("ip", "netns", "exec", network.name),
            "environment": os.environ | ROS_2,
            "ready": "",
            "adapter": rca.adapter_name,
            "profile": rca.profile,
            "options": options,
            "directory": str(directory),
            "began": self.orders.began,
        }
        self.start()

    def start(self):
        self.process = AgentProcess("driven_agent", **self._arguments)


@contextlib.contextmanager
def robot_of_driver(name, network, directory):
    rca = RIGS[name](directory)
    rca.world.watchdog = math.inf if "no watchdog" in name else 0.5
    with rca:
        rca.reset()
        agent = RestartableAgent(rca, network, directory)
        try:
            yield rca, agent
        finally:
            agent.process.kill()


def seconds_until(condition, within):
    """Return after how many seconds the condition held, infinity if it did not."""
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > within:
            return math.inf
        time.sleep(0.005)
    return time.monotonic() - began


def dated_orders(rca, agent, since):
    """Return the times and ages of the velocities at full speed that the robot received."""
    commands = [each for each in list(rca.world.commands) if each[0] > since]
    aged = [(each[0], agent.orders.age(*each)) for each in commands]
    return [(at, age) for at, age in aged if age is not None]


def end(ending, rca, agent, network):
    """End a part; return the function that undoes it."""
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
            agent.process.kill()
            return agent.start
        case _:
            agent.process.freeze(on=True)
            return lambda: agent.process.freeze(on=False)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("name", RIGS)
def test_no_old_order_moves_the_robot_and_it_stops_and_drives_again(
    name, ending, network, tmp_path, monkeypatch
):
    for variable, value in ROS_2.items():
        monkeypatch.setenv(variable, value)
    with robot_of_driver(name, network, tmp_path) as (rca, agent):
        commands = rca.world.commands
        wait(lambda: rca.world.sim.motion.linear > 0.1, 10.0)
        seen = len(commands)
        seconds_until(lambda: len(commands) > seen, 1.0)
        motion = Motion(rca.world)
        undo = end(ending, rca, agent, network)
        if "restarted" not in ending:
            time.sleep(AWAY)
        undone = time.monotonic()
        undo()
        again = seconds_until(
            lambda: any(age < OLD for _, age in dated_orders(rca, agent, undone + 0.1)),
            DRIVES_WITHIN,
        )
        _, rest, _ = motion.until_rest()
        orders = dated_orders(rca, agent, motion.began)
        old = [at for at, age in orders if age > OLD]
        oldest = max((age for _, age in orders), default=0.0)
        print(
            f"\n{name:18} {ending:23} old orders {len(old)}, oldest {oldest:5.2f} s"
            f"   at rest after {rest:5.2f} s   drives again after {again:5.2f} s"
        )
        assert again < math.inf
        assert caught_at_most_one(old, commands)
        if "no watchdog" not in name and "restarted" not in ending:
            within = MODULE_STANDS_WITHIN if name == "openmora_mqtt" else STANDS_WITHIN
            assert rest <= within + STARTED_LATE
        if "no watchdog" in name and "agent killed" in ending:
            first = next(each for each in commands if each[0] > undone)
            assert first[1:] == (0.0, 0.0), "the first velocity was not zero"
    assert not rca.errors
