"""The simulator's adapter: the conformance suite, its child process, and the death of either."""

import asyncio
import os
import signal
import time
from itertools import pairwise

import pytest

from robots.agent.adapters.registry import create
from robots.agent.adapters.simulator.adapter import SimulatorAdapter
from robots.agent.robot_interface import NOWHERE, Adapter, AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Config, Tilt, Velocity
from robots.simulator.physics.realtime import LONGEST_LAG
from tests.support.agents.simulators import alive, eventually, simulator
from tests.support.agents.truth import Onlooker
from tests.support.architectures.adapter_conformance import (
    AdapterConformance,
    drive,
    some,
    stands,
    wait_for,
)
from tests.support.architectures.rca_conformance import connected
from tests.support.host_jitter import pauses, watched
from tests.support.patience import patient

pytestmark = pytest.mark.usefixtures("patient_adapters")
QUIET = {"camera": "no", "start": "corridor-centre"}


def made(profile: str = "giraff", **options: object) -> SimulatorAdapter:
    adapter = create("simulator", profile, {**QUIET, **options})
    assert isinstance(adapter, SimulatorAdapter)
    return adapter


def has_failed(camera) -> bool:
    try:
        camera.read(0.5)
    except AdapterError as error:
        assert "camera" in str(error)
        return True
    return False


async def until(condition, seconds: float = 5.0) -> None:
    assert await asyncio.to_thread(eventually, condition, seconds)


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


async def test_closing_ends_the_simulator() -> None:
    adapter = made()
    await adapter.connect()
    pid = adapter._child.pid
    await drive(adapter, Velocity(linear=0.4, angular=0.0), lambda s: s.velocity.linear > 0.3)
    await adapter.close()
    assert not alive(pid)


async def test_killed_simulator_is_reported_and_replaced() -> None:
    async with connected(made()) as adapter:
        os.kill(adapter._child.pid, signal.SIGKILL)
        with pytest.raises(AdapterError, match="gone"):
            await wait_for(adapter, lambda s: False, 5.0)
        with pytest.raises(AdapterError):
            adapter.apply(Velocity(linear=0.1, angular=0.0))
        await adapter.connect()
        assert await some(adapter.states(), 3)


@pytest.mark.nightly
async def test_hung_simulator_is_reported() -> None:
    async with connected(made()) as adapter:
        await some(adapter.states(), 1)
        os.kill(adapter._child.pid, signal.SIGSTOP)
        try:
            with pytest.raises(AdapterError, match="has stopped sending data"):
                await wait_for(adapter, lambda s: False, 5.0)
        finally:
            os.kill(adapter._child.pid, signal.SIGCONT)


async def test_reconnection_reaches_the_same_simulator_at_its_pose() -> None:
    async with connected(made(linger="10")) as adapter:
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


async def test_simulator_at_an_address_keeps_running_after_the_adapter_closes() -> None:
    with simulator("--no-camera", "--start", "corridor-centre", "--profile", "rhodon") as robot:
        adapter = made("rhodon", address=robot.address)
        await adapter.connect()
        await drive(adapter, Velocity(linear=0.3, angular=0.0), lambda s: s.velocity.linear > 0.2)
        await adapter.close()
        onlooker = robot.onlooker()
        assert onlooker.truth().linear == 0.0
        assert robot.process.poll() is None


async def test_simulator_of_another_robot_is_refused() -> None:
    with (
        simulator("--no-camera", "--profile", "rhodon") as robot,
        pytest.raises(AdapterError, match="'rhodon', not 'giraff'"),
    ):
        await made(address=robot.address).connect()


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nonsense", "127.0.0.1:", ":5"])
async def test_address_without_a_simulator_is_refused(address: str) -> None:
    with pytest.raises(AdapterError, match=r"."):
        await made(address=address).connect()


async def test_unknown_start_is_refused_with_its_name() -> None:
    with pytest.raises(AdapterError, match="cannot start at 'moon'"):
        await made(start="moon").connect()


async def test_doors_configured_before_and_after_connecting_are_set() -> None:
    adapter = made()
    adapter.configure(Config(stamp=1.0, doors={"lab-door": "closed"}))
    async with connected(adapter):
        with Onlooker.of(adapter.address) as onlooker:
            await until(lambda: onlooker.truth().doors["lab-door"] == "closed")
            doors = {"lab-door": "open", "lounge-door": "closed"}
            adapter.configure(Config(stamp=2.0, doors=doors))
            await until(lambda: onlooker.truth().doors == doors)


async def test_agents_options_reach_the_simulator() -> None:
    options = {"plan": "clinic", "people": "2", "door-changes": "2", "start": "therapy-room"}
    async with connected(made(**options)) as adapter:
        with Onlooker.of(adapter.address) as onlooker:
            truth = onlooker.truth()
            assert len(truth.people) == 2
            assert (truth.x, truth.y) == (6.1, 5.6)
            rooms = ("waiting", "therapy", "consulting", "treatment", "connecting")
            assert set(truth.doors) == {f"{room}-door" for room in rooms}
            await until(lambda: "closed" in onlooker.truth().doors.values(), 10.0)


