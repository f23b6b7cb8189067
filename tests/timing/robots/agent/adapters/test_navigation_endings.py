"""The robot's own navigation, in every way in which the agent can be lost or a cancel be ignored:
metres and seconds until the robot is at rest.

Everything is real: ROS master, rospy, actionlib's SimpleActionServer as move_base, std_srvs/Trigger
for docking, each in a process of its own (ros1_navigation.py). The planner drives at 0.3 m/s, the
base brakes with 0.8 m/s². `pytest -s` prints the table; the rows marked nightly run in `make
nightly`.
"""

import contextlib
import sys
import time

import pytest

from tests.support.architectures.ros1_processes import Ros1Processes
from tests.support.patience import patient
from tests.support.programs.namespace import HERE, THERE, namespace

ZERO_WITHIN = 0.65  # s from the event to the first zero velocity
BRAKING = 0.3 / 0.8  # s from the planner's speed to a standstill
JERKS = (
    0.06  # m that a planner which ignores every cancel moves the robot between two zeros, in 4 s
)
SEEN_FOR = 4.0  # s that the robot is watched afterwards
AWAY = 4.0  # s
OLD = 0.3  # s
DOCKING = {"dock": "/dock", "cancel_dock": "/cancel_dock"}
OPTIONS = {
    "guarded": DOCKING,
    "agent": DOCKING | {"navigation_velocity": "/cmd_vel_nav"},
}
TOPICS = {"guarded": "/cmd_vel", "agent": "/cmd_vel_nav"}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Ros1Processes(tmp_path_factory.mktemp("ros1")) as made:
        yield made


@contextlib.contextmanager
def moving(robot, control, habit="obeys", action="goto", module="navigating_agent"):
    """The planner drives the robot for an agent."""
    planner = robot.plan(habit, TOPICS[control])
    agent = robot.agent(OPTIONS[control], module=module)
    try:
        agent.wait_for(lambda event: event.get("control") == control)
        if action:
            agent.request(action)
            robot.drives()
        yield planner, agent
    finally:
        for process in (agent, planner):
            process.freeze(on=False)
            robot.stop(process)


def reports(agent, since):
    """Return what the agent reports to the page: the progress of actions, and errors."""
    found = [
        f"{each['progress']} {each['reason']}" if "progress" in each else "; ".join(each["errors"])
        for each in agent.events(since)
        if "progress" in each or "errors" in each
    ]
    return list(dict.fromkeys(found))


def rest(robot, name, event, *, until_zero=ZERO_WITHIN, jerks=0.01):
    """Assert that the robot is at rest in time and stays there."""
    time.sleep(SEEN_FOR)
    metres, seconds, later = robot.after(event, time.monotonic())
    sys.stdout.write(
        f"\n{name:60} {metres:5.2f} m  at rest after {seconds:5.2f} s  then {later:5.3f} m\n"
    )
    assert seconds <= patient(until_zero + BRAKING)
    assert later <= jerks
    assert metres <= 0.3 * patient(until_zero + BRAKING)
    if name.startswith("agent"):  # what the planner publishes does not reach the base by itself
        late = robot.base.events(event + patient(until_zero))
        assert not [each for each in late if each.get("command")]


@pytest.mark.parametrize(
    "habit",
    [
        "obeys",
        "misses",
        *(pytest.param(h, marks=pytest.mark.nightly) for h in ("ignores", "resumes")),
    ],
)
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_a_killed_agent_leaves_the_robot_at_rest(robot, control, habit):
    with moving(robot, control, habit) as (planner, agent):
        event = time.monotonic()
        agent.kill()
        rest(robot, f"{control}, planner {habit}: agent killed", event, jerks=JERKS)
        planner.wait_for(lambda each: "cancel" in each, event)


