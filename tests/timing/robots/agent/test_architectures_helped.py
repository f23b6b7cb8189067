"""Our assistance and navigation on robots of a real ROS with their own localization."""

import pytest

from robots.agent.adapters import registry
from robots.api import messages as m
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.architectures.ros2_robot import Ros2Rig

WALL = "5.0,1.0,1.5708"  # in the corridor, nose to its wall


@pytest.fixture(scope="module", params=[Ros1Rig, Ros2Rig], ids=["ros1", "ros2"])
def robot(request):
    with request.param("rhodon") as rig:
        yield rig
        assert not rig.errors


@pytest.fixture
def new_agent(robot, tmp_path):
    """Return a function that starts an agent for the robot, with options of its adapter."""
    rigs = []

    def start_agent(start, **options):
        robot.reset(start)
        rig = ThreadedControlRig(
            tmp_path, robot=registry.autonomous(robot.adapter(**options), "office")
        )
        rigs.append(rig)
        rig.start()
        rig.wait(lambda: rig.link.connected and rig.control.kernel.fault is None, within=30.0)
        rig.link.wait("state", lambda s: s.pose.localized, within=30.0)
        rig.wait(lambda: not rig.kernel.held)
        return rig

    yield start_agent
    for rig in rigs:
        rig.close()
        rig.time.close()


@pytest.mark.parametrize("late", [0.0, 0.4])
def test_laser_of_a_self_localizing_robot_stops_its_driver_before_a_wall(robot, new_agent, late):
    rig = new_agent(WALL)
    robot.robot.late = late
    assert {"assist", "localization", "goto"} <= rig.kernel.capabilities | set(
        rig.robot.profile.capabilities
    )
    rig.grant(assist="slow", ttl=60.0)
    rig.drive(
        0.4,
        until=lambda: any(s.assist_why == "stop" for s in rig.link.all("state")[-2:]),
        within=30.0,
    )
    assert rig.link.wait("state", lambda s: s.assist_why == "stop").assist_point is not None
    world = robot.world.sim
    assert world.contacts == 0
    assert 0.01 < world.clearance() < 0.2
    state = rig.link.all("state")[-1]
    assert abs(state.pose.x - robot.world.believed.x) < 0.1, "the pose is the robot's own"
    rig.drive(-0.2, until=lambda: world.clearance() > 0.3, within=30.0)
    assert world.contacts == 0


def test_robot_hits_the_wall_without_assistance(robot, new_agent):
    rig = new_agent(WALL)
    rig.grant(assist="off", ttl=60.0)
    rig.drive(0.4, until=lambda: robot.world.sim.contacts > 0, within=30.0)


def test_self_localizing_robot_without_navigation_uses_ours(robot, new_agent):
    rig = new_agent("5.0,1.0,3.1", navigation="none")
    assert "goto" in rig.robot.profile.capabilities
    rig.wait(lambda: rig.robot.node.ready, within=30.0)
    rig.grant(ttl=60.0)
    rig.act(m.Goto(action_id="g", stamp=0.0, session="s1", epoch=1, x=3.5, y=1.0))
    assert rig.beat_until_end("g").type == "goto"
    assert abs(robot.world.truth.x - 3.5) < 0.4
    assert robot.world.sim.contacts == 0
    assert robot.world.journey == "", "the architecture's own navigation moved"