async def test_new_tilt_replaces_the_running_one_and_cancel_stops_it() -> None:
    async with connected(made()) as adapter:
        await some(adapter.states(), 1)
        await adapter.start(Tilt(action_id="a", stamp=0.0, angle=0.9))
        await adapter.start(Tilt(action_id="b", stamp=0.0, angle=-0.5))
        await wait_for(adapter, lambda s: s.tilt < 0.2)
        await adapter.start(Tilt(action_id="c", stamp=0.0, angle=0.9))
        # in the same moment: however late this computer is, the head has not arrived
        await adapter.cancel("c")
        where = adapter._truth.tilt
        news = []
        async with asyncio.timeout(patient(5.0)):
            async for progress in adapter.progress():
                news.append((progress.action_id, progress.status))
                if news[-1] == ("c", "CANCELLED"):
                    break
        assert news[:3] == [("a", "RUNNING"), ("a", "CANCELLED"), ("b", "RUNNING")]
        # finished if the head arrived before the third request
        assert news[3] in {("b", "CANCELLED"), ("b", "FINISHED")}
        assert news[4:] == [("c", "RUNNING"), ("c", "CANCELLED")]
        await wait_for(adapter, lambda s: abs(s.tilt - where) < 0.02)
        await some(adapter.states(), 30)
        assert (await some(adapter.states(), 1))[0].tilt == pytest.approx(where, abs=0.02)


async def test_scans_arrive_at_20_hz_and_match_the_walls() -> None:
    async with connected(made()) as adapter:
        scans = [state.scan for state in await some(adapter.states(), 60) if state.scan is not None]
        gaps = sorted(after.stamp - before.stamp for before, after in pairwise(scans))
        # most of them: a late process misses some
        assert gaps[len(gaps) // 2] == pytest.approx(0.05, abs=0.02)
        middle = max(value or 0.0 for value in scans[-1].ranges[118:123])
        # from the middle of the corridor to rhodon's station
        assert middle == pytest.approx(12.0 - 0.12 - 5.22, abs=0.1)
        assert len(scans[-1].ranges) == 241


async def test_readings_contain_odometry_and_no_true_pose() -> None:
    async with connected(made()) as adapter:
        first = (await some(adapter.states(), 1))[0]
        state = await drive(adapter, Velocity(linear=0.5, angular=0.2), lambda s: s.distance > 0.4)
        with Onlooker.of(adapter.address) as onlooker:
            before, after = onlooker.at(first.stamp), onlooker.at(state.stamp)
    assert abs(after.stamp - state.stamp) < 0.006
    begun, ended = (Pose2D(row.x, row.y, row.theta) for row in (before, after))
    counted = first.odometry.inverse().compose(state.odometry)
    assert counted.distance(begun.inverse().compose(ended)) < 0.1
    assert state.pose == NOWHERE
    assert state.clearance is None


async def test_velocity_reaches_the_wheels_within_milliseconds() -> None:
    async with connected(made()) as adapter:
        with Onlooker.of(adapter.address) as onlooker, watched() as computer:
            await some(adapter.states(), 5)
            applied_at = time.time()
            adapter.apply(Velocity(linear=0.3, angular=0.0))
            await until(lambda: onlooker.truth().commanded[0] == 0.3, 2.0)
            excuse = computer.excuse(applied_at, time.time())
            came = onlooker.truth().commanded_at
            rows = [
                row.stamp for row in onlooker.history(10.0) if applied_at - 1.0 < row.stamp <= came
            ]
        # median below a millisecond and a step on a quiet machine
        assert came - applied_at < 0.2 + excuse + LONGEST_LAG + min(pauses(rows, 0.02), 1.5)


@pytest.mark.nightly
async def test_frames_arrive_again_from_a_replaced_simulator() -> None:
    async with connected(create("simulator", "giraff", {"start": "corridor-centre"})) as adapter:
        camera = adapter.video()
        camera.start()
        await until(lambda: camera.read(1.0) is not None, 30.0)
        os.kill(adapter._child.pid, signal.SIGKILL)
        await until(lambda: has_failed(camera), 10.0)
        await adapter.connect()
        await until(lambda: camera.read(1.0) is not None, 30.0)


async def test_disabled_camera_is_not_a_capability() -> None:
    adapter = made()
    assert adapter.video() is None
    assert adapter.profile.camera is None
    assert "video" not in adapter.profile.capabilities


async def test_docked_robot_charges_at_rest() -> None:
    async with connected(made(start="dock")) as adapter:
        state = await wait_for(adapter, lambda s: s.charger_contact)
        assert stands(state)
        assert state.battery.charging
        assert state.battery.voltage > 25.0
