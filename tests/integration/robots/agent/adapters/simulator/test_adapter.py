"""The simulator's adapter: the conformance suite, its own process, and what happens when one of the
two dies.
"""

import asyncio
import os
import signal
import time
from itertools import pairwise

import pytest

from robots.agent.adapters.registry import create
from robots.agent.adapters.simulator.adapter import SimulatorAdapter
from robots.agent.robot_interface import NOWHERE, Adapter, AdapterError, VideoSource
from robots.agent.simulator.physics.realtime import LONGEST_LAG
from robots.api.geometry import Pose2D
from robots.api.messages import Config, Tilt, Velocity
from tests.support.agents.simulators import alive, eventually, simulator
from tests.support.agents.truth import Onlooker
from tests.support.architectures.adapter_conformance import (
    AdapterConformance,
    drive,
    some,
    stands,
    wait_for,
)
from tests.support.host_jitter import pauses, watched
from tests.support.patience import patient

pytestmark = pytest.mark.usefixtures("patient_adapters")
QUIET = {"camera": "no", "start": "corridor-centre"}


def made(profile: str = "giraff", **options: object) -> SimulatorAdapter:
    adapter = create("simulator", profile, {**QUIET, **options})
    assert isinstance(adapter, SimulatorAdapter)
    return adapter


def onlooker_of(adapter: SimulatorAdapter) -> Onlooker:
    return Onlooker(int(adapter.address.rpartition(":")[2]))


def is_gone(camera: VideoSource) -> bool:
    try:
        camera.read(0.5)
    except AdapterError as error:
        assert "camera" in str(error)
        return True
    return False


class SimulatorConformance(AdapterConformance):
    def obeyed_at(self, adapter: Adapter) -> float:
        assert isinstance(adapter, SimulatorAdapter)
        return adapter._truth.commanded_at if adapter._truth else 0.0


class TestGiraff(SimulatorConformance):
    def make(self) -> Adapter:
        return create("simulator", "giraff", {"start": "corridor-centre", "seed": "3"})


class TestRhodon(SimulatorConformance):
    def make(self) -> Adapter:
        return create("simulator", "rhodon", {"start": "corridor-centre", "camera": "no"})


async def test_it_brakes_before_it_leaves_and_takes_its_child_along() -> None:
    adapter = made()
    await adapter.connect()
    pid = adapter._child.pid
    await drive(adapter, Velocity(linear=0.4, angular=0.0), lambda s: s.velocity.linear > 0.3)
    await adapter.close()
    assert not alive(pid)


async def test_a_simulator_that_is_killed_is_noticed_and_replaced() -> None:
    adapter = made()
    await adapter.connect()
    os.kill(adapter._child.pid, signal.SIGKILL)
    with pytest.raises(AdapterError, match="gone"):
        await wait_for(adapter, lambda s: False, 5.0)
    with pytest.raises(AdapterError):
        adapter.apply(Velocity(linear=0.1, angular=0.0))
    await adapter.connect()
    assert await some(adapter.states(), 3)
    await adapter.close()


@pytest.mark.nightly
async def test_a_simulator_that_hangs_is_called_silent() -> None:
    adapter = made()
    await adapter.connect()
    await some(adapter.states(), 1)
    os.kill(adapter._child.pid, signal.SIGSTOP)
    try:
        with pytest.raises(AdapterError, match="has stopped sending data"):
            await wait_for(adapter, lambda s: False, 5.0)
    finally:
        os.kill(adapter._child.pid, signal.SIGCONT)
        await adapter.close()


async def test_a_lost_connection_is_made_again_to_the_same_robot_in_the_same_place() -> None:
    adapter = made(linger="10")
    await adapter.connect()
    pid = adapter._child.pid
    before = (await some(adapter.states(), 1))[0]
    moved = await drive(adapter, Velocity(linear=0.4, angular=0.0), lambda s: s.distance > 0.3)
    adapter._writer.transport.abort()
    with pytest.raises(AdapterError):
        await wait_for(adapter, lambda s: False, 5.0)
    await adapter.connect()
    again = (await some(adapter.states(), 1))[0]
    assert adapter._child.pid == pid
    assert again.odometry.distance(moved.odometry) < 0.5
    assert again.odometry.distance(before.odometry) > 0.2
    await adapter.close()


async def test_a_robot_at_an_address_is_found_and_left_running() -> None:
    with simulator("--no-camera", "--start", "corridor-centre", "--profile", "rhodon") as robot:
        adapter = made("rhodon", address=robot.address)
        await adapter.connect()
        await drive(adapter, Velocity(linear=0.3, angular=0.0), lambda s: s.velocity.linear > 0.2)
        await adapter.close()
        onlooker = robot.onlooker()
        assert onlooker.truth().linear == 0.0
        assert robot.process.poll() is None
        onlooker.close()


async def test_another_robot_at_the_address_is_refused() -> None:
    with (
        simulator("--no-camera", "--profile", "rhodon") as robot,
        pytest.raises(AdapterError, match="'rhodon', not 'giraff'"),
    ):
        await made(address=robot.address).connect()


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nonsense", "127.0.0.1:", ":5"])
async def test_an_address_where_nobody_is_gives_a_sentence(address: str) -> None:
    with pytest.raises(AdapterError, match=r"."):
        await made(address=address).connect()


async def test_a_robot_that_cannot_start_gives_a_sentence() -> None:
    with pytest.raises(AdapterError, match="cannot start at 'moon'"):
        await made(start="moon").connect()


