"""Determines what stops the robot's own navigation when the agent is lost: part of `run_robot NAME
--check`.

The robot gets a goal ahead. While it drives there, the connection is cut as by a crash of the
agent, and no zero is sent. Seconds later the agent reconnects, and the odometry shows whether the
robot was at rest and how far it had driven. A guard, or a base that obeys only the agent, stops it
within its distance for reaction and braking; otherwise it stops only at its goal, which is far
enough away to tell the two apart. The distance decides, because connecting cancels the goal, so
that the first reading may already be one of a robot at rest.
"""

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from robots.agent.control.observed_robot import Observed, ObservedRobot, now
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import (
    Adapter,
    AdapterError,
    NavigationControl,
    PassesVelocities,
    Profile,
    RcaState,
    Severable,
)
from robots.api.geometry import Pose2D
from robots.api.messages import ENDED, Goto, Velocity
from robots.api.reasons import clause_of

ACTION_ID = "check"


@dataclass(frozen=True)
class NavigationCheckParams:
    beyond: float = 0.5  # m from the stopping distance to the goal
    tolerance: float = 0.25  # m from its goal at which a planner may have arrived
    setting_out: float = 20.0  # s from the goal to the first motion
    withheld: float = 1.0  # s in which the planner's velocities are not passed on
    fastest: float = 0.2  # m/s and rad/s at which they are
    moving: float = 0.03  # m/s from which the robot drives to its goal
    cut_speed: float = 0.1  # m/s at which the connection is cut, or after `cut_after` of driving
    cut_after: float = 1.0  # s
    trend: float = 0.5  # s over which the acceleration before the cut is measured
    least_acceleration: float = 0.1  # m/s² that a robot may have after the cut in any case
    reaction: float = 0.65  # s from the cut to a guard's first zero
    cut: float = 3.0  # s for which the connection stays cut, at least
    margin: float = 0.05  # m that odometry and the pace of readings may add
    cancelling: float = 10.0  # s for a cancel to be confirmed


@dataclass(frozen=True)
class CutResult:
    """The metres driven between the cut and the first reading, `seconds` later, and whether the
    robot still moved. A guard or the base's watchdog would have stopped it within `allowed` metres.
    """

    metres: float
    seconds: float
    moves: bool
    allowed: float

    @property
    def stopped(self) -> bool:
        return not self.moves and self.metres <= self.allowed


def stopping_distance(
    profile: Profile, params: NavigationCheckParams, speed: float, acceleration: float
) -> float:
    """Return the metres that a robot may drive after the cut if its navigation is stopped: from
    `speed` (m/s) it accelerates (m/s²) for the whole reaction time, then it brakes.
    """
    limits, through_agent = profile.limits, profile.navigation_control == "agent"
    reaction = profile.watchdog if through_agent else params.reaction
    fastest = min(limits.linear, params.fastest) if through_agent else limits.linear
    reached = max(speed, min(fastest, speed + acceleration * reaction))
    return reached * reaction + reached**2 / (2.0 * limits.linear_braking) + params.margin


def verdict(result: CutResult, stated: NavigationControl | None) -> tuple[bool, str]:
    """Return whether navigation is controlled as the adapter states, and a sentence with advice."""
    if result.stopped:
        found = {
            "agent": "Navigation passes through the agent",
            "guarded": "Navigation is guarded",
            "unguarded": "Something stops navigation, though the adapter does not rely on it",
            None: "Something stops navigation, though the adapter does not rely on it",
        }[stated]
        return True, (
            f"{found}: {result.seconds:.1f} s after the connection was cut, the robot was at rest,"
            f" {result.metres:.2f} m on."
        )
    measured = (
        f"Navigation is unguarded: {result.seconds:.1f} s after the connection was cut, the robot"
        f" had driven {result.metres:.2f} m" + (" and was still moving." if result.moves else ".")
    )
    advice = {
        "agent": " Nothing but the agent may publish velocities to the base: check the topics of"
        " the planner and of the base.",
        "guarded": " Its adapter states a guard, but that did not act within 0.65 s: run it beside"
        " the robot control architecture, and let it react within 0.5 s.",
        "unguarded": " The profile allows that, and visitors' pages show a warning. To change it,"
        " let its velocities pass through the agent, or use an adapter with a guard.",
        None: " Let its velocities pass through the agent, or use an adapter with a guard.",
    }[stated]
    return stated == "unguarded", measured + advice


def untestable(adapter: Adapter, state: RcaState | None) -> str:
    """Return in a sentence why the robot's own navigation cannot be tested, "" when it can."""
    if not isinstance(adapter, Severable):
        return "the adapter cannot cut its connection (sever)"
    if state is None or not state.pose.localized:
        return "the robot does not know its position. Set it, then check again"
    if state.charger_contact:
        return "the robot is docked. Take it out of its station, then check again"
    return ""


