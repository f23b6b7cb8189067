"""`run_robot NAME --check`: tests a robot with its wheels off the ground, and measures when its
base and its navigation stop without the agent.

It connects the adapter without a site, prints what the robot reports, also the noise of its
velocity at rest, drives slowly for a moment and then sends nothing, not even zero, like an agent
that was killed or hangs. The time for which the base keeps moving, by its own odometry, must not
exceed the watchdog that its profile states. navigation_check.py then does the same with the robot's
own navigation. Zeros are sent at the end in any case.
"""

import asyncio
import math
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any

from robots.agent.adapters import registry
from robots.agent.adapters.common.robot_profile import (
    LARGEST_ANGULAR_STANDSTILL,
    LARGEST_LINEAR_STANDSTILL,
)
from robots.agent.config import AgentConfig, ConfigError, load
from robots.agent.control.navigation_check import NavigationCheck
from robots.agent.control.observed_robot import ObservedRobot, now
from robots.agent.control.stopping import SpeedSample, stopped_after
from robots.agent.devices.equipment import equipment_of
from robots.agent.ramp import LONGEST_WATCHDOG
from robots.agent.robot_interface import (
    FROM_PAGE,
    Adapter,
    AdapterError,
    FromPage,
    Profile,
    RcaState,
    VideoSource,
)
from robots.api.messages import Capability, Velocity

Say = Callable[[str], None]
WARNING = (
    "The robot will turn its wheels: {speed:g} m/s for {driving:g} s, then until it stops by"
    " itself. Lift it so that no wheel touches the ground, and keep your hand on its emergency"
    " button."
)
NAVIGATION_WARNING = (
    "Then it gets a goal for its own navigation, and the connection is cut on the way: if nothing"
    " stops it, it drives on until it is there."
)
NOISE_MARGIN = 1.5  # by which a threshold should exceed the noise that was measured


@dataclass(frozen=True)
class CheckParams:
    speed: float = 0.05  # m/s
    period: float = 0.05  # s between two velocities
    listening: float = 3.0  # s in which everything that the robot reports has to come once
    picture: float = 10.0  # s to the first picture
    driving: float = 1.5  # s
    moving: float = 0.02  # m/s from which the base drives
    at_rest: float = 0.01  # m/s below which it is at rest, unless its profile allows more
    stood: float = 0.4  # s at rest that show that it stays so
    tolerance: float = 0.25  # s: braking, and the time between two readings
    longest: float = LONGEST_WATCHDOG + 1.0  # s of silence after which nothing stops the base


def verdict(measured: float | None, stated: float, params: CheckParams) -> tuple[bool, str]:
    """Return whether a base keeps its stated watchdog, and a sentence; both times in seconds."""
    if measured is None:
        words = (
            f"The base did not stop within {params.longest:g} s of the last velocity. Nothing stops"
            " it without its agent: do not drive it."
        )
        return False, words
    took = (
        f"The base stopped {measured:.2f} s after the last velocity, braking and the pace of its"
        " readings included"
    )
    if measured > stated + params.tolerance:
        return False, f"{took}. The profile states a watchdog of {stated:g} s: correct the profile."
    return True, f"{took}: it keeps the watchdog of {stated:g} s that the profile states."


def reported(
    states: Sequence[RcaState], capabilities: Sequence[str], seconds: float
) -> list[tuple[bool, str]]:
    """Return a line for each finding in a robot's readings, with whether it is as it should be."""
    if not states:
        return [(False, "Readings: none received.")]
    last, has_scan = states[-1], any(state.scan is not None for state in states)
    knows_place = last.pose.localized or last.odometry is not None
    place = f"{last.pose.x:.2f}, {last.pose.y:.2f} m" if last.pose.localized else "unknown"
    charge = "unknown" if last.battery.charge is None else f"{last.battery.charge:.0%}"
    volts = "" if last.battery.voltage is None else f", {last.battery.voltage:.1f} V"
    lines = [
        (True, f"Readings: {len(states) / seconds:.0f} per second."),
        (
            knows_place or "localization" not in capabilities,
            f"Pose: {place}; odometry: {'yes' if last.odometry is not None else 'none'}.",
        ),
        (True, f"Battery: {charge}{volts}."),
    ]
    if "scan" in capabilities:
        lines.append((has_scan, f"Laser: {'yes' if has_scan else 'no scan received'}."))
    if last.estop:
        lines.append((False, "The robot's emergency button is pressed."))
    return [*lines, *((False, f"The robot reports: {error}") for error in last.errors)]


