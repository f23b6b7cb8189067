"""Builds one `RcaState` from an RCA's readings, which arrive one by one. Pure: times are given.

Where the RCA localizes itself now and then (amcl only while the robot moves) and counts its wheels
always, the pose is carried on by the odometry: at the moment of a fix, map_from_odometry = fix *
odometry^-1. An RCA that gives poses only gets its velocity from them, over a window long enough
that the noise of single poses counts little.
"""

import math
from collections import defaultdict, deque

import msgspec

from robots.agent.adapters.common.robot_profile import BatteryRange
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import (
    NOWHERE,
    UNKNOWN_BATTERY,
    ObstaclePoints,
    RcaState,
    SonarEcho,
)
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Battery, Pose, Scan, Velocity

REMEMBERED = 200  # odometries: some seconds
WINDOW = 0.3  # seconds over which poses become a velocity
FASTEST, FASTEST_TURN = 3.0, 6.0  # m/s and rad/s: faster is a new fix, not a motion
CLOCK_SKEW = 0.5  # seconds by which a stamp differs from its arrival while the clocks agree
LATEST = 5.0  # seconds by which a message may be late without doubt about its clock
TICK = 1e-4  # seconds: stamps grow, whatever clocks do


class StampClock:
    """The clock of one of the RCA's topics. Once it has agreed with ours, older stamps are of late
    messages. A clock that is not synchronized, or of a simulation, never agrees.
    """

    def __init__(self) -> None:
        self._agrees = False

    def believed(self, stamp: float, arrived: float) -> float:
        """Return the stamp of a message where the clock agrees, else its arrival; Unix time."""
        late = arrived - stamp
        self._agrees = abs(late) < CLOCK_SKEW or (self._agrees and 0.0 < late < LATEST)
        return stamp if self._agrees else arrived


