"""The simulated robot, moved by its driver or by our navigation, when agent, control thread,
navigation process or simulator hangs or dies: metres and seconds until it is at rest.

The agent is whole and a process of its own (ordered_agent.py); simulator and navigation are its
children. `pytest -s` prints the table; the cells marked nightly run in `make nightly`.
"""

import contextlib
import math
import os
import signal
import time
from itertools import pairwise

import pytest

from robots.world.robot_models import model_of
from tests.support.agents.agent_process import AgentProcess, wait
from tests.support.agents.truth import Onlooker
from tests.support.architectures.motion import REST, STEADY, assert_rest

GIRAFF = model_of("giraff")
OPTIONS = {"camera": "no", "start": "6.0,1.0,3.1", "seed": "3", "linger": "20"}
AWAY, WATCHED = 4.0, 3.0  # s
LATE = 0.3  # s after which our navigation's last velocity no longer counts
ROWS = {"driven": ("drive",), "navigating": ("goto", "1.2", "1.0"), "docking": ("dock",)}
COLUMNS = (
    "agent killed",
    "agent stopped",
    "control hung",
    "simulator hung",
    "navigation killed",
    "navigation hung",
)
QUICK = {("driven", "agent killed"), ("driven", "control hung"), ("docking", "navigation killed")}


@contextlib.contextmanager
def moving(row, directory):
    agent = AgentProcess(
        "ordered_agent",
        adapter="simulator",
        profile="giraff",
        options=OPTIONS,
        directory=str(directory),
        plan="office",
    )
    found = agent.wait_for(lambda event: "port" in event)
    onlooker = Onlooker.of(found["port"])
    try:
        agent.request(*ROWS[row])
        wait(lambda: onlooker.truth().linear > 0.2, 20.0)
        yield agent, onlooker, found["pids"]
    finally:
        for pid in found["pids"]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
        agent.kill()
        onlooker.close()


def since(onlooker, event):
    """Return metres and seconds from an event (Unix time) to rest, and metres afterwards."""
    rows = [row for row in onlooker.history(30.0) if row.stamp >= event]
    moves = [abs(row.linear) > REST or abs(row.angular) > REST for row in rows]
    at_rest = next(
        index
        for index, moving in enumerate(moves)
        if not moving and not any(moves[index:][:STEADY])
    )
    steps = [
        math.dist((before.x, before.y), (after.x, after.y)) for before, after in pairwise(rows)
    ]
    return sum(steps[:at_rest]), rows[at_rest].stamp - event, sum(steps[at_rest:])


def within(column):
    """Return the seconds from the event until the robot is at rest, on an idle computer."""
    braking = GIRAFF.limits.linear / GIRAFF.limits.linear_braking
    silence = {"simulator": AWAY + GIRAFF.watchdog, "navigation": LATE}
    return silence.get(column.split()[0], GIRAFF.watchdog) + braking


def end(pid, how, agent):
    """Kill a process, or stop it for a while."""
    os.kill(pid, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
    if how != "killed":
        time.sleep(AWAY)
        agent.request("idle")
        with contextlib.suppress(ProcessLookupError):  # the agent has replaced it
            os.kill(pid, signal.SIGCONT)


@pytest.mark.parametrize(
    ("row", "column"),
    [
        pytest.param(row, column, marks=() if (row, column) in QUICK else pytest.mark.nightly)
        for row in ROWS
        for column in COLUMNS
        if row != "driven" or "navigation" not in column
    ],
)
def test_robot_comes_to_rest(row, column, tmp_path):
    with moving(row, tmp_path) as (agent, onlooker, (simulator, navigation)):
        who, how = column.split()
        event, began = time.time(), time.monotonic()
        if who == "control":
            agent.request("hang")
            time.sleep(AWAY / 2)  # the driver still drives: orders that are stale when it resumes
            agent.request("idle")
            time.sleep(AWAY / 2)
        else:
            pids = {"agent": agent.process.pid, "simulator": simulator, "navigation": navigation}
            end(pids[who], how, agent)
        time.sleep(within(column) + WATCHED)
        metres, seconds, later = since(onlooker, event)
        label = f"simulator, {row}: {column}"
        assert_rest(label, (metres, seconds, later), within(column), said=agent.reported())
        assert metres <= GIRAFF.limits.linear * within(column)
        if who == "navigation":
            ended = agent.wait_for(lambda each: each.get("status") == "FAILED", since=began)
            assert "navigation" in ended["reason"]