def noise(states: Sequence[RcaState], profile: Profile) -> str:
    """Return in a sentence the standstill thresholds that a robot at rest needs, "" when those of
    its profile suffice.
    """
    measured = {
        "linear": max((abs(state.velocity.linear) for state in states), default=0.0),
        "angular": max((abs(state.velocity.angular) for state in states), default=0.0),
    }
    units = {"linear": "m/s", "angular": "rad/s"}
    present = {"linear": profile.standstill_linear, "angular": profile.standstill_angular}
    largest = {"linear": LARGEST_LINEAR_STANDSTILL, "angular": LARGEST_ANGULAR_STANDSTILL}
    exceeded = [axis for axis in measured if measured[axis] > present[axis]]
    if not exceeded:
        return ""
    needed = {
        axis: math.ceil(round(NOISE_MARGIN * measured[axis] * 1000.0, 3)) / 1000.0
        for axis in exceeded
    }
    noisy = " and ".join(
        f"{measured[axis]:.3f} {units[axis]} ({present[axis]:g} counts as rest)"
        for axis in exceeded
    )
    words = f"Noise: at rest the robot reports up to {noisy}, so that it never counts as at rest."
    if any(needed[axis] > largest[axis] for axis in exceeded):
        return f"{words} That is too much for a threshold: filter its odometry."
    settings = " and ".join(f"standstill_{axis} = {needed[axis]:g}" for axis in exceeded)
    return f"{words} Set {settings} in its profile, unless something moved it."


class RobotCheck:
    """One test of a robot. `video` is its camera, `page` when the robot's screen provides it."""

    def __init__(
        self,
        adapter: Adapter,
        say: Say,
        *,
        video: VideoSource | FromPage | None = None,
        params: CheckParams | None = None,
    ) -> None:
        self._adapter, self._say, self._video = adapter, say, video
        self._params = params or CheckParams()
        self._robot = ObservedRobot(adapter)

    async def run(self) -> bool:
        """Test the robot and return whether everything is as its profile states. Raises
        AdapterError with one sentence when the robot is lost or cannot be reached.
        """
        try:
            await self._robot.connect()
            is_well = await self._listen()
            is_well &= await self._look()
            if not await self._measure():
                return False
            return await NavigationCheck(self._robot, self._say).run() and is_well
        finally:
            await self._robot.leave()

    @property
    def capabilities(self) -> tuple[Capability, ...]:
        return self._adapter.profile.capabilities

    async def _listen(self) -> bool:
        await self._robot.wait(self._params.listening)
        profile = self._adapter.profile
        states = [reading.state for reading in self._robot.readings]
        lines = reported(states, profile.capabilities, self._params.listening)
        if words := noise(states, profile):
            lines.append((False, words))
        for _, line in lines:
            self._say(line)
        return all(is_well for is_well, _ in lines)

    async def _look(self) -> bool:
        video = self._video
        if video is None:
            self._say("Camera: none here.")
            return True
        if video == FROM_PAGE:
            self._say("Camera: the page on the robot's screen provides it.")
            return True
        try:
            picture = await asyncio.to_thread(self._first_picture, video)
        except AdapterError as error:
            self._say(f"Camera: {error}")
            return False
        self._say(f"Camera: {picture or f'no video received within {self._params.picture:g} s'}.")
        return bool(picture)

    def _first_picture(self, video: VideoSource) -> str:
        video.start()
        try:
            deadline = time.monotonic() + self._params.picture
            while time.monotonic() < deadline:
                frame = video.read(0.5)
                if frame is not None:
                    return f"{frame.width} x {frame.height}"
            return ""
        finally:
            video.stop()

    async def _measure(self) -> bool:
        params = self._params
        # A robot in its dock would push against the contacts.
        newest = self._robot.newest
        speed = -params.speed if newest is not None and newest.charger_contact else params.speed
        silent_at = await self._drive(speed)
        if not any(abs(sample.speed) > params.moving for sample in self._samples()):
            self._say(
                f"According to its readings, the base did not move at {speed:g} m/s for"
                f" {params.driving:g} s. Nothing was measured."
            )
            return False
        measured = await self._silence(silent_at)
        is_well, line = verdict(measured, self._adapter.profile.watchdog, params)
        self._say(line)
        return is_well

    async def _drive(self, speed: float) -> float:
        """Drive, and return when the last velocity was sent, monotonic seconds."""
        self._robot.forget()
        self._say(f"Driving {speed:g} m/s…")
        ends = now() + self._params.driving
        while True:
            self._adapter.apply(Velocity(linear=speed, angular=0.0))
            sent_at = now()
            if sent_at >= ends:
                self._say("Silence…")
                return sent_at
            await self._robot.wait(self._params.period)

    async def _silence(self, silent_at: float) -> float | None:
        params = self._params
        at_rest = max(params.at_rest, self._adapter.profile.standstill_linear)
        while now() < silent_at + params.longest:
            await self._robot.wait(params.period)
            samples = self._samples(after=silent_at)
            measured = stopped_after(samples, silent_at, at_rest)
            if measured is not None and samples[-1].at - silent_at - measured >= params.stood:
                return measured
        return None

    def _samples(self, after: float = -math.inf) -> list[SpeedSample]:
        return [
            SpeedSample(reading.at, reading.state.velocity.linear)
            for reading in self._robot.readings
            if reading.at > after
        ]


