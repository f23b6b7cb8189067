"""What every adapter must do: a test module of an adapter subclasses `AdapterConformance`.

It uses robot_interface.Adapter alone, and so holds for a simulator, for ROS and for MOOS.
"""

import asyncio
import time
from abc import abstractmethod
from collections.abc import AsyncIterator, Iterator
from itertools import pairwise

import numpy as np
import pytest

from robots.agent.media.pixels import video_frame
from robots.agent.robot_interface import ActionRefusedError, Adapter, AdapterError, RcaState
from robots.api.messages import Config, Goto, Tilt, Velocity
from tests.support.architectures.patient_adapters import make_patient
from tests.support.host_jitter import HostJitter, pauses, watched
from tests.support.loop_guard import ADVICE, guarded
from tests.support.patience import patient

STILL = Velocity(linear=0.0, angular=0.0)
LONGEST_DELAY = 1.5  # s that a busy machine keeps one of several processes waiting
STATE_INTERVAL = 0.1  # s between two states, at most
TICK = 0.02  # s, the period of the control loop
LATE = 0.15  # s by which an adapter may delay the control loop


async def some(states: AsyncIterator[RcaState], count: int) -> list[RcaState]:
    found = []
    async with asyncio.timeout(patient(10.0)):
        async for state in states:
            found.append(state)
            if len(found) == count:
                break
    return found


async def drive(adapter: Adapter, velocity: Velocity, until, seconds: float = 8.0) -> RcaState:
    """Apply a velocity on every state until a condition on the state holds."""
    return await _until(adapter, until, seconds, lambda: adapter.apply(velocity))


async def wait_for(adapter: Adapter, until, seconds: float = 8.0, act=lambda: None) -> RcaState:
    """Read states, without applying velocities, until a condition holds; `act` at each."""
    return await _until(adapter, until, seconds, act)


async def _until(adapter: Adapter, until, seconds: float, act) -> RcaState:
    state, count = None, 0
    try:
        async with asyncio.timeout(patient(seconds)):
            async for state in adapter.states():
                count += 1
                act()
                if until(state):
                    return state
    except TimeoutError:
        raise AssertionError(f"not in {seconds} s; last of {count} states: {state}") from None
    raise AssertionError("the states ended")


async def sent(adapter: Adapter, velocity: Velocity, expected: Velocity) -> Velocity:
    """Apply a velocity until `apply` returns the expected one; return it."""
    async with asyncio.timeout(patient(5.0)):
        while (found := adapter.apply(velocity)) != expected:
            await asyncio.sleep(TICK)
    return found


def stands(state: RcaState) -> bool:
    return abs(state.velocity.linear) < 0.005 and abs(state.velocity.angular) < 0.005


