"""ROS 2's navigation, docking and driving when the agent is lost or the robot is late: metres and
seconds until the robot is at rest.

Real rclpy nodes over Fast DDS: the robot's node, the agent's node with its guard, and a whole agent
(ordered_agent.py). `pytest -s` prints the table; the rows marked nightly run in `make nightly`.
Velocities that pass through the agent depend on the adapter, not on the bus:
test_navigation_endings.py has those rows.
"""

import contextlib
import time

import pytest

from robots.api.geometry import Pose2D
from tests.support.agents.agent_process import AgentProcess, wait
from tests.support.architectures.motion import Motion, assert_rest
from tests.support.architectures.rca_world import BEFORE_DOCK
from tests.support.architectures.ros2_robot import Ros2Rig

ZERO_WITHIN = 0.65  # s from the event to the first zero velocity
BRAKING = 0.5 / 0.8  # s from the robot's speed to a standstill
AWAY = 4.0  # s
SEEN_FOR = 3.0  # s that the robot is watched afterwards
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
    """Yield an agent whose robot does an action, and a function that starts a goal ahead."""
    rig.reset(BEFORE_DOCK["giraff"] if action == "dock" else None)
    goal = rig.world.truth.compose(Pose2D(AHEAD, 0.0, 0.0))
    goto = ("goto", f"{goal.x}", f"{goal.y}")
    agent = AgentProcess(
        "ordered_agent",
        adapter="ros2",
        profile="giraff",
        directory=str(directory),
        options=rig.options(),
    )
    try:
        if action:
            agent.request(*(goto if action == "goto" else (action,)))
            wait(lambda: rig.world.sim.motion.linear > 0.15, 20.0)
        yield agent, lambda: agent.request(*goto)
    finally:
        agent.kill()


@pytest.mark.parametrize(
    ("action", "end"),
    [
        ("goto", "hung"),
        ("dock", "killed"),
        *(pytest.param(*each, marks=pytest.mark.nightly) for each in NIGHTLY),
    ],
)
def test_lost_agent_leaves_the_robot_at_rest(rig, tmp_path, action, end):
    with governed(rig, tmp_path, action) as (agent, _):
        motion = Motion(rig.world)
        if end == "killed":
            agent.kill()
        elif end == "frozen":
            agent.freeze(on=True)
            time.sleep(AWAY)
            agent.freeze(on=False)
        else:
            agent.request("hang")
            agent.wait_for(lambda each: "hung" in each, since=motion.began)
            agent.request("idle")
        found = motion.until_rest(AWAY + SEEN_FOR)
        label = f"{action or 'idle'}: agent {end}"
        assert_rest(label, found, ZERO_WITHIN + BRAKING, later=0.01, said=agent.reported())


def assert_never_moved(rig, agent, label, before):
    found = Motion(rig.world).until_rest(AWAY + SEEN_FOR)
    metres = rig.world.sim.distance - before
    print(f"\n{label}: {metres:5.2f} m  {found}  {agent.reported()}")
    assert rig.world.journey != "running"
    assert metres < 0.3


@pytest.mark.nightly
def test_goal_accepted_after_6_s_does_not_move_the_robot(rig, tmp_path):
    with governed(rig, tmp_path, "") as (agent, goto):
        rig.world.accept_after = 6.0
        before = rig.world.sim.distance
        goto()
        agent.wait_for(lambda each: each.get("status") in {"FAILED", "CANCELLED"})
        assert_never_moved(rig, agent, "goto: accepted after 6 s", before)


@pytest.mark.nightly
def test_robot_that_hung_for_6_s_with_a_goal_does_not_move_afterwards(rig, tmp_path):
    with governed(rig, tmp_path, "") as (agent, goto):
        before = rig.world.sim.distance
        rig.freeze(on=True)
        try:
            goto()
            time.sleep(6.0)
        finally:
            rig.freeze(on=False)
        assert_never_moved(rig, agent, "goto: robot's node hung 6 s", before)
