"""ROS 2's navigation, docking and driving, in every way in which the agent can be lost or the robot
be late: metres and seconds until the robot is at rest.

Real rclpy nodes over Fast DDS: the robot's own node, the agent's node with its guard, and an agent
with the control loop and a driver (governed_agent.py). `pytest -s` prints the table; the rows
marked nightly run in `make nightly`. The adapter, not the bus, passes velocities through the agent:
test_navigation_endings.py has those rows.
"""

import contextlib
import json
import math
import subprocess
import sys
import time

import pytest

from robots.api.geometry import Pose2D
from tests.support.architectures.rca_world import BEFORE_DOCK
from tests.support.architectures.ros1_processes import Process
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.patience import patient

ZERO_WITHIN = 0.65  # s from the event to the first zero velocity
BRAKING = 0.5 / 0.8  # s from the robot's speed to a standstill
AWAY = 4.0  # s
SEEN_FOR = 3.0  # s that the robot is watched afterwards
MOVES = 0.02  # m/s
AHEAD = 6.0  # m
NIGHTLY = [
    (action, end)
    for action in ("goto", "dock", "drive", "")
    for end in ("killed", "frozen", "hung")
    if (action, end) not in {("goto", "hung"), ("dock", "killed")}
]


@pytest.fixture(scope="module")
def rig():
    with Ros2Rig("giraff") as rig:
        yield rig
        assert not rig.errors


@contextlib.contextmanager
def governed(rig, directory, action):
    """An agent whose robot does an action."""
    rig.reset(BEFORE_DOCK["giraff"] if action == "dock" else None)
    goal = rig.world.truth.compose(Pose2D(AHEAD, 0.0, 0.0))
    wish = {
        "adapter": "ros2",
        "profile": "giraff",
        "directory": str(directory),
        "options": rig.options(),
        "goal": [goal.x, goal.y],
    }
    command = [sys.executable, "-m", "tests.support.agents.governed_agent", json.dumps(wish)]
    log = directory / "agent.log"
    with log.open("w") as out:
        agent = Process(command, log, stdin=subprocess.PIPE, stdout=out)
    try:
        agent.wait_for(lambda each: "connected" in each, within=30.0)
        if action:
            agent.request(action)
            wait(lambda: rig.world.sim.motion.linear > 0.15)
        yield agent
    finally:
        agent.freeze(on=False)
        agent.kill()


def wait(condition):
    deadline = time.monotonic() + patient(20.0)
    while not condition():
        assert time.monotonic() < deadline, "the robot does not move"
        time.sleep(0.005)


class Motion:
    """How the robot comes to rest after an event."""

    def __init__(self, world):
        self.world, self.began = world, time.monotonic()
        self.from_distance = world.sim.distance
        self.metres = self.seconds = 0.0
        self.later = 0.0  # metres after the first standstill
        self.stood_at = math.inf

    def watch(self, seconds):
        until = time.monotonic() + seconds
        while (now := time.monotonic()) < until:
            moves = abs(self.world.sim.motion.linear) > MOVES
            if moves:
                self.seconds = now - self.began
            elif self.stood_at == math.inf:
                self.stood_at, self.metres = now, self.world.sim.distance - self.from_distance
            time.sleep(0.005)
        self.later = self.world.sim.distance - self.from_distance - self.metres


@pytest.mark.parametrize(
    ("action", "end"),
    [
        ("goto", "hung"),
        ("dock", "killed"),
        *(pytest.param(*each, marks=pytest.mark.nightly) for each in NIGHTLY),
    ],
)
def test_a_lost_agent_leaves_the_robot_at_rest(rig, tmp_path, action, end):
    with governed(rig, tmp_path, action) as agent:
        motion = Motion(rig.world)
        match end:
            case "killed":
                agent.kill()
            case "frozen":
                agent.freeze(on=True)
            case _:
                agent.request("hang")
        motion.watch(AWAY)
        if end == "frozen":
            agent.freeze(on=False)
        motion.watch(SEEN_FOR)
        sys.stdout.write(
            f"\n{action or 'idle'}: agent {end:6} {motion.metres:5.2f} m  at rest after"
            f" {motion.seconds:5.2f} s  then {motion.later:5.3f} m\n"
        )
        assert motion.seconds <= patient(ZERO_WITHIN + BRAKING)
        assert motion.later < 0.01


@pytest.mark.nightly
def test_a_goal_that_is_accepted_after_6_s_does_not_move_the_robot(rig, tmp_path):
    with governed(rig, tmp_path, "") as agent:
        rig.world.accept_after = 6.0
        before = rig.world.sim.distance
        agent.request("goto")
        ended = agent.wait_for(lambda each: each.get("progress") in {"FAILED", "CANCELLED"})
        motion = Motion(rig.world)
        motion.watch(SEEN_FOR)
        sys.stdout.write(
            f"\ngoto: accepted after 6 s   {rig.world.sim.distance - before:5.2f} m"
            f"  reported {ended['progress']} {ended['reason']}\n"
        )
        assert rig.world.journey != "running"
        assert rig.world.sim.distance - before < 0.3


@pytest.mark.nightly
def test_a_robot_that_hung_for_6_s_with_a_goal_does_not_move_afterwards(rig, tmp_path):
    with governed(rig, tmp_path, "") as agent:
        before = rig.world.sim.distance
        rig.freeze(on=True)
        try:
            agent.request("goto")
            time.sleep(6.0)
        finally:
            rig.freeze(on=False)
        motion = Motion(rig.world)
        motion.watch(AWAY + SEEN_FOR)
        reported = [each for each in agent.events(motion.began - 6.0) if "progress" in each]
        sys.stdout.write(
            f"\ngoto: robot's node hung 6 s {rig.world.sim.distance - before:5.2f} m"
            f"  reported {[each['progress'] + ' ' + each['reason'] for each in reported]}\n"
        )
        assert rig.world.sim.distance - before < 0.3
        assert rig.world.journey != "running"
