"""What every adapter of an outside RCA must do besides `AdapterConformance`, with the same
simulated robot behind each protocol.

A test module subclasses `RcaConformance` and gives a rig (tests/support/architectures/rca_world.py)
once a class.
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
AGAIN = 0.5  # s between two cancels of the agent
LATE = 1.5  # s until a goal is accepted


async def heard(adapter: Adapter, until, seconds: float = 10.0):
    """Read progress until a condition, while states are read as the agent does."""

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
    """Cancel an action every 0.5 s, as the agent does, until its end is certain; count."""
    async with asyncio.timeout(patient(seconds)):
        for count in itertools.count(1):
            if await adapter.cancel(action_id):
                return count
            await asyncio.sleep(AGAIN)
    raise AssertionError


async def stays(rig: RcaRig, seconds: float) -> None:
    """Watch that a robot does not leave its place."""
    place = rig.world.truth
    for _ in range(round(seconds / 0.05)):
        await asyncio.sleep(0.05)
        assert rig.world.truth.distance(place) < 0.03


def ended(action_id):
    return lambda news: (
        news.action_id == action_id and news.status in {"FINISHED", "FAILED", "CANCELLED"}
    )


async def lost(adapter: Adapter, velocity: Velocity, seconds: float = 8.0) -> str:
    """Drive until the adapter says that the RCA is gone; return its sentence."""
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
    """Subclass me with a `rig` fixture of scope class."""

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
        """Return how far a state is from the truth, metres and radians: as the robot counted, or as
        it knows where it is.
        """
        told = state.odometry or Pose2D(state.pose.x, state.pose.y, state.pose.theta)
        really = self.rig.world.truth if state.odometry is None else self.rig.world.sim.odometry
        return told.distance(really), abs(wrap_angle(told.theta - really.theta))

    async def here(self, adapter: Adapter) -> RcaState:
        """Return a state of this place: the first may still be one of before the robot was put
        here, kept or on its way.
        """
        return await wait_for(adapter, lambda s: max(self.error_of(s)) < 0.02)

    @pytest.fixture
    async def near_dock(self) -> AsyncIterator[Adapter]:
        self.rig.reset(BEFORE_DOCK[self.rig.world.series])
        async with connected(self.make()) as adapter:
            yield adapter

    async def test_it_goes_where_it_is_told_and_its_state_says_so(self, adapter: Adapter) -> None:
        before, began = self.rig.world.truth, await self.here(adapter)

        # The watchdog brakes a robot whose velocities are late, and it accelerates again.
        def goes_as_told(state: RcaState) -> bool:
            return (
                state.distance > 0.17
                and abs(state.velocity.linear - 0.2) < 0.06
                and abs(state.velocity.angular - 0.2) < 0.08
            )

        await drive(adapter, Velocity(linear=0.2, angular=0.2), goes_as_told)
        await drive(adapter, Velocity(linear=0.0, angular=0.0), stands)
        await standing(self.rig)
        told = await self.here(adapter)
        moved = before.inverse().compose(self.rig.world.truth)
        if told.odometry is not None:
            counted = began.odometry.inverse().compose(told.odometry)
        else:
            counted = (
                Pose2D(began.pose.x, began.pose.y, began.pose.theta)
                .inverse()
                .compose(Pose2D(told.pose.x, told.pose.y, told.pose.theta))
            )
        assert math.hypot(counted.x - moved.x, counted.y - moved.y) < 0.12
        assert abs(wrap_angle(counted.theta - moved.theta)) < 0.15

    async def test_it_says_where_it_is_when_its_architecture_knows(self, adapter: Adapter) -> None:
        if "localization" not in adapter.profile.capabilities:
            assert not (await some(adapter.states(), 1))[0].pose.localized
            return

        def is_right(state: RcaState) -> bool:
            truth = self.rig.world.truth
            near = math.hypot(state.pose.x - truth.x, state.pose.y - truth.y) < 0.05
            return (
                state.pose.localized
                and near
                and abs(wrap_angle(state.pose.theta - truth.theta)) < 0.05
            )

        # The architecture may first repeat the pose from before the robot was placed here.
        await wait_for(adapter, is_right)
        await drive(adapter, AHEAD, lambda s: s.distance > 0.12)
        stood = await drive(adapter, Velocity(linear=0.0, angular=0.0), stands)
        here = await wait_for(
            adapter,
            lambda s: (
                math.hypot(s.pose.x - self.rig.world.truth.x, s.pose.y - self.rig.world.truth.y)
                < 0.06
            ),
        )
        assert stood.distance > 0.12
        assert here.pose.localized

    async def test_its_scan_shows_the_walls(self, adapter: Adapter, computer: HostJitter) -> None:
        if "scan" not in adapter.profile.capabilities:
            return
        await self.here(adapter)
        state = await wait_for(adapter, lambda s: s.scan is not None)
        scan, laser = state.scan, self.rig.world.sim.model.laser
        assert scan.angle_min == pytest.approx(laser.angle_min, abs=0.02)
        assert len(scan.ranges) == laser.beams
        now = time.time()
        assert abs(scan.stamp - now) < patient(0.5) + computer.excuse(scan.stamp, now)
        really = self.rig.world.ranges()
        pairs = [
            (told, true)
            for told, true in zip(scan.ranges, really, strict=True)
            if told is not None and true < laser.range_max
        ]
        assert sum(abs(told - true) < 0.08 for told, true in pairs) > 0.9 * len(pairs) > 50

    async def test_battery_is_reported(self, adapter: Adapter) -> None:
        state = await wait_for(
            adapter, lambda s: s.battery.voltage is not None or s.battery.charge is not None
        )
        sim, found = self.rig.world.sim, state.battery
        assert found.voltage is None or found.voltage == pytest.approx(sim.voltage(), abs=0.05)
        assert found.charge is None or found.charge == pytest.approx(sim.charge, abs=0.1)
        assert not state.battery.charging
        assert not state.charger_contact

    async def test_it_is_sent_somewhere_and_says_when_it_is_there(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        goal = await self.start_goto(adapter, 0.4)
        news = await heard(adapter, ended("g"))
        assert [each.status for each in news] == ["RUNNING", "FINISHED"], news
        assert self.rig.world.truth.distance(goal) < 0.25

    async def start_goto(self, adapter: Adapter, ahead: float = 2.0) -> Pose2D:
        """Start the action "g" to a point so many metres ahead; return that."""
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

    async def test_a_journey_that_is_cancelled_stops(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        await cancelled(adapter, "g")
        assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"
        await self.has_stopped()

    async def test_a_cancel_that_was_lost_does_not_count(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        self.rig.world.ignored_cancels = 1
        assert await cancelled(adapter, "g") > 1
        assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"
        await self.has_stopped()

    async def test_a_journey_runs_for_as_long_as_its_cancels_are_ignored(
        self, adapter: Adapter
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        self.rig.world.ignored_cancels = math.inf
        for _ in range(4):
            assert not await adapter.cancel("g")
            await asyncio.sleep(AGAIN)
        assert self.rig.world.cancels >= 4
        with pytest.raises(ActionRefusedError):
            await adapter.start(Goto(action_id="h", stamp=0.0, x=0.0, y=0.0))
        self.rig.world.ignored_cancels = 0
        await cancelled(adapter, "g")
        assert (await heard(adapter, ended("g")))[-1].status == "CANCELLED"
        await self.has_stopped()

    async def test_a_goal_that_is_accepted_after_its_cancel_does_not_run(
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

    async def test_a_docking_that_begins_after_its_cancel_does_not_run(
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

    async def test_a_goal_that_is_never_accepted_fails_and_is_cancelled(
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
    async def test_a_connection_cancels_what_an_earlier_one_left(
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

    async def test_a_journey_that_fails_says_so(self, adapter: Adapter) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        self.rig.loop.call_soon_threadsafe(self.rig.world.cancel)
        last = (await heard(adapter, ended("g")))[-1]
        assert last.status == "FAILED"
        assert last.reason

    async def test_it_docks_and_undocks_where_its_architecture_can(
        self, near_dock: Adapter
    ) -> None:
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

    async def test_it_can_be_told_where_it_is(self, adapter: Adapter) -> None:
        if "relocalize" not in adapter.profile.capabilities:
            with pytest.raises(AdapterError):
                await adapter.start(Relocalize(action_id="r", stamp=0.0, x=1.0, y=1.0, theta=0.0))
            return
        await adapter.start(relocalize("r", self.rig.world.truth))
        assert (await heard(adapter, ended("r")))[-1].status == "FINISHED"

    async def test_told_where_it_is_it_says_so_itself_when_it_has_been_relocalized(
        self, adapter: Adapter
    ) -> None:
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

    async def test_a_localization_that_does_not_listen_makes_relocalizing_fail_with_the_reason(
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

    async def test_an_architecture_killed_while_it_drives_stops_the_robot_and_is_found_again(
        self, adapter: Adapter, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        await drive(adapter, AHEAD, lambda s: s.velocity.linear > 0.2)
        dying = asyncio.get_running_loop().run_in_executor(None, self.rig.kill)
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

    async def test_an_action_of_a_lost_architecture_fails_once_its_end_is_confirmed(
        self, adapter: Adapter
    ) -> None:
        if "goto" not in adapter.profile.capabilities:
            return
        await self.start_driving(adapter)
        dying = asyncio.get_running_loop().run_in_executor(None, self.rig.kill)
        with pytest.raises(AdapterError):
            await wait_for(adapter, lambda _: False)
        await dying
        await asyncio.to_thread(self.rig.revive)
        await again(adapter)
        assert (await heard(adapter, ended("g"), 20.0))[-1].status == "FAILED"
        assert await adapter.cancel("g")


def relocalize(action_id: str, place: Pose2D) -> Relocalize:
    return Relocalize(action_id=action_id, stamp=0.0, **place._asdict())


async def standing(rig: RcaRig, seconds: float = 3.0) -> None:
    """Wait until the robot itself stands: its watchdog, and braking."""
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
    """The pictures of the robot's topic come out of the adapter's camera, stamped when they were
    made.
    """
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
