"""The control loop in its thread: latency, deadline and priority."""

import asyncio
import sys
import threading

import pytest

from robots.agent.ramp import ZERO
from robots.agent.thread_priority import nice, set_nice
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.host_jitter import watched


@pytest.fixture
def rig(tmp_path):
    with ThreadedControlRig(tmp_path) as rig:
        yield rig


def test_command_is_applied_before_the_next_tick(rig):
    rig.grant()
    delays = []
    for _ in range(30):
        before = rig.now()
        rig.push(0.3)
        rig.wait(lambda at=before: rig.robot.velocities(at))
        delays.append(rig.robot.velocities(before)[0][0] - before)
        rig.sleep(0.013)
    assert sorted(delays)[len(delays) // 2] < 0.01


def test_base_is_stopped_within_350_ms_of_the_last_accepted_command(rig):
    rig.grant()
    gaps = []
    with watched() as computer:
        for _ in range(5):
            began = rig.unix()
            rig.drive(0.5)
            rig.push(0.5)
            rig.wait(lambda: any(v.linear < 0.49 for _, v in rig.robot.velocities()[-3:]))
            rig.wait(lambda: rig.robot.told == ZERO)
            accepted = max(rig.kernel._accepted_at, 0.0)
            first_slower = next(at for at, v in rig.robot.velocities(accepted) if v.linear < 0.49)
            gaps.append((first_slower - accepted, computer.excuse(began, rig.unix())))
    assert all(gap <= 0.35 + late for gap, late in gaps), gaps
    assert min(gap for gap, _ in gaps) >= 0.29, gaps


@pytest.mark.skipif(
    not sys.platform.startswith("linux"),
    reason="only Linux gives each thread a priority of its own",
)
def test_only_the_control_thread_has_a_higher_priority(rig):
    seen = {}

    async def look():
        seen["loop"] = nice()
        seen["beside"] = await asyncio.to_thread(nice)

    ordinary = nice()
    asyncio.run_coroutine_threadsafe(look(), rig.control._calls.loop).result(5.0)
    assert seen["beside"] == ordinary
    assert seen["loop"] == (ordinary - 10 if can_raise_priority() else ordinary)


def can_raise_priority():
    allowed = []
    thread = threading.Thread(target=lambda: allowed.append(set_nice(-10)))
    thread.start()
    thread.join()
    return allowed[0]


def test_loop_that_is_closed_has_not_failed(tmp_path):
    with ThreadedControlRig(tmp_path) as rig:
        assert rig.control.failed, "a running loop counts as failed until it has ended"
    assert not rig.control.failed
    assert rig.robot.closed
