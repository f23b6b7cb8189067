"""The control loop in its thread: latency, delays, and the end of a stuck thread."""

import asyncio
import sys
import threading
import time

import pytest

from robots.agent.ramp import ZERO
from robots.agent.thread_priority import nice, set_nice
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.agents.scripted_robot import WATCHDOG
from tests.support.host_jitter import watched


@pytest.fixture
def rig(tmp_path):
    with ThreadedControlRig(tmp_path) as rig:
        yield rig


def test_a_command_is_applied_sooner_than_the_next_tick(rig):
    rig.grant()
    delays = []
    for _ in range(30):
        before = rig.now()
        rig.push(0.3)
        rig.wait(lambda at=before: rig.robot.velocities(at))
        delays.append(rig.robot.velocities(before)[0][0] - before)
        rig.sleep(0.013)
    assert sorted(delays)[len(delays) // 2] < 0.01


def test_the_base_is_told_to_stop_within_350_ms_of_the_last_accepted_command(rig):
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


def test_a_loop_that_is_blocked_is_stopped_by_the_watchdog_and_does_not_start_the_base_again(rig):
    rig.grant()
    rig.drive(0.5)
    blocked = []

    def block():
        blocked.append(rig.now())
        time.sleep(2.0)

    rig.post(block)
    rig.wait(lambda: blocked)
    (blocked_at,) = blocked
    rig.wait(lambda: rig.now() > blocked_at + 1.0)
    assert rig.robot.base_at(rig.now()) == ZERO, "the watchdog of the base is what stops it"
    for _ in range(20):
        rig.push(0.5)
    rig.wait(lambda: rig.robot.velocities(blocked_at + 1.5) and rig.robot.told == ZERO)
    after = [v.linear for _, v in rig.robot.velocities(blocked_at + 0.5)]
    assert rig.robot.base_at(blocked_at + WATCHDOG + 0.3) == ZERO
    assert max(after) < 0.5 - 1e-6, (
        "commands that waited are stale and nothing goes on from the old speed"
    )


@pytest.mark.skipif(
    not sys.platform.startswith("linux"),
    reason="only Linux gives each thread a priority of its own",
)
def test_the_control_thread_goes_first_and_what_it_starts_beside_does_not(rig):
    seen = {}

    async def look():
        seen["loop"] = nice()
        seen["beside"] = await asyncio.to_thread(nice)

    ordinary = nice()
    asyncio.run_coroutine_threadsafe(look(), rig.control._calls.loop).result(5.0)
    assert seen["beside"] == ordinary
    assert seen["loop"] == (ordinary - 10 if may_go_first() else ordinary)


def may_go_first():
    allowed = []
    thread = threading.Thread(target=lambda: allowed.append(set_nice(-10)))
    thread.start()
    thread.join()
    return allowed[0]


def test_a_loop_that_was_asked_to_end_has_not_failed(tmp_path):
    with ThreadedControlRig(tmp_path) as rig:
        assert rig.control.failed, "it has not ended well yet"
    assert not rig.control.failed
    assert rig.robot.closed