async def test_doors_said_before_the_connection_are_said_on_it_and_again_on_the_next() -> None:
    adapter = made()
    adapter.configure(Config(stamp=1.0, doors={"lab-door": "closed"}))
    await adapter.connect()
    onlooker = onlooker_of(adapter)
    assert await asyncio.to_thread(
        eventually, lambda: onlooker.truth().doors["lab-door"] == "closed", 5.0
    )
    adapter.configure(Config(stamp=2.0, doors={"lab-door": "open", "lounge-door": "closed"}))
    assert await asyncio.to_thread(
        eventually,
        lambda: onlooker.truth().doors == {"lab-door": "open", "lounge-door": "closed"},
        5.0,
    )
    onlooker.close()
    await adapter.close()


async def test_a_new_tilt_replaces_the_one_under_way_and_cancel_stops_it() -> None:
    adapter = made()
    await adapter.connect()
    await some(adapter.states(), 1)
    await adapter.start(Tilt(action_id="a", stamp=0.0, angle=0.9))
    await adapter.start(Tilt(action_id="b", stamp=0.0, angle=-0.5))
    await wait_for(adapter, lambda s: s.tilt < 0.2)
    await adapter.start(Tilt(action_id="c", stamp=0.0, angle=0.9))
    await adapter.cancel("c")  # in the same moment: however late this is, the head is not there yet
    where = adapter._truth.tilt
    news = []
    async with asyncio.timeout(patient(5.0)):
        async for progress in adapter.progress():
            news.append((progress.action_id, progress.status))
            if news[-1] == ("c", "CANCELLED"):
                break
    assert news[:3] == [("a", "RUNNING"), ("a", "CANCELLED"), ("b", "RUNNING")]
    # the latter when it was there before the third
    assert news[3] in {("b", "CANCELLED"), ("b", "FINISHED")}
    assert news[4:] == [("c", "RUNNING"), ("c", "CANCELLED")]
    await wait_for(adapter, lambda s: abs(s.tilt - where) < 0.02)
    await some(adapter.states(), 30)
    assert (await some(adapter.states(), 1))[0].tilt == pytest.approx(where, abs=0.02)
    await adapter.close()


async def test_scans_come_twenty_times_a_second_and_agree_with_the_walls() -> None:
    adapter = made()
    await adapter.connect()
    scans = [state.scan for state in await some(adapter.states(), 60) if state.scan is not None]
    gaps = sorted(after.stamp - before.stamp for before, after in pairwise(scans))
    # most of them: a late process misses some
    assert gaps[len(gaps) // 2] == pytest.approx(0.05, abs=0.02)
    middle = max(value or 0.0 for value in scans[-1].ranges[118:123])
    # from the middle of the corridor to rhodon's station
    assert middle == pytest.approx(12.0 - 0.12 - 5.22, abs=0.1)
    assert len(scans[-1].ranges) == 241
    await adapter.close()


async def test_it_tells_its_odometry_and_never_where_it_really_is() -> None:
    adapter = made()
    await adapter.connect()
    onlooker = onlooker_of(adapter)
    first = (await some(adapter.states(), 1))[0]
    state = await drive(adapter, Velocity(linear=0.5, angular=0.2), lambda s: s.distance > 0.4)
    before, after = await asyncio.to_thread(
        lambda: (onlooker.at(first.stamp), onlooker.at(state.stamp))
    )
    assert abs(after.stamp - state.stamp) < 0.006
    really = (
        Pose2D(before.x, before.y, before.theta)
        .inverse()
        .compose(Pose2D(after.x, after.y, after.theta))
    )
    counted = first.odometry.inverse().compose(state.odometry)
    assert counted.distance(really) < 0.1
    assert state.pose == NOWHERE
    assert state.clearance is None
    onlooker.close()
    await adapter.close()


async def test_a_command_is_with_the_wheels_in_milliseconds() -> None:
    adapter = made()
    await adapter.connect()
    onlooker = onlooker_of(adapter)
    with watched() as computer:
        await some(adapter.states(), 5)
        said = time.time()
        adapter.apply(Velocity(linear=0.3, angular=0.0))
        assert await asyncio.to_thread(
            eventually, lambda: onlooker.truth().commanded[0] == 0.3, 2.0
        )
        excuse = computer.excuse(said, time.time())
    came = onlooker.truth().commanded_at
    excuse += LONGEST_LAG + min(
        pauses(
            (row.stamp for row in onlooker.history(10.0) if said - 1.0 < row.stamp <= came), 0.02
        ),
        1.5,
    )
    assert came - said < 0.2 + excuse  # median below a millisecond and a step on a quiet machine
    onlooker.close()
    await adapter.close()


@pytest.mark.nightly
async def test_pictures_come_again_from_a_simulator_that_was_replaced() -> None:
    adapter = create("simulator", "giraff", {"start": "corridor-centre"})
    await adapter.connect()
    camera = adapter.video()
    camera.start()
    assert await asyncio.to_thread(eventually, lambda: camera.read(1.0) is not None, 30.0)
    os.kill(adapter._child.pid, signal.SIGKILL)
    assert await asyncio.to_thread(eventually, lambda: is_gone(camera), 10.0)
    await adapter.connect()
    assert await asyncio.to_thread(eventually, lambda: camera.read(1.0) is not None, 30.0)
    await adapter.close()


async def test_a_robot_without_a_camera_has_none() -> None:
    adapter = made()
    assert adapter.video() is None
    assert adapter.profile.camera is None
    assert "video" not in adapter.profile.capabilities


async def test_standing_it_stands_until_the_end() -> None:
    adapter = made(start="dock")
    await adapter.connect()
    state = await wait_for(adapter, lambda s: s.charger_contact)
    assert stands(state)
    assert state.battery.charging
    assert state.battery.voltage > 25.0
    await adapter.close()
