"""OpenMORA (over MOOS and over MQTT) and ROS 2 when the agent, its control thread, its link, the
robot or a cancel is lost: metres and seconds until rest, and the agent's last state.

The agent is whole and a process of its own (ordered_agent.py), the MOOSDB a double or, with
MOOSDB_PROGRAM=/path/to/MOOSDB, a real one; the broker is Mosquitto; the nodes of ROS 2 are rclpy's,
over Fast DDS. The robot drives at 0.25 m/s for its driver and at 0.5 m/s by itself, and brakes with
0.8 m/s². Its base has a watchdog of 0.5 s; OpenMORA's MQTT module ends a motion after 0.5 s, but
may check that as late as a second after the last message. RobotControlManager, the guard, waits
0.5 s (MOOS, as the profile requests) or 2 s (MQTT, as shipped) for an acknowledgement; the guard of
ROS 2 sends a zero velocity within 0.65 s. Velocities of its navigation that pass through the agent
depend on the adapter, not on the bus: test_navigation_endings.py has them. `pytest -s` prints the
table; the cells marked nightly run in `make nightly`.
"""

import contextlib
import time
from dataclasses import dataclass

import pytest

from tests.support.agents.agent_process import AgentProcess, wait
from tests.support.agents.orders import caught_at_most_one
from tests.support.architectures.moos_robot import MoosRig
from tests.support.architectures.motion import Motion, assert_rest
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.patience import patient
from tests.support.programs.namespace import HERE, namespace

AWAY = 4.0  # s
WATCHED = 3.0  # s that the robot is watched after it should be at rest
BRAKING = 0.5 / 0.8  # s from its own navigation's speed to a standstill
JERK = 0.12  # m that a planner which resumes may move the robot until it is cancelled again


@dataclass(frozen=True)
class Architecture:
    """How to make its robot, and the seconds after which its guard and its watchdog stop it."""

    make: object
    guard: float
    watchdog: float
    profile: str = ""  # unless that of the rig
    later: float = 0.03  # m that the robot may move after it was at rest


OPENMORA = {
    "moos": Architecture(lambda _, host: MoosRig("giraff", listening=host), 0.5, 0.5),
    "openmora_mqtt": Architecture(
        lambda directory, host: OpenMoraRig(directory, host=host), 2.0, 1.0
    ),
}
ROS_2 = Architecture(lambda *_: Ros2Rig("giraff"), 0.45, 0.65, profile="giraff", later=0.01)
ARCHITECTURES = OPENMORA | {"ros2": ROS_2}
ROWS = ("idle", "driven", "navigating", "docking")
START = {"docking": "1.9,6.3,3.14159", "navigating": "4.0,1.0,0.0"}
FAST = {"driven": 0.24, "navigating": 0.45, "docking": 0.19}  # m/s: near its speed


@contextlib.contextmanager
def robot(name, row, directory, *, network=None, **world):
    """Yield a robot in the state of its row, and the agent that put it there."""
    host = HERE if network else "127.0.0.1"
    with ARCHITECTURES[name].make(directory, host) as rca:
        rca.world.watchdog = 0.5
        rca.ack_interval = ARCHITECTURES[name].guard
        rca.reset(START.get(row))
        for key, value in world.items():
            setattr(rca.world, key, value)
        prefix = ("ip", "netns", "exec", network.name) if network else ()
        agent = AgentProcess(
            "ordered_agent",
            prefix=prefix,
            adapter=rca.adapter_name,
            profile=ARCHITECTURES[name].profile or rca.profile,
            options=rca.options(),
            directory=str(directory),
        )
        try:
            begin(row, rca, agent)
            if row != "idle" and not world:
                wait(lambda: rca.world.sim.motion.linear > FAST[row], 20.0)
            yield rca, agent
        finally:
            agent.kill()
    assert not rca.errors


def begin(row, rca, agent):
    place = rca.world.truth
    match row:
        case "driven":
            agent.request("drive")
        case "navigating":
            agent.request("goto", f"{place.x + 6.0}", f"{place.y}")
        case "docking":
            agent.request("dock")


def bound(name, row):
    """Return the seconds from the loss of the agent to standstill, on an idle computer."""
    architecture = ARCHITECTURES[name]
    own = {"driven": architecture.watchdog, "idle": 0.0}
    return own.get(row, architecture.guard + 0.2) + BRAKING


def cells(quick, columns, names=ARCHITECTURES):
    """Return all cells of rows and columns; those that are not `quick` run nightly."""
    return [
        pytest.param(
            name,
            row,
            column,
            marks=() if (row, column) in quick else pytest.mark.nightly,
            id=f"{name}-{row}-{column}",
        )
        for name in names
        for row in ROWS
        for column in columns
    ]


@pytest.mark.parametrize(
    ("name", "row", "column"),
    cells(
        {("navigating", "killed"), ("docking", "stopped"), ("navigating", "hung")},
        ("killed", "stopped", "hung"),
    ),
)
def test_robot_comes_to_rest_without_its_agent(name, row, column, tmp_path):
    with robot(name, row, tmp_path) as (rca, agent):
        motion = Motion(rca.world)
        within = bound(name, row)
        if column == "hung":
            agent.request("hang")
            agent.wait_for(lambda each: "hung" in each, since=motion.began)
            agent.request("idle")
        elif column == "killed":
            agent.kill()
        else:
            agent.freeze(on=True)
            time.sleep(AWAY)
            agent.request("idle")
            agent.freeze(on=False)
        found = motion.until_rest(within + WATCHED)
        part = "control thread" if column == "hung" else "agent"
        label, later = f"{name}, {row}: {part} {column}", ARCHITECTURES[name].later
        assert_rest(label, found, within, later=later, said=agent.reported())