@pytest.mark.parametrize("habit", ["obeys", pytest.param("ignores", marks=pytest.mark.nightly)])
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_a_frozen_agent_leaves_the_robot_at_rest(robot, control, habit):
    with moving(robot, control, habit) as (_, agent):
        event = time.monotonic()
        agent.freeze(on=True)
        time.sleep(AWAY)
        agent.freeze(on=False)
        rest(robot, f"{control}, planner {habit}: agent frozen 4 s", event, jerks=2 * JERKS)


NIGHTLY_HANGS = [("guarded", ""), ("agent", "goto"), ("agent", "dock"), ("guarded", "drive")]


@pytest.mark.parametrize(
    ("control", "action"),
    [
        ("guarded", "goto"),
        ("guarded", "dock"),
        *(pytest.param(*each, marks=pytest.mark.nightly) for each in NIGHTLY_HANGS),
    ],
)
def test_a_hung_control_thread_leaves_the_robot_at_rest(robot, control, action):
    with moving(robot, control, action=action, module="governed_agent") as (_, agent):
        agent.request("hang")
        event = agent.wait_for(lambda each: "hung" in each)["at"]
        time.sleep(AWAY)
        name = f"{control}, {action or 'idle'}: control thread hung 4 s"
        rest(robot, name, event, jerks=2 * JERKS if action in {"goto", "dock"} else 0.01)
        sys.stdout.write(f"  reported: {reports(agent, event)}\n")


@pytest.mark.nightly
@pytest.mark.parametrize("habit", ["obeys", "misses", "ignores"])
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_an_agent_that_is_started_again_moves_nothing(robot, control, habit):
    with moving(robot, control, habit) as (_, agent):
        event = time.monotonic()
        agent.kill()
        successor = robot.agent(OPTIONS[control])
        rest(robot, f"{control}, planner {habit}: agent restarted", event, jerks=2 * JERKS)
        robot.stop(successor)


@pytest.mark.parametrize("control", ["guarded", pytest.param("agent", marks=pytest.mark.nightly)])
def test_a_planner_that_hung_ends_a_goal_that_it_received_meanwhile(robot, control):
    planner = robot.plan("obeys", TOPICS[control])
    agent = robot.agent(OPTIONS[control])
    try:
        time.sleep(0.3)  # its status has come
        planner.freeze(on=True)
        agent.request("goto")
        agent.wait_for(lambda event: event.get("progress") == "RUNNING")
        time.sleep(6.0)
        event = time.monotonic()
        planner.freeze(on=False)
        ended = agent.wait_for(lambda each: each.get("progress") == "FAILED", event)
        assert ended["reason"] == "navigation_lost: silent"
        rest(robot, f"{control}: planner hung 6 s with a goal", event)
    finally:
        for process in (agent, planner):
            process.freeze(on=False)
            robot.stop(process)


def test_a_cancel_is_repeated_until_the_planner_ends(robot):
    with moving(robot, "guarded", "misses") as (planner, agent):
        event = time.monotonic()
        agent.request("cancel")
        agent.wait_for(lambda each: each.get("progress") == "CANCELLED", event)
        assert len([each for each in planner.events(event) if "cancel" in each]) >= 3
        rest(robot, "guarded, planner misses two cancels: cancelled", event, until_zero=1.2)


@pytest.mark.nightly
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_a_goal_accepted_late_is_cancelled_when_its_agent_is_gone(robot, control):
    planner = robot.plan("hesitates", TOPICS[control])
    agent = robot.agent(OPTIONS[control])
    try:
        agent.request("goto")
        planner.wait_for(lambda each: "received" in each)
        event = time.monotonic()
        agent.kill()
        planner.wait_for(lambda each: "ended" in each, event, 15.0)
        rest(robot, f"{control}, planner accepts after 6 s: agent killed", event)
    finally:
        for process in (agent, planner):
            robot.stop(process)