class Readings:
    """The newest of each reading.

    `last_received_at` is when (monotonic) the RCA last reported a pose or velocity, `fixed_at` when
    its localization did.
    """

    def __init__(self, battery: BatteryRange | None = None) -> None:
        self.last_received_at = self.fixed_at = -math.inf
        self.fresh = False
        self.charger_contact = False
        self.estop: bool | None = None  # None until it is reported
        self.tilt: float | None = None
        self.errors: tuple[str, ...] = ()
        self.odometry: Pose2D | None = None
        self._range = battery
        self._battery = UNKNOWN_BATTERY
        self._velocity: Velocity | None = None
        self._track: deque[tuple[float, Pose2D]] = deque(maxlen=REMEMBERED)
        self._fix = NOWHERE
        self._map_from_odometry: Pose2D | None = None
        self._scan: Scan | None = None
        self._distance = 0.0
        self._touching = False
        self._bumper: tuple[float, ...] | None = None
        self._sonar: deque[SonarEcho] = deque(maxlen=REMEMBERED)
        self._points: ObstaclePoints | None = None
        self._contacts = 0
        self._measured = self._stamp = 0.0  # stamps of the newest measurement, and of the state
        self._clocks: defaultdict[str, StampClock] = defaultdict(StampClock)

    def believed(self, topic: str, stamp: float, arrived: float) -> float:
        """Return when a message of a topic was measured; all in Unix time."""
        return self._clocks[topic].believed(stamp, arrived)

    def moved(self, odometry: Pose2D, velocity: Velocity | None, stamp: float, now: float) -> None:
        """Take dead reckoning in any frame; `velocity` is None where the RCA measures none."""
        self._advance(odometry, stamp)
        self.odometry, self._velocity = odometry, velocity
        self._received(stamp, now)

    def located(self, pose: Pose, stamp: float, now: float) -> None:
        """Take the RCA's own pose in the map; without odometry, velocities follow from it too."""
        self._fix, self.fixed_at = pose, now
        here = Pose2D(pose.x, pose.y, pose.theta)
        if self.odometry is None:
            self._advance(here, stamp)
            self._received(stamp, now)
        else:
            then = min(self._track, key=lambda entry: abs(entry[0] - stamp))[1]
            self._map_from_odometry = here.compose(then.inverse())

    def corrected(self, map_from_odometry: Pose2D, now: float, score: float = 1.0) -> None:
        """Take the frame of the odometry in the map, as a localization on tf publishes it."""
        self._map_from_odometry, self.fixed_at = map_from_odometry, now
        self._fix = msgspec.structs.replace(NOWHERE, localized=True, score=score)

    def lost(self, now: float) -> None:
        """Note that the RCA has lost its pose."""
        self._fix, self._map_from_odometry, self.fixed_at = NOWHERE, None, now
        if self.odometry is None:
            self._track.clear()  # a velocity must not be computed across the loss

    def scanned(self, scan: Scan) -> None:
        self._scan = scan

    def charged(
        self,
        *,
        voltage: float | None = None,
        charge: float | None = None,
        charging: bool | None = None,
    ) -> None:
        """Take the battery, which charges only in the dock; without `charge`, volts decide."""
        if charge is None and voltage is not None and self._range is not None:
            charge = self._range.charge(voltage)
        known = None if charge is None or not math.isfinite(charge) else min(1.0, max(0.0, charge))
        self._battery = Battery(charge=known, voltage=voltage, charging=charging)
        self.charger_contact = charging is True

    def bumped(self, *, touching: bool, bearings: tuple[float, ...] | None = None) -> None:
        """Take the bumpers; `bearings` in radians in the robot's frame, None if unknown."""
        self._contacts += touching and not self._touching
        self._touching, self._bumper = touching, bearings

    def echoed(self, sonar: int, distance: float | None, stamp: float) -> None:
        """Take a measurement of a sonar of the profile: metres, None without an echo."""
        self._sonar.append(SonarEcho(sonar, stamp, distance))

    def saw(self, points: ObstaclePoints) -> None:
        self._points = points

    @property
    def velocity(self) -> Velocity:
        """The measured velocity, else an estimate from the poses."""
        return self._velocity if self._velocity is not None else self._estimate()

    @property
    def pose(self) -> Pose:
        """The last fix in the map, carried on by the odometry."""
        if self._map_from_odometry is None or self.odometry is None or not self._fix.localized:
            return self._fix
        x, y, theta = self._map_from_odometry.compose(self.odometry)
        return msgspec.structs.replace(self._fix, x=x, y=y, theta=theta)

    def state(self, unix: float) -> RcaState:
        """Return all of it; obstacles once only. Stamps grow; a repeated state has `unix`."""
        is_measured, self.fresh = self.fresh, False
        self._stamp = max(self._measured if is_measured else unix, self._stamp + TICK)
        # without odometry or a pose the robot counts as at rest; else it could not be driven
        measures_nothing = self.odometry is None and not self._fix.localized
        scan, self._scan = self._scan, None
        points, self._points = self._points, None
        sonar = tuple(self._sonar)
        self._sonar.clear()
        return RcaState(
            stamp=self._stamp,
            pose=self.pose,
            velocity=self.velocity,
            battery=self._battery,
            charger_contact=self.charger_contact,
            tilt=self.tilt,
            contacts=self._contacts,
            distance=self._distance,
            scan=scan,
            errors=self.errors,
            estop=self.estop,
            odometry=self.odometry,
            sonar=sonar,
            bumper=self._bumper,
            points=points,
            is_measured=is_measured or measures_nothing,
            odometry_stamp=None if self.odometry is None else self._measured,
        )

    def _received(self, stamp: float, now: float) -> None:
        self.last_received_at, self.fresh, self._measured = now, True, stamp

    def _advance(self, here: Pose2D, stamp: float) -> None:
        if self._track:
            before_stamp, before = self._track[-1]
            stamp = max(stamp, before_stamp + TICK)
            step, turn = before.distance(here), abs(wrap_angle(here.theta - before.theta))
            elapsed = max(stamp - before_stamp, 0.02)
            if step > FASTEST * elapsed or turn > FASTEST_TURN * elapsed:
                self._track.clear()  # it was carried, or its localization corrected itself
            else:
                self._distance += step
        self._track.append((stamp, here))

    def _estimate(self) -> Velocity:
        if len(self._track) < 2:
            return ZERO
        stamp, here = self._track[-1]
        past = [entry for entry in self._track if stamp - entry[0] <= WINDOW]
        began, there = past[0]
        if len(past) < 2 or there == here or stamp - began < WINDOW / 4:
            return ZERO
        moved = there.inverse().compose(here)
        return Velocity(
            linear=moved.x / (stamp - began),
            angular=wrap_angle(here.theta - there.theta) / (stamp - began),
        )