class NavigationCheck:
    """One test of the robot's own navigation. `say` prints a line for the owner."""

    def __init__(
        self,
        robot: ObservedRobot,
        say: Callable[[str], None],
        params: NavigationCheckParams | None = None,
    ) -> None:
        self._robot, self._say = robot, say
        self._params = params or NavigationCheckParams()
        adapter = robot.adapter
        is_passed_on = adapter.profile.navigation_control == "agent"
        self._planner = adapter if is_passed_on and isinstance(adapter, PassesVelocities) else None
        self._passed_on_from = math.inf  # monotonic time from which its velocities are passed on

    async def run(self) -> bool:
        """Navigate ahead, cut the connection, and return whether the robot stops as stated. Raises
        AdapterError when it is lost or cannot be reached again.
        """
        adapter, profile = self._robot.adapter, self._robot.adapter.profile
        if "goto" not in profile.capabilities:
            return True
        if why := untestable(adapter, self._robot.newest):
            self._say(f"Navigation: not tested, {why}.")
            return False
        params = self._params
        distance = params.beyond + stopping_distance(
            profile, params, params.cut_speed, profile.limits.linear_acceleration
        )
        try:
            before = await self._set_out(distance)
            if before is None:
                return False
            result = await self._cut(before, distance - params.tolerance)
            is_well, line = verdict(result, profile.navigation_control)
            self._say(line)
            return is_well
        finally:
            await self._end()

    async def _set_out(self, distance: float) -> Observed | None:
        """Send the goal and return the reading in which the robot drives to it, or print why not
        and return None.
        """
        self._say(f"Navigating {distance:.1f} m ahead…")
        goal = self._goal(distance)
        self._robot.forget()
        try:
            await self._robot.adapter.start(goal)
        except AdapterError as error:
            self._say(f"Navigation: the goal was not taken: {error}.")
            return None
        ends = now() + self._params.setting_out
        while now() < ends:
            await self._robot.wait(self._robot.params.period)
            is_passed_on = self._pass_on()
            if why := self._why_not(is_passed_on=is_passed_on):
                self._say(why)
                return None
            if self._is_ready_to_cut():
                return self._robot.readings[-1]
        self._say(f"Navigation: the robot did not set out within {self._params.setting_out:g} s.")
        return None

    def _why_not(self, *, is_passed_on: bool) -> str:
        """Return in a sentence why nothing can be measured, "" while the goal may still succeed."""
        newest = self._robot.newest
        if newest is not None and not is_passed_on and not self._robot.is_at_rest(newest):
            return (
                "Navigation does not pass through the agent: the robot moved before the agent had"
                " sent a velocity. Nothing but the agent may publish velocities to the base: check"
                " the topics of the planner and of the base."
            )
        progress = self._robot.progress.get(ACTION_ID)
        if progress is not None and progress.status in ENDED:
            return (
                f"Navigation: the goal ended at once: {clause_of(progress.reason) or 'no reason'}."
            )
        return ""

    def _goal(self, distance: float) -> Goto:
        assert self._robot.newest is not None
        pose = self._robot.newest.pose
        return Goto(
            action_id=ACTION_ID,
            stamp=time.time(),
            x=pose.x + distance * math.cos(pose.theta),
            y=pose.y + distance * math.sin(pose.theta),
            theta=pose.theta,
        )

    def _is_ready_to_cut(self) -> bool:
        """Tell whether the robot is fast enough for the cut, or has driven for long enough."""
        params, readings = self._params, self._robot.readings
        moving = max(params.moving, self._robot.adapter.profile.standstill_linear)
        driving = [reading for reading in readings if _speed(reading) > moving]
        if not driving or driving[-1] is not readings[-1]:
            return False
        seconds = driving[-1].at - driving[0].at
        return _speed(driving[-1]) >= params.cut_speed or seconds >= params.cut_after

    def _acceleration(self) -> float:
        """Return the largest acceleration after the cut, m/s²: at most the robot's limit, and twice
        what was measured before.
        """
        params, newest = self._params, self._robot.readings[-1]
        earlier = [each for each in self._robot.readings if newest.at - each.at >= params.trend]
        before = earlier[-1] if earlier else self._robot.readings[0]
        measured = (_speed(newest) - _speed(before)) / max(newest.at - before.at, params.trend)
        return min(
            self._robot.adapter.profile.limits.linear_acceleration,
            max(2.0 * measured, params.least_acceleration),
        )

    def _pass_on(self) -> bool:
        """Pass on the planner's velocity, slowly, once it has been withheld for a moment; return
        whether the robot may drive, which also holds when its planner drives it directly.
        """
        if self._planner is None:
            return True
        wanted = self._planner.wanted()
        if wanted not in {None, ZERO}:
            self._passed_on_from = min(self._passed_on_from, now() + self._params.withheld)
        if now() < self._passed_on_from:
            return False
        if wanted is not None:
            fastest = self._params.fastest
            share = min(1.0, fastest / max(abs(wanted.linear), abs(wanted.angular), fastest))
            velocity = Velocity(linear=wanted.linear * share, angular=wanted.angular * share)
            self._robot.adapter.apply(velocity)
        return True

    async def _cut(self, before: Observed, arrived: float) -> CutResult:
        """Cut the connection and reconnect; after `arrived` metres the robot may be at its goal."""
        robot, params = self._robot, self._params
        profile = robot.adapter.profile
        allowed = stopping_distance(profile, params, _speed(before), self._acceleration())
        self._say("Cutting the connection…")
        cut_at = now()
        try:
            await robot.sever()
            await asyncio.sleep(max(params.cut, 2.0 * profile.watchdog))
        finally:  # also when the check is interrupted: connecting cancels the goal
            await robot.connect()
        after = await robot.first_reading()
        return CutResult(
            _place(before.state).distance(_place(after.state)),
            after.at - cut_at,
            not robot.is_at_rest(after.state),
            min(allowed, arrived),
        )

    async def _end(self) -> None:
        with contextlib.suppress(AdapterError):
            if await self._robot.cancel(ACTION_ID, self._params.cancelling):
                return
        self._say(
            "Navigation: the robot has not confirmed that its goal was cancelled. Stop it by hand"
            " before you lower it."
        )


def _speed(reading: Observed) -> float:
    return abs(reading.state.velocity.linear)


def _place(state: RcaState) -> Pose2D:
    """Return the robot's odometry, or its pose when it has none."""
    pose = state.pose
    return state.odometry or Pose2D(pose.x, pose.y, pose.theta)