class AdapterConformance:
    @abstractmethod
    def make(self) -> Adapter:
        """Return a new adapter of a robot at rest that can drive a metre ahead."""

    def obeyed_at(self, adapter: Adapter) -> float:
        """Return when the last non-zero velocity reached the robot, Unix seconds; 0 if unknown."""
        return 0.0

    @pytest.fixture(autouse=True)
    def _patience(self, monkeypatch: pytest.MonkeyPatch) -> None:
        make_patient(monkeypatch)

    @pytest.fixture(autouse=True)
    def _blocking_is_named(self) -> Iterator[None]:
        """An adapter that blocks the control loop fails its test within seconds."""
        with guarded():
            yield

    @pytest.fixture
    def computer(self) -> Iterator[HostJitter]:
        """How late the computer itself is, by which bounds in seconds may be exceeded."""
        with watched() as jitter:
            yield jitter

    @pytest.fixture
    async def adapter(self) -> AsyncIterator[Adapter]:
        adapter = self.make()
        await adapter.connect()
        yield adapter
        await adapter.close()

    def test_profile_can_be_read_before_connecting(self) -> None:
        profile = self.make().profile
        assert profile.watchdog > 0.0
        assert profile.series
        assert profile.rca
        assert "velocity" in profile.capabilities
        assert ("tilt" in profile.capabilities) == (profile.tilt is not None)
        assert "video" not in profile.capabilities or profile.camera is not None
        outline = np.array(profile.footprint)
        along = np.roll(outline, -1, axis=0) - outline
        turns = along[:, 0] * np.roll(along[:, 1], -1) - along[:, 1] * np.roll(along[:, 0], -1)
        assert (turns > 0).all() or (turns < 0).all()  # convex

    async def test_unconnected_adapter_refuses_to_drive(self) -> None:
        adapter = self.make()
        with pytest.raises(AdapterError):
            adapter.apply(STILL)
        with pytest.raises(AdapterError):
            await some(adapter.states(), 1)
        await adapter.close()

    async def test_states_arrive_at_10_hz_or_more_with_increasing_current_stamps(
        self, adapter: Adapter, computer: HostJitter
    ) -> None:
        begun = time.time()
        states = await some(adapter.states(), 21)
        now = time.time()
        assert (now - begun) / 20 < 0.25 + computer.excuse(begun, now)
        assert all(b.stamp > a.stamp for a, b in pairwise(states))
        assert abs(states[-1].stamp - now) < patient(0.5) + computer.excuse(begun, now)
        assert 0.0 <= states[-1].battery.charge <= 1.0

    async def test_robot_moves_at_the_velocity_that_apply_returns(self, adapter: Adapter) -> None:
        start = (await some(adapter.states(), 1))[0]
        ahead = Velocity(linear=0.2, angular=0.0)
        assert await sent(adapter, ahead, ahead) == ahead

        # The watchdog brakes a robot whose velocities are late, and it accelerates again.
        def goes_steadily(state: RcaState) -> bool:
            return (
                state.distance > start.distance + 0.17 and abs(state.velocity.linear - 0.2) < 0.05
            )

        await drive(adapter, Velocity(linear=0.2, angular=0.0), goes_steadily)

    async def test_control_loop_is_never_blocked(
        self, adapter: Adapter, computer: HostJitter
    ) -> None:
        begun = time.time()
        latest, longest = time.monotonic(), 0.0
        states = asyncio.ensure_future(some(adapter.states(), 10))
        try:
            for _ in range(round(1.0 / TICK)):
                adapter.apply(Velocity(linear=0.1, angular=0.0))
                await asyncio.sleep(TICK)
                latest, before = time.monotonic(), latest
                longest = max(longest, latest - before - TICK)
            adapter.apply(STILL)
            await states
        finally:
            states.cancel()
        excuse = computer.excuse(begun, time.time())
        assert longest < LATE + excuse, f"the adapter blocks the control loop. {ADVICE}"

    async def test_velocities_are_clamped_to_the_limits(self, adapter: Adapter) -> None:
        limits = adapter.profile.limits
        most = Velocity(linear=limits.linear, angular=limits.angular)
        assert await sent(adapter, Velocity(linear=9.0, angular=19.0), most) == most
        most = Velocity(linear=-limits.reverse, angular=-limits.angular)
        assert await sent(adapter, Velocity(linear=-9.0, angular=-19.0), most) == most
        assert adapter.apply(STILL) == STILL

    async def test_zero_velocities_brake(self, adapter: Adapter) -> None:
        await drive(adapter, Velocity(linear=0.2, angular=0.0), lambda s: s.velocity.linear > 0.15)
        await drive(adapter, STILL, stands, 3.0)

    async def test_without_velocities_the_robot_stops_within_watchdog_and_braking_time(
        self, adapter: Adapter, computer: HostJitter
    ) -> None:
        limits = adapter.profile.limits
        await drive(adapter, Velocity(linear=0.2, angular=0.0), lambda s: s.velocity.linear > 0.15)
        adapter.apply(Velocity(linear=0.2, angular=0.0))
        silent = time.time()
        seen: list[RcaState] = []
        stood = await wait_for(adapter, lambda s: seen.append(s) or stands(s), 5.0)
        kept_waiting = max(0.0, self.obeyed_at(adapter) - silent) + pauses(
            (state.stamp for state in seen), STATE_INTERVAL
        )
        excuse = computer.excuse(silent, stood.stamp) + min(kept_waiting, LONGEST_DELAY)
        assert (
            stood.stamp - silent
            <= adapter.profile.watchdog + 0.2 / limits.linear_braking + 0.25 + excuse
        )

    async def test_impossible_action_is_refused_with_a_reason(self, adapter: Adapter) -> None:
        if "goto" in adapter.profile.capabilities:
            action: object = Goto(action_id="g", stamp=0.0, place="an unknown place")
        else:
            action = Goto(action_id="g", stamp=0.0, x=0.0, y=0.0)
        with pytest.raises(ActionRefusedError, match=r"."):
            await adapter.start(action)

    async def test_unknown_action_counts_as_cancelled(self, adapter: Adapter) -> None:
        assert await adapter.cancel("never-started") is True
        assert await some(adapter.states(), 1)

    async def test_unreported_emergency_stop_is_unknown(self, adapter: Adapter) -> None:
        assert (await some(adapter.states(), 3))[-1].estop is None

    async def test_head_tilts_to_the_angle_and_reports_its_arrival(self, adapter: Adapter) -> None:
        tilt = adapter.profile.tilt
        if tilt is None:
            with pytest.raises(AdapterError):
                await adapter.start(Tilt(action_id="t", stamp=0.0, angle=0.1))
            return
        goal = tilt.home + 0.5 * (tilt.maximum - tilt.home)
        await adapter.start(Tilt(action_id="t", stamp=0.0, angle=goal))
        found = []
        async with asyncio.timeout(patient(10.0)):
            async for news in adapter.progress():
                found.append((news.action_id, news.status))
                if news.status == "FINISHED":
                    break
        assert found == [("t", "RUNNING"), ("t", "FINISHED")]
        assert (await wait_for(adapter, lambda s: s.tilt is not None)).tilt == pytest.approx(
            goal, abs=0.02
        )
        with pytest.raises(AdapterError):
            await adapter.start(Tilt(action_id="far", stamp=0.0, angle=tilt.maximum + 1.0))

    async def test_camera_frames_have_the_size_of_the_profile_and_increasing_stamps(
        self, adapter: Adapter, computer: HostJitter
    ) -> None:
        source, camera = adapter.video(), adapter.profile.camera
        assert (source is not None) == ("video" in adapter.profile.capabilities)
        if source is None or camera is None:
            return
        begun = time.time()
        source.start()
        source.start()
        frames = []
        async with asyncio.timeout(patient(30.0)):
            while len(frames) < 4:
                frame = await asyncio.to_thread(source.read, 1.0)
                if frame is not None:
                    frames.append(frame)
        now = time.time()
        source.stop()
        source.stop()
        assert all(
            video_frame(frame).to_ndarray(format="rgb24").shape == (camera.height, camera.width, 3)
            for frame in frames
        )
        assert all(b.stamp > a.stamp for a, b in pairwise(frames))
        assert abs(frames[-1].stamp - now) < patient(1.0) + computer.excuse(begun, now)
        assert frames[0].image.std() > 5
        assert await asyncio.to_thread(source.read, 0.05) is None

    async def test_microphone_gives_blocks_of_20_ms(self, adapter: Adapter) -> None:
        source = adapter.audio()
        if source is None:
            return
        source.start()
        blocks = []
        async with asyncio.timeout(patient(10.0)):
            while len(blocks) < 5:
                block = await asyncio.to_thread(source.read, 1.0)
                if block is not None:
                    blocks.append(block)
        source.stop()
        assert all(block.shape == (960,) and block.dtype == np.int16 for block in blocks)

    async def test_configuration_never_raises(self, adapter: Adapter) -> None:
        adapter.configure(Config(stamp=1.0, doors={"no-such-door": "closed"}))
        adapter.configure(None)
        adapter.configure({"doors": 7})
        assert await some(adapter.states(), 2)

    async def test_closed_adapter_refuses_to_drive_and_can_be_closed_again(
        self, adapter: Adapter
    ) -> None:
        await adapter.close()
        with pytest.raises(AdapterError):
            adapter.apply(STILL)
        await adapter.close()

    async def test_closed_adapter_can_be_connected_again(self, adapter: Adapter) -> None:
        await adapter.close()
        await adapter.connect()
        assert await some(adapter.states(), 3)
