"""OpenMORA, over MOOS and over MQTT, in every way in which the agent, its control thread, its link,
the robot or a cancel can be lost: metres and seconds until the robot is at rest, and what the
agent's state says.

The agent is whole and a process of its own (ordered_agent.py), the MOOSDB a double or, with
MOOSDB_PROGRAM=/path/to/MOOSDB, a real one; the broker is Mosquitto. The robot drives with 0.25 m/s
for its driver and 0.5 m/s by itself, and brakes with 0.8 m/s². Its base has a watchdog of 0.5 s
with MOOS; OpenMORA's MQTT module ends a motion after 0.5 s, but may look for that as late as a
second after the last message. RobotControlManager, the guard, waits 0.5 s (MOOS, as the profile
asks for) or 2 s (MQTT, as shipped) for an acknowledgement. `pytest -s` prints the table; the cells
marked nightly run in `make nightly`.
"""

import contextlib
import signal
import sys
import threading
import time
from dataclasses import dataclass

import pytest

from tests.support.agents.agent_process import AgentProcess, wait
from tests.support.agents.orders import caught_at_most_one
from tests.support.architectures.moos_robot import MoosRig
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.patience import patient
from tests.support.programs.namespace import HERE, namespace

AWAY = 4.0  # s
WATCHED = 3.0  # s that the robot is watched after it should be at rest
BRAKING = 0.5 / 0.8  # s from its own navigation's speed to a standstill
# m/s and rad/s: by which a robot at rest may still turn or roll in a sample
REST = 1e-3
STEP = 0.01  # s between two samples
JERK = 0.12  # m that a planner which resumes may move the robot until it is cancelled again


@dataclass(frozen=True)
class Architecture:
    """How to make its robot, and after how many seconds its guard and its watchdog stop it."""

    make: object
    guard: float
    watchdog: float


ARCHITECTURES = {
    "moos": Architecture(lambda _, host: MoosRig("giraff", listening=host), 0.5, 0.5),
    "openmora_mqtt": Architecture(
        lambda directory, host: OpenMoraRig(directory, host=host), 2.0, 1.0
    ),
}
ROWS = ("idle", "driven", "navigating", "docking")
START = {"docking": "1.9,6.3,3.14159", "navigating": "4.0,1.0,0.0"}
FAST = {"driven": 0.24, "navigating": 0.45, "docking": 0.19}  # m/s: near its speed


class Motion:
    """Samples in a thread how far the robot has moved since an event, and when it moved last."""

    def __init__(self, world):
        self.world, self.began, self.samples = world, time.monotonic(), []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self):
        last = self.world.truth
        while not self._over.wait(STEP):
            now, motion = self.world.truth, self.world.sim.motion
            moves = abs(motion.linear) > REST or abs(motion.angular) > REST
            self.samples.append((time.monotonic() - self.began, last.distance(now), moves))
            last = now

    def until_rest(self, within):
        """Return metres and seconds until the robot was at rest, and metres afterwards."""
        time.sleep(within + WATCHED)
        self._over.set()
        self._thread.join()
        at_rest = next(
            (
                at
                for index, (at, _, moves) in enumerate(self.samples)
                if not moves and not any(each[2] for each in self.samples[index : index + 20])
            ),
            float("inf"),
        )
        before = sum(step for at, step, _ in self.samples if at <= at_rest)
        return before, at_rest, sum(step for at, step, _ in self.samples if at > at_rest)


@contextlib.contextmanager
def robot(name, row, directory, *, network=None, **world):
    """A robot in the state of its row, and the agent that brought it there."""
    host = HERE if network else "127.0.0.1"
    with ARCHITECTURES[name].make(directory, host) as rca:
        rca.world.watchdog = 0.5
        rca.ack_interval = ARCHITECTURES[name].guard
        rca.reset(START.get(row))
        for key, value in world.items():
            setattr(rca.world, key, value)
        prefix = ("ip", "netns", "exec", network.name) if network else ()
        agent = AgentProcess(rca.adapter_name, rca.profile, rca.options(), directory, prefix=prefix)
        try:
            begin(row, rca, agent)
            if row != "idle" and not world:
                wait(lambda: rca.world.sim.motion.linear > FAST[row])
            yield rca, agent
        finally:
            agent.end()
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
    """Seconds from the loss of the agent to standstill, on a computer with nothing else to do."""
    architecture = ARCHITECTURES[name]
    own = {"driven": architecture.watchdog, "idle": 0.0}
    return own.get(row, architecture.guard + 0.2) + BRAKING


