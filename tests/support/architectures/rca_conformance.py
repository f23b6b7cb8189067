"""What every adapter of a robot control architecture (RCA) must do besides `AdapterConformance`,
with the same simulated robot behind each protocol. A test module subclasses `RcaConformance` and
makes a rig (tests/support/architectures/rca_world.py).
"""

import asyncio
import contextlib
import itertools
import math
import time
from abc import abstractmethod
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest

from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.moos import openmora_adapter
from robots.agent.adapters.ros import base
from robots.agent.robot_interface import ActionRefusedError, Adapter, AdapterError, RcaState
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Dock, Goto, Relocalize, Undock, Velocity
from tests.support.architectures.adapter_conformance import (
    AdapterConformance,
    drive,
    some,
    stands,
    wait_for,
)
from tests.support.architectures.rca_world import BEFORE_DOCK, RcaRig
from tests.support.host_jitter import HostJitter
from tests.support.patience import patient

AHEAD = Velocity(linear=0.25, angular=0.0)
CANCEL_INTERVAL = 0.5  # s between two cancels of the agent
LATE = 1.5  # s until a goal is accepted


async def heard(adapter: Adapter, until, seconds: float = 10.0):
    """Return the progress until a condition holds, while states are read as the agent does."""

    async def reading():
        async for _ in adapter.states():
            pass

    states = asyncio.ensure_future(reading())
    found = []
    try:
        async with asyncio.timeout(patient(seconds)):
            async for news in adapter.progress():
                found.append(news)
                if until(news):
                    return found
    finally:
        states.cancel()
        await asyncio.gather(states, return_exceptions=True)
    raise AssertionError(f"progress ended: {found}")


async def cancelled(adapter: Adapter, action_id: str, seconds: float = 15.0) -> int:
    """Cancel an action as often as the agent does, until its end is confirmed; return how often."""
    async with asyncio.timeout(patient(seconds)):
        for count in itertools.count(1):
            if await adapter.cancel(action_id):
                return count
            await asyncio.sleep(CANCEL_INTERVAL)
    raise AssertionError


async def stays(rig: RcaRig, seconds: float) -> None:
    """Assert for some seconds that a robot does not move."""
    place = rig.world.truth
    for _ in range(round(seconds / 0.05)):
        await asyncio.sleep(0.05)
        assert rig.world.truth.distance(place) < 0.03


def ended(action_id):
    return lambda news: (
        news.action_id == action_id and news.status in {"FINISHED", "FAILED", "CANCELLED"}
    )


async def lost(adapter: Adapter, velocity: Velocity, seconds: float = 8.0) -> str:
    """Drive until the adapter has lost the RCA; return the text of its error."""
    with pytest.raises(AdapterError) as caught:
        await drive(adapter, velocity, lambda _: False, seconds)
    return str(caught.value)


@asynccontextmanager
async def connected(adapter: Adapter):
    await adapter.connect()
    try:
        yield adapter
    finally:
        await adapter.close()