def check_robot(arguments: Mapping[str, Any], say: Say, ask: Callable[[str], str] = input) -> bool:
    """Test the robot that command line, environment and credentials file name, after a
    confirmation; return whether all is well.

    SIGINT and SIGTERM end it early, with zeros to the base; a second signal does not wait. Raises
    ConfigError with one sentence: an unknown adapter, profile, option or device, or no
    confirmation.
    """
    config = load(arguments, checking=True)
    params = CheckParams()
    check = _prepared(config, say, params)
    say(WARNING.format(speed=params.speed, driving=params.driving))
    if "goto" in check.capabilities:
        say(NAVIGATION_WARNING)
    if not arguments.get("yes") and not _agreed(ask):
        raise ConfigError("The robot was not moved: answer yes, or give --yes")
    try:
        is_well = asyncio.run(_until_signalled(check))
    except asyncio.CancelledError:
        raise ConfigError("Stopped at your request") from None
    except AdapterError as error:
        say(f"The robot cannot be checked: {error}")
        return False
    say("All is well." if is_well else "Not all checks passed.")
    return is_well


def _agreed(ask: Callable[[str], str]) -> bool:
    try:
        return ask("Are its wheels off the ground? [yes/no] ").strip().lower() in {"yes", "y"}
    except (EOFError, KeyboardInterrupt):
        return False


def _prepared(config: AgentConfig, say: Say, params: CheckParams) -> RobotCheck:
    try:
        adapter = registry.create(config.adapter, config.profile, config.options)
        video: VideoSource | FromPage | None = equipment_of(adapter, config).video
    except AdapterError as error:
        raise ConfigError(str(error)) from error
    return RobotCheck(adapter, say, video=video, params=params)


async def _until_signalled(check: RobotCheck) -> bool:
    """Run a check. The first signal cancels it, so that it brakes; the next ends the process."""
    loop, work = asyncio.get_running_loop(), asyncio.current_task()
    assert work is not None

    def end(number: int, _frame: FrameType | None) -> None:
        signal.signal(number, signal.default_int_handler)
        loop.call_soon_threadsafe(work.cancel)

    # by name: ignored ones, too, as behind nohup and in a shell's background
    for name in ("SIGINT", "SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), end)
    return await check.run()


def say_line(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