@pytest.mark.parametrize("habit", ["obeys", pytest.param("hesitates", marks=pytest.mark.nightly)])
@pytest.mark.parametrize("end", ["killed", pytest.param("frozen", marks=pytest.mark.nightly)])
@pytest.mark.parametrize("control", ["guarded", pytest.param("agent", marks=pytest.mark.nightly)])
def test_docking_ends_with_its_agent(robot, control, habit, end):
    with moving(robot, control, habit, "dock") as (planner, agent):
        event = time.monotonic()
        if end == "killed":
            agent.kill()
        else:
            agent.freeze(on=True)
        planner.wait_for(lambda each: "cancel_dock" in each, event)
        rest(robot, f"{control}, docking service {habit}: agent {end}", event)


@pytest.mark.nightly
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_docking_whose_call_gives_no_answer_in_time_is_cancelled(robot, control):
    with moving(robot, control, "hesitates", "dock") as (planner, agent):
        found = agent.wait_for(lambda each: "failed" in each, within=20.0)
        assert found["failed"] == "/dock does not answer"
        assert not found["refused"]
        planner.wait_for(lambda each: "cancel_dock" in each, found["at"])
        rest(robot, f"{control}: a call to dock timed out", found["at"])


@pytest.mark.nightly
@pytest.mark.parametrize("end", ["lives", "killed"])
def test_docking_that_begins_after_its_cancel_is_cancelled_again(robot, end):
    planner = robot.plan("docks late", TOPICS["guarded"])
    agent = robot.agent(OPTIONS["guarded"], module="governed_agent")
    try:
        agent.request("dock")
        called = planner.wait_for(lambda each: "dock" in each)
        if end == "killed":
            agent.kill()
        planner.wait_for(lambda each: "cancel_dock" in each, called["at"])
        began = planner.wait_for(lambda each: "docks" in each, called["at"])["at"]
        planner.wait_for(lambda each: "cancel_dock" in each, began, 5.0)
        rest(robot, f"guarded, docking begins 12 s late: agent {end}", began, jerks=JERKS)
    finally:
        for process in (agent, planner):
            robot.stop(process)


@pytest.mark.parametrize(
    "habit",
    ["obeys", "ignores", pytest.param("misses", marks=pytest.mark.nightly)],
)
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_a_stop_of_the_driver_leaves_the_robot_at_rest(robot, control, habit):
    with moving(robot, control, habit, module="governed_agent") as (planner, agent):
        event = time.monotonic()
        agent.request("stop")
        jerks = JERKS if habit == "ignores" else 0.02
        rest(robot, f"{control}, planner {habit}: driver's stop", event, jerks=jerks)
        planner.wait_for(lambda each: "cancel" in each, event)
        if habit == "ignores":
            agent.wait_for(
                lambda each: any("cancel: " in error for error in each.get("errors", ())), event
            )


@pytest.mark.nightly
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_a_planner_that_resumes_after_a_stop_is_braked_again(robot, control):
    with moving(robot, control, "resumes", module="governed_agent") as (_, agent):
        event = time.monotonic()
        agent.request("stop")
        rest(robot, f"{control}, planner resumes: driver's stop", event, jerks=JERKS)


@pytest.mark.nightly
@pytest.mark.parametrize("away", [AWAY, None], ids=["4 s", "for good"])
def test_a_cut_link_leaves_a_robot_that_is_driven_through_the_agent_at_rest(tmp_path, away):
    with namespace() as network, Ros1Processes(tmp_path, HERE) as robot:
        prefix = ("ip", "netns", "exec", network.name)
        options = OPTIONS["agent"] | {"ip": THERE}
        planner = robot.plan("obeys", "/cmd_vel_nav")
        agent = robot.agent(options, prefix)
        agent.request("goto")
        robot.drives()
        event = time.monotonic()
        network.pull()
        time.sleep(AWAY)
        if away is not None:
            network.plug()
        rest(robot, f"agent: link cut {'for good' if away is None else '4 s'}", event)
        if away is not None:
            planner.wait_for(lambda each: "ended" in each, event)