class RcaConformance(AdapterConformance):
    rig: RcaRig

    @abstractmethod
    def make_rig(self, directory) -> RcaRig:
        """Return the rig, not started."""

    @pytest.fixture(scope="class")
    def shared_rig(self, tmp_path_factory) -> Iterator[RcaRig]:
        with self.make_rig(tmp_path_factory.mktemp("rca")) as rig:
            yield rig

    @pytest.fixture(autouse=True)
    def _fresh(self, shared_rig) -> Iterator[None]:
        self.rig = shared_rig
        shared_rig.reset()
        yield
        shared_rig.revive()
        assert not shared_rig.errors

    def make(self) -> Adapter:
        return self.rig.adapter()

    def obeyed_at(self, adapter: Adapter) -> float:
        moves = [at for at, linear, angular in self.rig.world.commands if linear or angular]
        return moves[-1] + time.time() - time.monotonic() if moves else 0.0

    def error_of(self, state: RcaState) -> tuple[float, float]:
        """Return the error of a state's odometry, or else of its pose: metres and radians."""
        measured = position(state)
        true = self.rig.world.truth if state.odometry is None else self.rig.world.sim.odometry
        return measured.distance(true), abs(wrap_angle(measured.theta - true.theta))

    async def here(self, adapter: Adapter) -> RcaState:
        """Return a state of the present position: earlier ones, stored or in transit, may be from
        before the robot was placed.
        """
        return await wait_for(adapter, lambda s: max(self.error_of(s)) < 0.02)

    @pytest.fixture
    async def near_dock(self) -> AsyncIterator[Adapter]:
        self.rig.reset(BEFORE_DOCK[self.rig.world.series])
        async with connected(self.make()) as adapter:
            yield adapter

    async def test_measured_motion_matches_the_robots_motion(self, adapter: Adapter) -> None:
        before, began = self.rig.world.truth, await self.here(adapter)

        # The watchdog brakes a robot whose velocities are late, and it accelerates again.
        def moves_as_commanded(state: RcaState) -> bool:
            return (
                state.distance > 0.17
                and abs(state.velocity.linear - 0.2) < 0.06
                and abs(state.velocity.angular - 0.2) < 0.08
            )

        await drive(adapter, Velocity(linear=0.2, angular=0.2), moves_as_commanded)
        await drive(adapter, Velocity(linear=0.0, angular=0.0), stands)
        await standing(self.rig)
        moved = before.inverse().compose(self.rig.world.truth)
        measured = position(began).inverse().compose(position(await self.here(adapter)))
        assert measured.distance(moved) < 0.12
        assert abs(wrap_angle(measured.theta - moved.theta)) < 0.15

    async def test_pose_is_that_of_the_architectures_localization(self, adapter: Adapter) -> None:
        if "localization" not in adapter.profile.capabilities:
            assert not (await some(adapter.states(), 1))[0].pose.localized
            return

        def is_right(state: RcaState) -> bool:
            truth, pose = self.rig.world.truth, state.pose
            turned = abs(wrap_angle(pose.theta - truth.theta))
            return (
                pose.localized and math.dist((pose.x, pose.y), truth[:2]) < 0.06 and turned < 0.06
            )

        # The architecture may first repeat the pose from before the robot was placed here.
        await wait_for(adapter, is_right)
        await drive(adapter, AHEAD, lambda s: s.distance > 0.12)
        await drive(adapter, Velocity(linear=0.0, angular=0.0), stands)
        await wait_for(adapter, is_right)

    async def test_scan_shows_the_walls(self, adapter: Adapter, computer: HostJitter) -> None:
        if "scan" not in adapter.profile.capabilities:
            return
        await self.here(adapter)
        state = await wait_for(adapter, lambda s: s.scan is not None)
        scan, laser = state.scan, self.rig.world.sim.model.laser
        assert scan.angle_min == pytest.approx(laser.angle_min, abs=0.02)
        assert len(scan.ranges) == laser.beams
        now = time.time()
        assert abs(scan.stamp - now) < patient(0.5) + computer.excuse(scan.stamp, now)
        errors = [
            abs(measured - true)
            for measured, true in zip(scan.ranges, self.rig.world.ranges(), strict=True)
            if measured is not None and true < laser.range_max
        ]
        assert sum(error < 0.08 for error in errors) > 0.9 * len(errors) > 50

    async def test_battery_is_reported(self, adapter: Adapter) -> None:
        state = await wait_for(
            adapter, lambda s: s.battery.voltage is not None or s.battery.charge is not None
        )
        sim, found = self.rig.world.sim, state.battery
        assert found.voltage is None or found.voltage == pytest.approx(sim.voltage(), abs=0.05)
        assert found.charge is None or found.charge == pytest.approx(sim.charge, abs=0.1)
        assert not state.battery.charging
        assert not state.charger_contact

    async def test_goto_reports_its_arrival(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        goal = await self.start_goto(adapter, 0.4)
        news = await heard(adapter, ended("g"))
        assert [each.status for each in news] == ["RUNNING", "FINISHED"], news
        assert self.rig.world.truth.distance(goal) < 0.25

    async def start_goto(self, adapter: Adapter, ahead: float = 2.0) -> Pose2D:
        """Start the action "g" to a point so many metres ahead; return the point."""
        goal = self.rig.world.truth.compose(Pose2D(ahead, 0.0, 0.0))
        await adapter.start(Goto(action_id="g", stamp=0.0, x=goal.x, y=goal.y))
        return goal

    async def start_driving(self, adapter: Adapter) -> None:
        """Start a goto, and wait until the robot drives."""
        await self.start_goto(adapter)
        await wait_for(adapter, lambda s: self.rig.world.sim.motion.linear > 0.2)

    async def has_stopped(self, seconds: float = 3.0) -> None:
        await standing(self.rig, seconds)
        assert self.rig.world.journey != "running"
        await stays(self.rig, 0.5)

    async def test_cancelled_goto_stops_the_robot(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        await cancelled(adapter, "g")
        assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"
        await self.has_stopped()

    async def test_lost_cancel_is_not_confirmed(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        self.rig.world.ignored_cancels = 1
        assert await cancelled(adapter, "g") > 1
        assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"
        await self.has_stopped()

    async def test_goto_counts_as_running_while_its_cancels_are_ignored(
        self, adapter: Adapter
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        self.rig.world.ignored_cancels = math.inf
        for _ in range(4):
            assert not await adapter.cancel("g")
            await asyncio.sleep(CANCEL_INTERVAL)
        assert self.rig.world.cancels >= 4
        with pytest.raises(ActionRefusedError):
            await adapter.start(Goto(action_id="h", stamp=0.0, x=0.0, y=0.0))
        self.rig.world.ignored_cancels = 0
        await cancelled(adapter, "g")
        assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"
        await self.has_stopped()

    async def test_goal_that_is_accepted_after_its_cancel_does_not_run(
        self, adapter: Adapter
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        self.rig.world.accept_after = LATE
        with contextlib.suppress(AdapterError):
            await self.start_goto(adapter)
        await cancelled(adapter, "g")
        await self.has_stopped()
        await stays(self.rig, LATE)

    async def test_docking_that_begins_after_its_cancel_does_not_run(
        self, near_dock: Adapter
    ) -> None:
        if "dock" not in near_dock.profile.capabilities:
            return
        self.rig.world.accept_after = LATE
        with contextlib.suppress(AdapterError):
            await near_dock.start(Dock(action_id="d", stamp=0.0))
        await cancelled(near_dock, "d")
        await self.has_stopped()
        await stays(self.rig, LATE)
        assert not self.rig.world.sim.docked

    async def test_goal_that_is_never_accepted_fails_and_is_cancelled(
        self, adapter: Adapter
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        self.rig.world.accept_after = math.inf
        before = self.rig.world.cancels
        try:
            await self.start_goto(adapter)
        except AdapterError:
            await cancelled(adapter, "g")
        else:
            assert (await heard(adapter, ended("g"), 15.0))[-1].status == "FAILED"
        assert self.rig.world.cancels > before

    @pytest.mark.parametrize("by", ["the same agent", "the next agent"])
    async def test_connecting_cancels_a_goto_of_an_earlier_connection(
        self, adapter: Adapter, by: str
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        before = self.rig.world.cancels
        if by == "the same agent":
            adapter._lose("the cable was cut")
            with pytest.raises(AdapterError, match="cable"):
                await some(adapter.states(), 1)
            await again(adapter)
            await cancelled(adapter, "g")
        else:
            await adapter._disconnect("the agent died")
            async with connected(self.make()):
                await self.has_stopped()
        assert self.rig.world.cancels > before
        await self.has_stopped()

    async def test_failed_goto_reports_the_reason(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        self.rig.loop.call_soon_threadsafe(self.rig.world.cancel)
        last = (await heard(adapter, ended("g")))[-1]
        assert last.status == "FAILED"
        assert last.reason

    async def test_robot_docks_and_undocks(self, near_dock: Adapter) -> None:
        own = near_dock.profile.capabilities
        if "dock" in own:
            await near_dock.start(Dock(action_id="d", stamp=0.0))
            assert (await heard(near_dock, ended("d"), 15.0))[-1].status == "FINISHED"
            state = await wait_for(near_dock, lambda s: s.charger_contact)
            assert state.battery.charging
        if "undock" in own:
            await near_dock.start(Undock(action_id="u", stamp=0.0))
            assert (await heard(near_dock, ended("u"), 15.0))[-1].status == "FINISHED"
            await wait_for(near_dock, lambda s: not s.charger_contact)

    async def test_relocalizing_at_the_true_pose_succeeds(self, adapter: Adapter) -> None:
        if "relocalize" not in adapter.profile.capabilities:
            with pytest.raises(AdapterError):
                await adapter.start(Relocalize(action_id="r", stamp=0.0, x=1.0, y=1.0, theta=0.0))
            return
        await adapter.start(relocalize("r", self.rig.world.truth))
        assert (await heard(adapter, ended("r")))[-1].status == "FINISHED"

    async def test_relocalized_robot_reports_the_new_pose(self, adapter: Adapter) -> None:
        if "relocalize" not in adapter.profile.capabilities:
            return
        await self.here(adapter)
        for number, aside in enumerate((2.5, -2.0)):
            place = self.rig.world.truth.compose(Pose2D(aside, 0.0, 0.0))
            await adapter.start(relocalize(f"r{number}", place))
            news = await heard(adapter, ended(f"r{number}"), 15.0)
            assert [each.status for each in news] == ["RUNNING", "FINISHED"]
            pose = (await some(adapter.states(), 1))[0].pose
            assert math.hypot(pose.x - place.x, pose.y - place.y) < 0.1

    async def test_relocalizing_fails_with_the_reason_if_the_localization_ignores_it(
        self, adapter: Adapter, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        if "relocalize" not in adapter.profile.capabilities:
            return
        await self.here(adapter)
        for module in (openmora_adapter, base):
            monkeypatch.setattr(module, "LONGEST_RELOCALIZATION", 3.0)
        self.rig.world.deaf = True
        place = self.rig.world.truth.compose(Pose2D(2.5, 0.0, 0.0))
        await adapter.start(relocalize("r", place))
        last = (await heard(adapter, ended("r")))[-1]
        assert last.status == "FAILED"
        assert last.reason.partition(": ")[0] in {"pose_disagrees", "no_answer"}

    async def test_robot_stops_when_its_architecture_is_killed_and_drives_after_its_restart(
        self, adapter: Adapter, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        dying = asyncio.create_task(asyncio.to_thread(self.rig.kill))
        reason = await lost(adapter, AHEAD)
        await dying
        assert len(reason) > 10
        with monkeypatch.context() as shortly:
            shortly.setattr(remote_adapter, "FIRST_READING", 1.5)
            with pytest.raises(AdapterError):
                await adapter.connect()
        with pytest.raises(AdapterError):
            adapter.apply(AHEAD)
        await standing(self.rig)
        await asyncio.to_thread(self.rig.revive)
        await again(adapter)
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)

    async def test_action_of_a_lost_architecture_fails_once_its_end_is_confirmed(
        self, adapter: Adapter
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        dying = asyncio.create_task(asyncio.to_thread(self.rig.kill))
        with pytest.raises(AdapterError):
            await wait_for(adapter, lambda _: False)
        await dying
        await asyncio.to_thread(self.rig.revive)
        await again(adapter)
        assert (await heard(adapter, ended("g"), 20.0))[-1].status == "FAILED"
        assert await adapter.cancel("g")


def position(state: RcaState) -> Pose2D:
    """Return the odometry of a state, or else its pose."""
    return state.odometry or Pose2D(state.pose.x, state.pose.y, state.pose.theta)


def relocalize(action_id: str, place: Pose2D) -> Relocalize:
    return Relocalize(action_id=action_id, stamp=0.0, **place._asdict())


async def standing(rig: RcaRig, seconds: float = 3.0) -> None:
    """Wait until the robot itself is at rest, by its watchdog and braking."""
    async with asyncio.timeout(patient(seconds)):
        while rig.world.sim.motion.linear != 0.0:
            await asyncio.sleep(0.02)


async def again(adapter: Adapter, seconds: float = 15.0) -> None:
    """Connect as the agent does: until it succeeds."""
    async with asyncio.timeout(patient(seconds)):
        while True:
            try:
                await adapter.connect()
            except AdapterError:
                await asyncio.sleep(0.2)
            else:
                return


async def sees_grey(adapter: Adapter) -> None:
    """The images of the robot's topic are frames of the adapter's camera, with their own stamps."""
    async with connected(adapter):
        camera = adapter.video()
        camera.start()
        frame = await asyncio.to_thread(
            lambda: next(filter(None, (camera.read(1.0) for _ in range(60))))
        )
        camera.stop()
    assert (frame.width, frame.height) == (160, 120)
    assert frame.image[:120].mean() == pytest.approx(16 + 128 * 219 / 255, abs=2.0)
    assert 0.0 <= time.time() - frame.stamp < patient(5.0)
