"""The watchdog of a simulated base stops it when the control loop is stuck."""

import time

import pytest

from robots.agent.adapters.simulator.adapter import create
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.agents.truth import Onlooker
from tests.support.host_jitter import pauses, watched

WATCHDOG = 0.3  # s, the simulated base's own
STEP = 0.02  # s, the simulator's step and the agent's tick
LOADED = 0.1  # s by which a busy machine may delay a velocity that was sent before the loop hung
BRAKING = 0.8  # m/s²


@pytest.fixture
def robot():
    return create("giraff", {"start": "corridor-centre", "camera": "no"})


def test_base_stops_by_itself_when_the_loop_is_blocked_for_two_seconds(tmp_path, robot):
    blocked = []

    def block():
        blocked.append(time.time())
        time.sleep(2.0)

    with watched() as computer, ThreadedControlRig(tmp_path, robot=robot) as rig:
        truth = Onlooker(int(robot.address.rpartition(":")[2]))
        rig.grant()
        rig.drive(0.4, until=lambda: truth.truth().linear > 0.39, within=15)
        rig.control._calls.loop.call_soon_threadsafe(block)
        rig.wait(lambda: blocked)
        (blocked_at,) = blocked
        rig.wait(lambda: time.time() > blocked_at + 1.0)
        for _ in range(20):
            rig.push(0.4)  # they are stale when the loop resumes
        rig.wait(lambda: time.time() > blocked_at + 1.9)
        history = [row for row in truth.history(5) if row.stamp > blocked_at]
        brakes = next(row for row in history if row.linear < 0.38)
        stands = next(row for row in history if abs(row.linear) < 1e-3)
        late = computer.excuse(blocked_at, stands.stamp) + min(
            pauses((row.stamp for row in history), STEP), 1.5
        )
        assert brakes.stamp - blocked_at <= WATCHDOG + 2 * STEP + LOADED + late
        assert stands.stamp - brakes.stamp <= 0.4 / BRAKING + 2 * STEP + late
        rig.link.wait("state", lambda s: s.refused.get("stale"), within=10)
        rig.wait(lambda: time.time() > blocked_at + 3.0)
        assert all(abs(row.linear) < 1e-3 for row in truth.history(1.0)), (
            "stale commands moved the robot"
        )
        truth.close()