def assert_rest(label, found, within, jerk=0.03, said=""):
    metres, seconds, later = found
    sys.stdout.write(
        f"\n{label:58} {metres:5.2f} m  at rest after {seconds:5.2f} s, then {later:5.3f} m  {said}"
    )
    assert seconds <= patient(within)
    assert metres <= 0.55 * patient(within)
    assert later <= jerk


def cells(quick, columns):
    """All cells of rows and columns; those that are not `quick` run nightly."""
    return [
        pytest.param(
            name,
            row,
            column,
            marks=() if (row, column) in quick else pytest.mark.nightly,
            id=f"{name}-{row}-{column}",
        )
        for name in ARCHITECTURES
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
        else:
            agent.signal(signal.SIGKILL if column == "killed" else signal.SIGSTOP)
        if column == "stopped":
            time.sleep(AWAY)
            agent.request("idle")
            agent.signal(signal.SIGCONT)
        found = motion.until_rest(within)
        part = "control thread" if column == "hung" else "agent"
        assert_rest(f"{name}, {row}: {part} {column}", found, within, said=agent.said())


@pytest.mark.nightly
@pytest.mark.parametrize("away", [AWAY, None], ids=["4 s", "for good"])
@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("name", ARCHITECTURES)
def test_robot_comes_to_rest_when_the_link_is_cut(name, row, away, tmp_path):
    with namespace() as network, robot(name, row, tmp_path, network=network) as (rca, agent):
        motion = Motion(rca.world)
        network.pull()
        agent.request("idle")
        if away:
            time.sleep(away)
            network.plug()
        found = motion.until_rest(bound(name, row))
        agent.wait_for(
            lambda each: any("adapter_lost" in text for text in each.get("errors", ())),
            since=motion.began,
        )
        label = f"{name}, {row}: link cut {'4 s' if away else 'for good'}"
        assert_rest(label, found, bound(name, row), said=agent.said())


@pytest.mark.parametrize(
    ("name", "row", "column"),
    cells({("driven", "robot")}, ("middleman", "robot")),
)
def test_robot_comes_to_rest_when_it_or_its_middleman_hangs(name, row, column, tmp_path):
    """The middleman is the MOOSDB or the broker; the robot hangs behind one that goes on."""
    with robot(name, row, tmp_path) as (rca, agent):
        hang = rca.freeze if column == "middleman" else rca.hang
        motion = Motion(rca.world)
        hang(on=True)
        time.sleep(AWAY)
        agent.request("idle")
        thawed = time.monotonic()
        hang(on=False)
        found = motion.until_rest(bound(name, row))
        late = [at for at, linear, _ in rca.world.commands if at > thawed and linear]
        label = f"{name}, {row}: {column} hung 4 s, {len(late)} late"
        assert_rest(label, found, AWAY + 1.0, said=agent.said())
        assert caught_at_most_one(late, rca.world.commands)


@pytest.mark.parametrize(
    ("name", "row", "column"),
    [
        each
        for each in cells(
            {("navigating", "is lost"), ("navigating", "resumes")},
            ("is lost", "is ignored", "resumes"),
        )
        if each.values[1] in {"navigating", "docking"}
    ],
)
def test_a_stop_holds_although_a_cancel_is_not_obeyed(name, row, column, tmp_path):
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
        found = motion.until_rest(1.0 + BRAKING)
        label = f"{name}, {row}: stop, {'planner' if column == 'resumes' else 'cancel'} {column}"
        assert_rest(label, found, 1.0 + BRAKING, jerk, agent.said())
        if column == "is ignored":
            agent.wait_for(
                lambda each: any("has not confirmed" in text for text in each.get("errors", ()))
            )
            assert not any(each.get("status") == "CANCELLED" for each in agent.events)
        else:
            agent.wait_for(lambda each: each.get("status") == "CANCELLED")


@pytest.mark.nightly
@pytest.mark.parametrize("row", ["navigating", "docking"])
@pytest.mark.parametrize("name", ARCHITECTURES)
def test_a_stop_holds_although_the_goal_is_accepted_after_it(name, row, tmp_path):
    with robot(name, row, tmp_path, accept_after=6.0) as (rca, agent):
        agent.wait_for(lambda each: each.get("status") == "RUNNING")
        time.sleep(1.0)
        motion = Motion(rca.world)
        agent.request("stop")
        found = motion.until_rest(6.0)
        label = f"{name}, {row}: stop, goal accepted after 6 s"
        assert_rest(label, found, 0.5, said=agent.said())
        agent.wait_for(lambda each: each.get("status") == "CANCELLED")
