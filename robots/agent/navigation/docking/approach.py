"""Into a charging station and out of it.

The map leads to a pose before the station. From there the robot uses the station's own shape in the
laser, because the contacts need more precision than the map has. The station's place is kept in the
frame of the odometry and averaged over scans. A try that ends beside the contacts is backed out of
and repeated.

Distances in this file are in the frame of the docked robot: x < 0 before the station, y aside.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal, Protocol

import numpy as np

from robots.agent.navigation.docking import station as shape
from robots.agent.navigation.planning.follower import FOLLOWER, Follower
from robots.agent.navigation.planning.steps import NavigationStep, Sense, failed, finished
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BrakeCheck, Hazards
from robots.agent.safety.collision.odometry import between
from robots.api.docked import DOCKED, DockReading, DockState, follow
from robots.api.floorplan import ChargingDock
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Limits, Velocity
from robots.api.reasons import ReasonCode
from robots.world.sensing import Floats, points_in_frame


@dataclass(frozen=True)
class DockingParams:
    """Parameters of docking; distances in the frame of the docked robot."""

    start_distance: float = 0.9  # m before the docked pose: where the last metre begins
    tries: int = 3  # until the robot gives up
    # s of standing to find the station, before the robot turns to look for it
    look_time: float = 2.0
    search_angle: float = 0.35  # rad to either side
    sighting_weight: float = 0.5  # share of a new sighting in the station's pose
    trusted_after: int = 3  # sightings, before the robot trusts them
    lost_after: float = 2.5  # s without a sighting while farther than `near`
    near: float = 0.25  # m: nearer than this, sightings are good to have and no longer needed
    fastest: float = 0.2  # m/s
    slowest: float = 0.05  # m/s, with which the contacts are met
    slowing: float = 0.4  # m/s for each metre that is left
    steering_gain: float = 1.6  # rad/s for each rad off the wanted heading
    steering_distance: float = 0.35  # m ahead on the line, at which the robot aims
    steering_limit: float = 0.4  # rad/s
    # m aside close before the station: with more the contacts would miss
    lateral_tolerance: float = 0.045
    heading_tolerance: float = 0.1  # rad, the same
    lateral_limit: float = 0.3  # m aside: try again from before the station
    press_distance: float = 0.04  # m beyond the docked pose, where the nose meets the station
    seated_at: float = -0.015  # m from the docked pose: a robot whose contacts meet goes on to here
    seating_time: float = 0.7  # s for which it does, at most
    rest_time: float = 10.0  # s from the first contact in which a robot must be docked
    entering_time: float = 45.0  # s for the last metre, at most
    stalled_after: float = 2.5  # s for which the wheels are asked in vain
    exempt: float = 0.08  # m before the station's front that count as the station


@dataclass(frozen=True)
class UndockingParams:
    """Parameters of leaving the charging station and turning round."""

    speed: float = 0.15  # m/s
    distance: float = 0.4  # m to back out, at least
    turning_room: float = 0.06  # m between the turning robot and the station
    patience: float = 20.0  # s to wait until it is free behind
    facing: float = 0.1  # rad from straight away from the station, when the robot has turned round
    held_after: float = 5.0  # s after which a robot that cannot turn leaves it at that
    backed_share: float = 0.5  # of the progress: the robot is out and has yet to turn


DOCKING = DockingParams()
UNDOCKING = UndockingParams()


class DockingStage(Enum):
    """The stages of docking. A failed try goes to BACK, then to APPROACH again."""

    APPROACH = "to where the last metre begins"
    LOOK = "for the station"
    ENTER = "the last metre"
    BACK = "out again"


# Why a try has missed the contacts: the value of ReasonCode.TRIES_AGAIN and DOCK_FAILED. `late`
# without them in time, `blocked` by an obstacle before the station, `beside` them, `not_at_rest` on
# them.
Missed = Literal[
    "not_seen", "out_of_sight", "late", "blocked", "beside", "no_contact", "not_at_rest"
]


class NavigationTask(Protocol):
    """Something that is stepped to its end."""

    def step(self, sense: Sense) -> NavigationStep:
        """Return what to do now."""


class Docking:
    """Drive into `dock`; `approach` makes the journey to a pose of the map."""

    def __init__(
        self,
        dock: ChargingDock,
        check: BrakeCheck,
        limits: Limits,
        approach: Callable[[Pose2D], NavigationTask],
        params: DockingParams = DOCKING,
    ) -> None:
        self._dock, self._check, self._limits = dock, check, limits
        self._approach, self._params = approach, params
        self._pose = Pose2D(dock.x, dock.y, dock.theta)
        self._start = self._pose.compose(Pose2D(-params.start_distance, 0.0, 0.0))
        self._contact_since: float | None = None
        self._seated = DockState()
        self._presses = True
        self._begin_try(0)

    @property
    def needs_map(self) -> bool:
        """Tell whether the robot has to know where it is on the map now."""
        return self._stage in {DockingStage.APPROACH, DockingStage.LOOK} and self._seen == 0

    def step(self, sense: Sense) -> NavigationStep:
        if sense.charger_contact and self._stage is not DockingStage.BACK:
            return self._seat(sense)
        self._contact_since, self._seated, self._presses = None, DockState(), True
        if self._stage is DockingStage.APPROACH:
            return self._come(sense)
        if self._stage is DockingStage.BACK:
            return self._back(sense)
        self._sight(sense)
        return self._look(sense) if self._stage is DockingStage.LOOK else self._enter(sense)

    # --- the stages -------------------------------------------------------------------------------

    def _begin_try(self, number: int) -> None:
        self._try = number
        self._stage = DockingStage.APPROACH
        self._journey = self._approach(self._start)
        self._docked_in_odometry: Pose2D | None = None
        self._seen = 0
        self._since = self._seen_at = self._beams_at = -math.inf
        self._still_since: float | None = None
        self._waits = False
        self._out: _Reverse | None = None

    def _come(self, sense: Sense) -> NavigationStep:
        step = self._journey.step(sense)
        if step.status == "FAILED":
            return failed(step.reason)
        if step.status == "FINISHED":
            self._stage = DockingStage.LOOK
            self._since = sense.now
            self._glance = Follower(self._check, self._limits)
            self._straight_on = sense.odometry.theta
            return self._running(ZERO, ReasonCode.LOOKS_FOR_DOCK, 0.7)
        return NavigationStep(step.velocity, "RUNNING", step.reason, step.path, step.progress * 0.7)

    def _look(self, sense: Sense) -> NavigationStep:
        """Stand and look; then turn a little to one side and to the other."""
        params = self._params
        if self._seen >= params.trusted_after:
            self._stage = DockingStage.ENTER
            self._since = sense.now
            return self._enter(sense)
        waited = sense.now - self._since
        if waited > 5.0 * params.look_time:
            return self._again(sense, "not_seen")
        side = params.search_angle if waited < 3.0 * params.look_time else -params.search_angle
        if waited < params.look_time:
            side = 0.0
        error = wrap_angle(self._straight_on + side - sense.odometry.theta)
        turned = self._glance.turn(error, sense.velocity, sense.hazards, 0.05)
        return self._running(turned.velocity, ReasonCode.LOOKS_FOR_DOCK, 0.7)

    def _enter(self, sense: Sense) -> NavigationStep:
        params = self._params
        here = self._error(sense)
        if sense.now - self._since > params.entering_time:
            return self._again(sense, "blocked" if self._waits else "late")
        if here.x < -params.near and sense.now - self._seen_at > params.lost_after:
            return self._again(sense, "out_of_sight")
        if self._off_course(here):
            return self._again(sense, "beside")
        if here.x >= params.press_distance or self._stalled(sense):
            return self._again(sense, "no_contact")
        if abs(math.atan2(-here.y, params.steering_distance) - here.theta) > 0.5:
            turned = self._glance.turn(-here.theta, sense.velocity, self._others(sense), 0.1)
            return self._running(turned.velocity, "", 0.75)
        done = self._check.fastest(sense.velocity, self._servo(here), self._others(sense))
        self._waits = done.velocity == ZERO
        reason = ReasonCode.BEFORE_DOCK if self._waits else ""
        progress = 0.75 + 0.25 * (1.0 + here.x / params.start_distance)
        return self._running(done.velocity, reason, min(0.99, progress))

    def _seat(self, sense: Sense) -> NavigationStep:
        """Press on a little so that the contacts keep meeting; then rest until docked."""
        params = self._params
        self._contact_since = sense.now if self._contact_since is None else self._contact_since
        reading = DockReading(
            at=sense.now,
            contact=True,
            linear=sense.velocity.linear,
            angular=sense.velocity.angular,
            released=not self._presses,
        )
        self._seated = follow(DOCKED, self._seated, reading)
        if self._seated.docked:
            return finished()
        if sense.now - self._contact_since >= params.rest_time:
            return self._again(sense, "not_at_rest")
        deep = (
            self._docked_in_odometry is None
            or self._stage is not DockingStage.ENTER
            or self._error(sense).x >= params.seated_at
        )
        self._presses = not deep and sense.now - self._contact_since < params.seating_time
        press = Velocity(linear=params.slowest, angular=0.0)
        return self._running(press if self._presses else ZERO, "", 0.99)

    def _again(self, sense: Sense, missed: Missed) -> NavigationStep:
        """Back out and try again, or give up."""
        self._missed = missed
        self._stage = DockingStage.BACK
        distance = 0.0
        if self._docked_in_odometry:
            distance = max(0.0, self._params.start_distance - 0.3 + self._error(sense).x)
        self._out = _Reverse(self._check, self._limits, distance)
        return self._running(ZERO, ReasonCode.TRIES_AGAIN.of(missed), 0.7)

    def _back(self, sense: Sense) -> NavigationStep:
        params = self._params
        assert self._out is not None
        step = self._out.step(sense)
        if step.status == "RUNNING":
            again = ReasonCode.TRIES_AGAIN.of(self._missed)
            return self._running(step.velocity or ZERO, again, 0.7)
        if self._try + 1 >= params.tries:
            return failed(ReasonCode.DOCK_FAILED.of(self._missed))
        if step.status == "FAILED":
            return step
        self._begin_try(self._try + 1)
        return self._running(ZERO, ReasonCode.TRIES_AGAIN, 0.5)

    # --- the last metre ---------------------------------------------------------------------------

    def _sight(self, sense: Sense) -> None:
        """Look for the station in a new sweep, where it was last seen or the map has it."""
        params = self._params
        if sense.beams.stamp <= self._beams_at:
            return
        self._beams_at = sense.beams.stamp
        known = self._docked_in_odometry
        docked = self._error(sense).inverse()
        at_sweep = sense.beams_from.inverse().compose(sense.odometry).compose(docked)
        ahead = Pose2D(self._dock.station.distance, 0.0, 0.0)
        window = shape.WIDE if self._seen < params.trusted_after else shape.NARROW
        found = shape.find(sense.beams, at_sweep.compose(ahead), self._dock.station, window)
        if found is None:
            return
        seen = sense.beams_from.compose(found.front).compose(Pose2D(-ahead.x, 0.0, 0.0))
        if known is not None:
            seen = between(known, seen, params.sighting_weight)
        self._docked_in_odometry = seen
        self._seen, self._seen_at = self._seen + 1, sense.now

    def _error(self, sense: Sense) -> Pose2D:
        """Return the pose of the robot in the frame of the docked one."""
        known = self._docked_in_odometry
        if known is None:
            return self._pose.inverse().compose(sense.pose)
        return known.inverse().compose(sense.odometry)

    def _servo(self, here: Pose2D) -> Velocity:
        """Return the velocity that steers onto the line before the station and along it."""
        params = self._params
        slower = params.slowest + params.slowing * max(0.0, -here.x - 0.03)
        speed = min(params.fastest, self._limits.linear, slower)
        wanted = math.atan2(-here.y, params.steering_distance)
        turn = params.steering_gain * wrap_angle(wanted - here.theta) * min(1.0, speed / 0.1)
        angular = min(max(turn, -params.steering_limit), params.steering_limit)
        return Velocity(linear=speed, angular=angular)

    def _off_course(self, here: Pose2D) -> bool:
        params = self._params
        aside, turned = abs(here.y), abs(here.theta)
        misses = aside > params.lateral_tolerance or turned > 2.0 * params.heading_tolerance
        return (-0.2 < here.x < -0.08 and misses) or aside > params.lateral_limit

    def _others(self, sense: Sense) -> Hazards:
        """Return the hazards without the station and anything behind it."""
        params = self._params
        docked = self._error(sense).inverse()
        front = self._dock.station.distance - params.exempt
        half = self._dock.station.width / 2.0 + params.exempt

        def elsewhere(points: Floats) -> Floats:
            x, y = points_in_frame(docked, points).T
            beside = (np.abs(y) > half) & (x < front + params.exempt)
            chosen: Floats = points[(x < front) | beside]
            return chosen

        near = sense.hazards
        return Hazards(elsewhere(near.things), elsewhere(near.strangers), elsewhere(near.walkers))

    def _stalled(self, sense: Sense) -> bool:
        params = self._params
        if (
            self._waits
            or abs(sense.velocity.linear) > params.slowest / 3.0
            or sense.now - self._since < params.stalled_after
        ):
            self._still_since = None
            return False
        self._still_since = sense.now if self._still_since is None else self._still_since
        is_near = self._error(sense).x > -params.near
        return is_near and sense.now - self._still_since >= params.stalled_after

    def _running(self, velocity: Velocity, reason: str, progress: float) -> NavigationStep:
        line = np.array([self._start[:2], self._pose[:2]])
        return NavigationStep(velocity, "RUNNING", reason, line, progress)


class _Reverse:
    """Back out straight by some metres; wait while something is behind."""

    def __init__(
        self,
        check: BrakeCheck,
        limits: Limits,
        distance: float,
        params: UndockingParams = UNDOCKING,
    ) -> None:
        self._check, self._limits, self._params = check, limits, params
        self._distance = distance
        self._from: Pose2D | None = None
        self._moving_at = -math.inf

    def step(self, sense: Sense) -> NavigationStep:
        params = self._params
        if self._from is None:
            self._from, self._moving_at = sense.odometry, sense.now
        backed = -self._from.inverse().compose(sense.odometry).x
        if backed >= self._distance:
            if abs(sense.velocity.linear) <= FOLLOWER.settled:
                return finished()
            return NavigationStep(ZERO, "RUNNING", progress=1.0)
        speed = min(params.speed, self._limits.reverse, 0.05 + (self._distance - backed))
        back = Velocity(linear=-speed, angular=0.0)
        done = self._check.fastest(sense.velocity, back, sense.hazards)
        if abs(sense.velocity.linear) > 0.01:
            self._moving_at = sense.now
        if sense.now - self._moving_at > params.patience:
            return failed(ReasonCode.BEHIND)
        reason = "" if done.velocity != ZERO else ReasonCode.BEHIND
        progress = min(max(backed / max(self._distance, 0.01), 0.0), 1.0)
        return NavigationStep(done.velocity, "RUNNING", reason, progress=progress)


class Undocking:
    """Back out far enough to turn; with `about`, turn to face away from the station."""

    needs_map = False

    def __init__(
        self,
        dock: ChargingDock | None,
        check: BrakeCheck,
        limits: Limits,
        circumscribed: float,
        *,
        about: bool,
        params: UndockingParams = UNDOCKING,
    ) -> None:
        self._params = params
        room = circumscribed + params.turning_room - (dock.station.distance if dock else 0.0)
        self._reverse = _Reverse(check, limits, max(params.distance, room), params)
        self._turn = Follower(check, limits) if about else None
        # the heading away from the station, in the odometry's frame
        self._away: float | None = None
        self._is_out = False
        self._held_since: float | None = None

    def step(self, sense: Sense) -> NavigationStep:
        """Return what to do now."""
        params = self._params
        if self._away is None:
            if not sense.charger_contact:
                return finished(ReasonCode.WAS_NOT_DOCKED)
            self._away = wrap_angle(sense.odometry.theta + math.pi)
        if self._is_out:
            return self._face_away(self._away, sense)
        step = self._reverse.step(sense)
        if step.status == "FINISHED" and sense.charger_contact:
            return failed(ReasonCode.STILL_DOCKED)
        if step.status == "FINISHED" and self._turn is not None:
            self._is_out = True
            return NavigationStep(ZERO, "RUNNING", progress=params.backed_share)
        if self._turn is not None and step.status == "RUNNING":
            return replace(step, progress=step.progress * params.backed_share)
        return step

    def _face_away(self, away: float, sense: Sense) -> NavigationStep:
        """Turn; done as well without room, or with a person in the way: the robot is out."""
        params = self._params
        assert self._turn is not None
        error = wrap_angle(away - sense.odometry.theta)
        turned = self._turn.turn(error, sense.velocity, sense.hazards, params.facing)
        if turned.state != "held":
            self._held_since = None
        elif self._held_since is None:
            self._held_since = sense.now
        if turned.state == "arrived" or (
            self._held_since is not None and sense.now - self._held_since > params.held_after
        ):
            return finished()
        share = 1.0 - abs(error) / math.pi
        progress = params.backed_share + (1.0 - params.backed_share) * share
        return NavigationStep(turned.velocity, "RUNNING", progress=progress)
