"""The robot's own navigation when the agent is lost or a cancel is ignored: metres and seconds to
rest.

Everything is real: ROS master, rospy, actionlib's SimpleActionServer as move_base, std_srvs/Trigger
for docking, and a whole agent (ordered_agent.py), each in a process of its own
(ros1_navigation.py). The planner drives at 0.3 m/s, the base brakes with 0.8 m/s². `pytest -s`
prints the table; the rows marked nightly run in `make nightly`.
"""

import contextlib
import itertools
import time

import pytest

from tests.support.architectures.motion import assert_rest
from tests.support.architectures.ros1_processes import Ros1Processes
from tests.support.patience import patient
from tests.support.programs.namespace import HERE, THERE, namespace

ZERO_WITHIN = 0.65  # s from the event to the first zero velocity
PLANNER = 0.3  # m/s
BRAKING = PLANNER / 0.8  # s from the planner's speed to a standstill
JERKS = 0.06  # m in 4 s: a planner that ignores every cancel moves the robot between two zeros
SEEN_FOR = 4.0  # s that the robot is watched afterwards
AWAY = 4.0  # s
DOCKING = {"dock": "/dock", "cancel_dock": "/cancel_dock"}
OPTIONS = {
    "guarded": DOCKING,
    "agent": DOCKING | {"navigation_velocity": "/cmd_vel_nav"},
}
TOPICS = {"guarded": "/cmd_vel", "agent": "/cmd_vel_nav"}
REQUESTS = {"goto": ("goto", "60", "0"), "dock": ("dock",), "drive": ("drive",)}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with Ros1Processes(tmp_path_factory.mktemp("ros1")) as made:
        yield made


@contextlib.contextmanager
def moving(robot, control, habit="obeys", action="goto"):
    """Yield the planner and an agent for which it drives the robot; without an action, at rest."""
    with (
        robot.planner(habit, TOPICS[control]) as planner,
        robot.agent(OPTIONS[control]) as agent,
    ):
        agent.wait_for(lambda event: event.get("control") == control)
        if action:
            agent.request(*REQUESTS[action])
            robot.drives(0.25 if action == "drive" else PLANNER)
        yield planner, agent


def rest(robot, name, event, *, jerks=0.01):
    """Assert that the robot is at rest in time and stays there."""
    time.sleep(SEEN_FOR)
    found = metres, _, _ = robot.after(event, time.monotonic())
    assert_rest(name, found, ZERO_WITHIN + BRAKING, later=jerks)
    assert metres <= 0.3 * patient(ZERO_WITHIN + BRAKING)
    if name.startswith("agent"):  # the planner's velocities do not reach the base by themselves
        late = robot.base.events(event + patient(ZERO_WITHIN))
        assert not [each for each in late if each.get("command")]


QUICK_LOSSES = {("killed", "obeys"), ("killed", "misses"), ("frozen 4 s", "obeys")}
LOSSES = [
    pytest.param(*each, marks=() if each in QUICK_LOSSES else pytest.mark.nightly)
    for each in (
        *(("killed", habit) for habit in ("obeys", "misses", "ignores", "resumes")),
        *(("frozen 4 s", habit) for habit in ("obeys", "ignores")),
        *(("restarted", habit) for habit in ("obeys", "misses", "ignores")),
    )
]


@pytest.mark.parametrize(("loss", "habit"), LOSSES)
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_lost_agent_leaves_the_robot_at_rest(robot, control, loss, habit):
    with moving(robot, control, habit) as (planner, agent), contextlib.ExitStack() as stack:
        event = time.monotonic()
        if loss == "frozen 4 s":
            agent.freeze(on=True)
            time.sleep(AWAY)
            agent.freeze(on=False)
        else:
            agent.kill()
        if loss == "restarted":
            stack.enter_context(robot.agent(OPTIONS[control]))
        jerks = JERKS if loss == "killed" else 2 * JERKS
        rest(robot, f"{control}, planner {habit}: agent {loss}", event, jerks=jerks)
        if loss == "killed":
            planner.wait_for(lambda each: "cancel" in each, event)


NIGHTLY_HANGS = [("guarded", ""), ("agent", "goto"), ("agent", "dock"), ("guarded", "drive")]


@pytest.mark.parametrize(
    ("control", "action"),
    [
        ("guarded", "goto"),
        ("guarded", "dock"),
        *(pytest.param(*each, marks=pytest.mark.nightly) for each in NIGHTLY_HANGS),
    ],
)
def test_hung_control_thread_leaves_the_robot_at_rest(robot, control, action):
    with moving(robot, control, action=action) as (_, agent):
        agent.request("hang")
        event = agent.wait_for(lambda each: "hung" in each)["at"]
        agent.request("idle")
        time.sleep(AWAY)
        name = f"{control}, {action or 'idle'}: control thread hung 4 s"
        rest(robot, name, event, jerks=2 * JERKS if action in {"goto", "dock"} else 0.01)
        print(f"  reported: {agent.reported(event)}")


