"""Into a charging station and out of it.

The map leads to a pose before the station; from there the station's own shape in the laser does,
because the contacts ask for more than a map can give. Where the station is seen is remembered in
the frame of the odometry, so that one bad sweep means nothing. A try that ends beside the contacts
is taken back and begun anew.

Distances in this file are in the frame of the docked robot: x < 0 before the station, y aside.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from robots.agent.navigation.assistance.braking import BrakeCheck, Hazards
from robots.agent.navigation.docking import station as shape
from robots.agent.navigation.planning.follower import SETTLED, Follower
from robots.agent.navigation.planning.steps import Sense, Step, failed, finished
from robots.agent.ramp import ZERO
from robots.api.docked import DOCKED, DockReading, DockState, follow
from robots.api.floorplan import Dock
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats, points_in_frame

BEFORE = 0.9  # where the last metre begins: metres from the docked pose
TRIES = 3
LOOK = 2.0  # seconds to find the station before the robot turns to look for it
GLANCE = 0.35  # radians to either side
FRESH = 0.5  # weight of a new sighting
SIGHTINGS = 3  # before the robot trusts them
LOST_AFTER = 2.5  # seconds without a sighting while farther than CLOSE
CLOSE = 0.25  # nearer than this a sighting is good to have, no longer needed: metres
FAST, SLOW, SLOWING = 0.2, 0.05, 0.4  # m/s, and m/s for each metre left
STEER, STEER_AHEAD, STEER_MOST = 1.6, 0.35, 0.4  # gain, metres, rad/s
ASIDE, ASKEW = 0.045, 0.1  # metres, radians: with more than this so near the contacts would miss
TOO_FAR_ASIDE = 0.3  # metres: begin anew from before the station
PUSH = 0.04  # pressed on beyond the docked pose, where the nose meets the station: metres
SEATED, SEATING = -0.015, 0.7  # a docked robot goes on to here, for at most so many seconds
COMING_TO_REST = 10.0  # seconds from the first contact in which a robot must be docked
ENTERING = 45.0  # seconds for the last metre, at most
STALLED = 2.5  # seconds for which the wheels are asked in vain
BACK_SPEED = 0.15  # m/s
STAND_BACK = 0.06  # room to turn that is left before the station: metres
OUT = 0.4  # metres to back out, at least
PATIENCE = 20.0  # seconds to wait until what stands behind is gone
FACING = 0.1  # radians from straight away from the station, when a robot has turned round
BACKED = 0.5  # progress of a robot that is out and has yet to turn
HELD_UP = 5.0  # seconds after which a robot that cannot turn leaves it at that
EXEMPT = 0.08  # what stands no farther before the station's front than this is the station: metres


class Task(Protocol):
    """Something that is stepped to its end."""

    def step(self, sense: Sense) -> Step:
        """Return what to do now."""


class Docking:
    """Drive into `dock`; `approach` makes the journey to a pose of the map."""

    def __init__(
        self, dock: Dock, check: BrakeCheck, limits: Limits, approach: Callable[[Pose2D], Task]
    ) -> None:
        self._contact_since: float | None = None
        self._seated = DockState()
        self._presses = True
        self._dock, self._check, self._limits, self._approach = dock, check, limits, approach
        self._pose = Pose2D(dock.x, dock.y, dock.theta)
        self._begin_try(0)

    @property
    def needs_map(self) -> bool:
        """Tell whether the robot has to know where it is on the map now."""
        return self._stage in {"approach", "look"} and self._seen == 0

    def step(self, sense: Sense) -> Step:
        """Return what to do now."""
        if sense.charger_contact and self._stage != "back":
            return self._seat(sense)
        self._contact_since, self._seated, self._presses = None, DockState(), True
        if self._stage == "approach":
            return self._come(sense)
        if self._stage == "back":
            return self._back(sense)
        self._sight(sense)
        return self._look(sense) if self._stage == "look" else self._enter(sense)

    # --- the stages -------------------------------------------------------------------------------

    def _begin_try(self, number: int) -> None:
        self._try, self._stage = number, "approach"
        self._way = self._approach(self._pose.compose(Pose2D(-BEFORE, 0.0, 0.0)))
        self._docked_in_odometry: Pose2D | None = None
        self._seen = 0
        self._since = self._seen_at = self._beams_at = -math.inf
        self._still_since: float | None = None
        self._waits = False
        self._out: _Reverse | None = None

    def _come(self, sense: Sense) -> Step:
        step = self._way.step(sense)
        if step.status == "FAILED":
            return failed(f"the charging station cannot be reached: {step.reason}")
        if step.status == "FINISHED":
            self._stage, self._since, self._glance = (
                "look",
                sense.now,
                Follower(self._check, self._limits),
            )
            self._straight_on = sense.odometry.theta
            return self._running(ZERO, "looks for the charging station", 0.7)
        return Step(step.velocity, "RUNNING", step.reason, step.path, step.progress * 0.7)

    def _look(self, sense: Sense) -> Step:
        """Stand and look; then turn a little to one side and to the other."""
        if self._seen >= SIGHTINGS:
            self._stage, self._since = "enter", sense.now
            return self._enter(sense)
        waited = sense.now - self._since
        if waited > 5.0 * LOOK:
            return self._again(sense, "no charging station is to be seen where the map has it")
        side = 0.0 if waited < LOOK else GLANCE if waited < 3.0 * LOOK else -GLANCE
        error = wrap_angle(self._straight_on + side - sense.odometry.theta)
        turned = self._glance.turn(error, sense.velocity, sense.hazards, 0.05)
        return self._running(turned.velocity, "looks for the charging station", 0.7)

    def _enter(self, sense: Sense) -> Step:
        here = self._error(sense)
        if sense.now - self._since > ENTERING:
            return self._again(
                sense,
                (
                    "something stands before it"
                    if self._waits
                    else "the contacts did not meet in time"
                ),
            )
        if here.x < -CLOSE and sense.now - self._seen_at > LOST_AFTER:
            return self._again(sense, "the charging station went out of sight")
        if self._off_course(here):
            return self._again(sense, "the robot came in beside the contacts")
        if here.x >= PUSH or self._stalled(sense):
            return self._again(sense, "the contacts did not meet")
        if abs(math.atan2(-here.y, STEER_AHEAD) - here.theta) > 0.5:
            turned = self._glance.turn(-here.theta, sense.velocity, self._others(sense), 0.1)
            return self._running(turned.velocity, "", 0.75)
        done = self._check.fastest(sense.velocity, self._servo(here), self._others(sense))
        self._waits = done.velocity == ZERO
        reason = "waits for what stands before the charging station" if self._waits else ""
        return self._running(
            done.velocity, reason, min(0.99, 0.75 + 0.25 * (1.0 + here.x / BEFORE))
        )

    def _seat(self, sense: Sense) -> Step:
        """The contacts meet: press on a little, so that they go on meeting; then stand until the
        robot is docked.
        """
        self._contact_since = sense.now if self._contact_since is None else self._contact_since
        velocity, released = sense.velocity, not self._presses
        reading = DockReading(
            at=sense.now,
            contact=True,
            linear=velocity.linear,
            angular=velocity.angular,
            released=released,
        )
        self._seated = follow(DOCKED, self._seated, reading)
        if self._seated.docked:
            return finished()
        if sense.now - self._contact_since >= COMING_TO_REST:
            return self._again(sense, "the robot did not come to rest on the contacts")
        deep = (
            self._docked_in_odometry is None
            or self._stage != "enter"
            or self._error(sense).x >= SEATED
        )
        self._presses = not deep and sense.now - self._contact_since < SEATING
        return self._running(
            Velocity(linear=SLOW, angular=0.0) if self._presses else ZERO, "", 0.99
        )

    def _again(self, sense: Sense, reason: str) -> Step:
        """Take a try back: out, and anew; or give up."""
        self._why = reason
        self._stage = "back"
        self._out = _Reverse(
            self._check,
            self._limits,
            max(0.0, BEFORE - 0.3 + self._error(sense).x) if self._docked_in_odometry else 0.0,
        )
        return self._running(ZERO, reason, 0.7)

    def _back(self, sense: Sense) -> Step:
        assert self._out is not None
        step = self._out.step(sense)
        if step.status == "RUNNING":
            return self._running(step.velocity or ZERO, f"{self._why}: backs out", 0.7)
        if self._try + 1 >= TRIES:
            return failed(f"the robot could not dock in {TRIES} tries: {self._why}")
        if step.status == "FAILED":
            return failed(f"{self._why}, and {step.reason}")
        self._begin_try(self._try + 1)
        return self._running(ZERO, "tries again", 0.5)

    # --- the last metre ---------------------------------------------------------------------------

    def _sight(self, sense: Sense) -> None:
        """Look for the station in a new sweep, near where it was last seen or
        where the map has it.
        """
        if sense.beams.stamp <= self._beams_at:
            return
        self._beams_at = sense.beams.stamp
        known = self._docked_in_odometry
        docked = (sense.pose.inverse() if known is None else sense.odometry.inverse()).compose(
            known or self._pose
        )
        at_sweep = sense.beams_from.inverse().compose(sense.odometry).compose(docked)
        ahead = Pose2D(self._dock.station.distance, 0.0, 0.0)
        window = shape.WIDE if self._seen < SIGHTINGS else shape.NARROW
        found = shape.find(sense.beams, at_sweep.compose(ahead), self._dock.station, window)
        if found is None:
            return
        seen = sense.beams_from.compose(found.front).compose(Pose2D(-ahead.x, 0.0, 0.0))
        self._docked_in_odometry = seen if known is None else _between(known, seen, FRESH)
        self._seen, self._seen_at = self._seen + 1, sense.now

    def _error(self, sense: Sense) -> Pose2D:
        """Return the pose of the robot in the frame of the docked one."""
        known = self._docked_in_odometry
        return (
            self._pose.inverse().compose(sense.pose)
            if known is None
            else known.inverse().compose(sense.odometry)
        )

    def _servo(self, here: Pose2D) -> Velocity:
        """Return the velocity that steers onto the line before the station and along it."""
        speed = min(FAST, self._limits.linear, SLOW + SLOWING * max(0.0, -here.x - 0.03))
        wanted = math.atan2(-here.y, STEER_AHEAD)
        turn = STEER * wrap_angle(wanted - here.theta) * min(1.0, speed / 0.1)
        return Velocity(linear=speed, angular=min(max(turn, -STEER_MOST), STEER_MOST))

    def _off_course(self, here: Pose2D) -> bool:
        near = -0.2 < here.x < -0.08
        return (near and (abs(here.y) > ASIDE or abs(here.theta) > 2.0 * ASKEW)) or abs(
            here.y
        ) > TOO_FAR_ASIDE

    def _others(self, sense: Sense) -> Hazards:
        """Return the hazards without the station and what is behind it."""
        docked = self._error(sense).inverse()
        front = self._dock.station.distance - EXEMPT
        half = self._dock.station.width / 2.0 + EXEMPT

        def elsewhere(points: Floats) -> Floats:
            local = points_in_frame(docked, points)
            chosen: Floats = points[
                (local[:, 0] < front)
                | ((np.abs(local[:, 1]) > half) & (local[:, 0] < front + EXEMPT))
            ]
            return chosen

        near = sense.hazards
        return Hazards(elsewhere(near.things), elsewhere(near.strangers), elsewhere(near.walkers))

    def _stalled(self, sense: Sense) -> bool:
        if (
            self._waits
            or abs(sense.velocity.linear) > SLOW / 3.0
            or sense.now - self._since < STALLED
        ):
            self._still_since = None
            return False
        self._still_since = sense.now if self._still_since is None else self._still_since
        return self._error(sense).x > -CLOSE and sense.now - self._still_since >= STALLED

    def _running(self, velocity: Velocity, reason: str, progress: float) -> Step:
        line = np.array(
            [[self._pose.compose(Pose2D(-BEFORE, 0.0, 0.0))[:2], self._pose[:2]]]
        ).reshape(2, 2)
        return Step(velocity, "RUNNING", reason, line, progress)


class _Reverse:
    """Back out straight by some metres; wait for what stands behind."""

    def __init__(self, check: BrakeCheck, limits: Limits, way: float) -> None:
        self._check, self._limits, self._way = check, limits, way
        self._from: Pose2D | None = None
        self._moving_at = -math.inf

    def step(self, sense: Sense) -> Step:
        if self._from is None:
            self._from, self._moving_at = sense.odometry, sense.now
        gone = -self._from.inverse().compose(sense.odometry).x
        if gone >= self._way:
            return (
                finished()
                if abs(sense.velocity.linear) <= SETTLED
                else Step(ZERO, "RUNNING", progress=1.0)
            )
        speed = min(BACK_SPEED, self._limits.reverse, 0.05 + (self._way - gone))
        done = self._check.fastest(
            sense.velocity, Velocity(linear=-speed, angular=0.0), sense.hazards
        )
        if abs(sense.velocity.linear) > 0.01:
            self._moving_at = sense.now
        if sense.now - self._moving_at > PATIENCE:
            return failed("something stands behind the robot")
        return Step(
            done.velocity,
            "RUNNING",
            "" if done.velocity != ZERO else "waits for what stands behind the robot",
            progress=min(max(gone / max(self._way, 0.01), 0.0), 1.0),
        )


class Undocking:
    """Back out far enough to turn; with `about`, turn round as well, so that the room is before the
    robot and no longer its station.
    """

    needs_map = False

    def __init__(
        self,
        dock: Dock | None,
        check: BrakeCheck,
        limits: Limits,
        circumscribed: float,
        *,
        about: bool,
    ) -> None:
        room = circumscribed + STAND_BACK - (dock.station.distance if dock else 0.0)
        self._reverse = _Reverse(check, limits, max(OUT, room))
        self._turn = Follower(check, limits) if about else None
        # the heading away from the station, in the odometry's frame
        self._away: float | None = None
        self._is_out = False
        self._held_since: float | None = None

    def step(self, sense: Sense) -> Step:
        """Return what to do now."""
        if self._away is None:
            if not sense.charger_contact:
                return finished("the robot was not docked")
            self._away = wrap_angle(sense.odometry.theta + math.pi)
        if self._is_out:
            return self._face_away(self._away, sense)
        step = self._reverse.step(sense)
        if step.status == "FINISHED" and sense.charger_contact:
            return failed("the robot is still in its charging station")
        if step.status == "FINISHED" and self._turn is not None:
            self._is_out = True
            return Step(ZERO, "RUNNING", progress=BACKED)
        return (
            replace(step, progress=step.progress * BACKED)
            if self._turn is not None and step.status == "RUNNING"
            else step
        )

    def _face_away(self, away: float, sense: Sense) -> Step:
        """Turn; the robot is out already, so that it is done too where it has no room or somebody
        stays in the way.
        """
        assert self._turn is not None
        error = wrap_angle(away - sense.odometry.theta)
        turned = self._turn.turn(error, sense.velocity, sense.hazards, FACING)
        if turned.state != "held":
            self._held_since = None
        elif self._held_since is None:
            self._held_since = sense.now
        if turned.state == "arrived" or (
            self._held_since is not None and sense.now - self._held_since > HELD_UP
        ):
            return finished()
        return Step(
            turned.velocity,
            "RUNNING",
            progress=BACKED + (1.0 - BACKED) * (1.0 - abs(error) / math.pi),
        )


def _between(old: Pose2D, new: Pose2D, share: float) -> Pose2D:
    """Return the pose `share` of the way from old to new."""
    return Pose2D(
        old.x + share * (new.x - old.x),
        old.y + share * (new.y - old.y),
        wrap_angle(old.theta + share * wrap_angle(new.theta - old.theta)),
    )