@pytest.mark.nightly
@pytest.mark.parametrize("away", [AWAY, None], ids=["4 s", "for good"])
@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("name", OPENMORA)
def test_robot_comes_to_rest_when_the_link_is_cut(name, row, away, tmp_path):
    with namespace() as network, robot(name, row, tmp_path, network=network) as (rca, agent):
        motion = Motion(rca.world)
        network.pull()
        agent.request("idle")
        if away:
            time.sleep(away)
            network.plug()
        found = motion.until_rest(bound(name, row) + WATCHED)
        agent.wait_for(
            lambda each: any("adapter_lost" in text for text in each.get("errors", ())),
            since=motion.began,
        )
        label = f"{name}, {row}: link cut {'4 s' if away else 'for good'}"
        assert_rest(label, found, bound(name, row), said=agent.reported())


@pytest.mark.parametrize(
    ("name", "row", "column"),
    cells({("driven", "robot")}, ("middleman", "robot"), OPENMORA),
)
def test_robot_comes_to_rest_when_it_or_its_middleman_hangs(name, row, column, tmp_path):
    """The middleman is the MOOSDB or the broker; in the other case the robot hangs behind it."""
    with robot(name, row, tmp_path) as (rca, agent):
        hang = rca.freeze if column == "middleman" else rca.hang
        motion = Motion(rca.world)
        hang(on=True)
        time.sleep(AWAY)
        agent.request("idle")
        thawed = time.monotonic()
        hang(on=False)
        found = motion.until_rest(bound(name, row) + WATCHED)
        late = [at for at, linear, _ in rca.world.commands if at > thawed and linear]
        label = f"{name}, {row}: {column} hung 4 s, {len(late)} late"
        assert_rest(label, found, AWAY + 1.0, said=agent.reported())
        assert caught_at_most_one(late, rca.world.commands)


@pytest.mark.parametrize(
    ("name", "row", "column"),
    [
        each
        for each in cells(
            {("navigating", "is lost"), ("navigating", "resumes")},
            ("is lost", "is ignored", "resumes"),
            OPENMORA,
        )
        if each.values[1] in {"navigating", "docking"}
    ],
)
def test_stop_holds_although_a_cancel_is_not_obeyed(name, row, column, tmp_path):
    with robot(name, row, tmp_path) as (rca, agent):
        goal = rca.world.goal
        rca.world.ignored_cancels = {"is lost": 1, "is ignored": float("inf"), "resumes": 0}[column]
        motion = Motion(rca.world)
        agent.request("stop")
        jerk = 0.03
        if column == "resumes":
            wait(lambda: rca.world.sim.motion.linear == 0.0)
            time.sleep(1.0)
            rca.resume(goal)
            jerk = patient(JERK)
        found = motion.until_rest(1.0 + BRAKING + WATCHED)
        label = f"{name}, {row}: stop, {'planner' if column == 'resumes' else 'cancel'} {column}"
        assert_rest(label, found, 1.0 + BRAKING, later=jerk, said=agent.reported())
        if column == "is ignored":
            agent.wait_for(
                lambda each: any("has not confirmed" in text for text in each.get("errors", ()))
            )
            assert not any(each.get("status") == "CANCELLED" for each in agent.events())
        else:
            agent.wait_for(lambda each: each.get("status") == "CANCELLED")


@pytest.mark.nightly
@pytest.mark.parametrize("row", ["navigating", "docking"])
@pytest.mark.parametrize("name", OPENMORA)
def test_stop_holds_although_the_goal_is_accepted_after_it(name, row, tmp_path):
    with robot(name, row, tmp_path, accept_after=6.0) as (rca, agent):
        agent.wait_for(lambda each: each.get("status") == "RUNNING")
        time.sleep(1.0)
        motion = Motion(rca.world)
        agent.request("stop")
        found = motion.until_rest(6.0 + WATCHED)
        label = f"{name}, {row}: stop, goal accepted after 6 s"
        assert_rest(label, found, 0.5, said=agent.reported())
        agent.wait_for(lambda each: each.get("status") == "CANCELLED")


@pytest.mark.nightly
@pytest.mark.parametrize("late", ["accepted after 6 s", "robot's node hung 6 s"])
def test_goal_that_ros_2_accepts_too_late_does_not_move_the_robot(late, tmp_path):
    with robot("ros2", "idle", tmp_path) as (rca, agent):
        before = rca.world.sim.distance
        if late == "accepted after 6 s":
            rca.world.accept_after = 6.0
            begin("navigating", rca, agent)
            agent.wait_for(lambda each: each.get("status") in {"FAILED", "CANCELLED"})
        else:
            rca.freeze(on=True)
            begin("navigating", rca, agent)
            time.sleep(6.0)
            rca.freeze(on=False)
        found = Motion(rca.world).until_rest(AWAY + WATCHED)
        metres = rca.world.sim.distance - before
        print(f"\nros2, goto: {late}: {metres:5.2f} m  {found}  {agent.reported()}")
        assert rca.world.journey != "running"
        assert metres < 0.3