@pytest.mark.parametrize("control", ["guarded", pytest.param("agent", marks=pytest.mark.nightly)])
def test_planner_that_hung_ends_a_goal_that_it_received_then(robot, control):
    with moving(robot, control, action="") as (planner, agent):
        time.sleep(0.3)  # until its status has arrived
        planner.freeze(on=True)
        agent.request(*REQUESTS["goto"])
        agent.wait_for(lambda event: event.get("status") == "RUNNING")
        time.sleep(6.0)
        event = time.monotonic()
        planner.freeze(on=False)
        ended = agent.wait_for(lambda each: each.get("status") == "FAILED", event)
        assert ended["reason"] == "navigation_lost: silent"
        rest(robot, f"{control}: planner hung 6 s with a goal", event)


@pytest.mark.nightly
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_goal_accepted_late_is_cancelled_when_its_agent_is_gone(robot, control):
    with moving(robot, control, "hesitates", "") as (planner, agent):
        agent.request(*REQUESTS["goto"])
        planner.wait_for(lambda each: "received" in each)
        event = time.monotonic()
        agent.kill()
        planner.wait_for(lambda each: "ended" in each, event, 15.0)
        rest(robot, f"{control}, planner accepts after 6 s: agent killed", event)


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
def test_docking_is_cancelled_when_its_call_times_out(robot, control):
    with moving(robot, control, "hesitates", "dock") as (planner, agent):
        found = agent.wait_for(lambda each: each.get("status") == "FAILED", within=20.0)
        assert found["reason"] == "not_connected: no answer"
        planner.wait_for(lambda each: "cancel_dock" in each, found["at"])
        rest(robot, f"{control}: a call to dock timed out", found["at"])


@pytest.mark.nightly
@pytest.mark.parametrize("end", ["lives", "killed"])
def test_docking_that_begins_after_its_cancel_is_cancelled_again(robot, end):
    with moving(robot, "guarded", "docks late", "") as (planner, agent):
        agent.request("dock")
        called = planner.wait_for(lambda each: "dock" in each)
        if end == "killed":
            agent.kill()
        planner.wait_for(lambda each: "cancel_dock" in each, called["at"])
        began = planner.wait_for(lambda each: "docks" in each, called["at"])["at"]
        planner.wait_for(lambda each: "cancel_dock" in each, began, 5.0)
        rest(robot, f"guarded, docking begins 12 s late: agent {end}", began, jerks=JERKS)


@pytest.mark.parametrize(
    ("control", "habit"),
    [
        *itertools.product(("guarded", "agent"), ("obeys", "ignores")),
        ("guarded", "misses"),
        pytest.param("agent", "misses", marks=pytest.mark.nightly),
    ],
)
def test_stop_of_the_driver_leaves_the_robot_at_rest(robot, control, habit):
    with moving(robot, control, habit) as (planner, agent):
        event = time.monotonic()
        agent.request("stop")
        jerks = JERKS if habit == "ignores" else 0.02
        rest(robot, f"{control}, planner {habit}: driver's stop", event, jerks=jerks)
        cancels = [each for each in planner.events(event) if "cancel" in each]
        assert len(cancels) >= (1 if habit == "obeys" else 3), "a lost cancel is repeated"
        if habit == "ignores":
            agent.wait_for(
                lambda each: any("cancel: " in error for error in each.get("errors", ())), event
            )


@pytest.mark.nightly
@pytest.mark.parametrize("control", ["guarded", "agent"])
def test_planner_that_resumes_after_a_stop_is_braked_again(robot, control):
    with moving(robot, control, "resumes") as (_, agent):
        event = time.monotonic()
        agent.request("stop")
        rest(robot, f"{control}, planner resumes: driver's stop", event, jerks=JERKS)


@pytest.mark.nightly
@pytest.mark.parametrize("away", [AWAY, None], ids=["4 s", "for good"])
def test_cut_link_leaves_a_robot_that_is_driven_through_the_agent_at_rest(tmp_path, away):
    prefix = ("ip", "netns", "exec")
    options = OPTIONS["agent"] | {"ip": THERE}
    with (
        namespace() as network,
        Ros1Processes(tmp_path, HERE) as robot,
        robot.planner("obeys", "/cmd_vel_nav") as planner,
        robot.agent(options, (*prefix, network.name)) as agent,
    ):
        agent.request(*REQUESTS["goto"])
        robot.drives(PLANNER)
        event = time.monotonic()
        network.pull()
        time.sleep(AWAY)
        if away is not None:
            network.plug()
        rest(robot, f"agent: link cut {'for good' if away is None else '4 s'}", event)
        if away is not None:
            planner.wait_for(lambda each: "ended" in each, event)
