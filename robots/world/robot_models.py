"""The robots that can be simulated, as data.

Giraff: wheel separation, speeds, accelerations and the range of the head's height are the
manufacturer's; rhodon is a Pioneer PatrolBot base (0.51 m x 0.425 m) with a fixed camera on a mast.
Braking, cameras, lasers and batteries are chosen so that the floor in front is in view and a charge
lasts a working day.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Camera, Limits, TiltRange


class UnknownProfileError(ValueError):
    """There is no such robot; the message lists the existing ones."""


@dataclass(frozen=True)
class LaserModel:
    """A planar scanner: `x` ahead of the centre, `height` above the floor, beams over `fov`
    radians, `rate` in Hz.

    `noise` is the standard deviation of a range in metres, `dropout` the share of beams that are
    lost.
    """

    x: float
    height: float
    fov: float
    beams: int
    range_max: float
    rate: float = 20.0
    noise: float = 0.01
    dropout: float = 0.005

    @property
    def mount(self) -> Pose2D:
        """Its pose in the robot's frame."""
        return Pose2D(self.x, 0.0, 0.0)

    @property
    def angle_min(self) -> float:
        """Direction of the first beam in the robot's frame."""
        return -self.fov / 2.0

    @property
    def angle_increment(self) -> float:
        """Radians from beam to beam."""
        return self.fov / (self.beams - 1)


@dataclass(frozen=True)
class SonarModel:
    """A ring of ultrasonic sensors at the edge of the footprint: `count` of them, the first looks
    ahead, each with a cone of `width` radians.

    Metres: from `nearest` to `farthest`, `noise` is a standard deviation, `dropout` the share of
    echoes that are lost. A smooth wall gives no echo beyond `slant` radians from its normal, except
    within `edge` metres of an edge. `volley` of them, spread evenly, sound every `period` seconds.
    Similar to a Devantech SRF08.
    """

    count: int = 16
    width: float = math.radians(30.0)
    nearest: float = 0.05
    farthest: float = 4.0
    noise: float = 0.01
    dropout: float = 0.01
    slant: float = math.radians(25.0)
    edge: float = 0.04
    volley: int = 4
    period: float = 0.04

    def mounts(self, footprint: tuple[tuple[float, float], ...]) -> tuple[Pose2D, ...]:
        """Return their poses in the robot's frame: at the edge of a convex footprint."""
        bearings = (2.0 * math.pi * index / self.count for index in range(self.count))
        return tuple(_edge_at(footprint, bearing) for bearing in bearings)

    def sounding(self, volley: int) -> tuple[int, ...]:
        """Return the indices of those that sound in the volley of that number."""
        apart = self.count // self.volley
        return tuple(range(volley % apart, self.count, apart))


def _edge_at(footprint: tuple[tuple[float, float], ...], bearing: float) -> Pose2D:
    """Return the point of a footprint's edge in a direction from the centre, facing outwards."""
    along_x, along_y = math.cos(bearing), math.sin(bearing)
    reach = math.inf
    for (x0, y0), (x1, y1) in zip(footprint, (*footprint[1:], footprint[0]), strict=True):
        across = along_x * (y1 - y0) - along_y * (x1 - x0)
        if across > 0.0:  # counter-clockwise: the side faces that direction
            reach = min(reach, (x0 * (y1 - y0) - y0 * (x1 - x0)) / across)
    return Pose2D(reach * along_x, reach * along_y, wrap_angle(bearing))


@dataclass(frozen=True)
class BatteryModel:
    """Capacity in Wh, powers in W: `idle` always, `drive` on top at full speed, `charge` into it in
    the dock; volts by charge.
    """

    capacity: float
    idle: float
    drive: float
    charge: float
    empty_voltage: float
    full_voltage: float


@dataclass(frozen=True)
class BodyPart:
    """A piece of the robot's body as a mirror shows it, in the robot's frame; `face` is what its
    front looks like.
    """

    x: float
    y: float
    width: float
    depth: float
    bottom: float
    top: float
    colour: str
    shape: Literal["box", "cylinder"] = "box"
    face: Literal["plain", "screen"] = "plain"


@dataclass(frozen=True)
class DockTolerance:
    """The distance from the dock's pose within which the contacts meet: metres ahead or back,
    metres aside, radians.

    They are on springs: once they meet, they keep contact until the robot is `travel` metres, or
    `twist` radians, farther away.
    """

    longitudinal: float = 0.07
    lateral: float = 0.08
    heading: float = 0.2
    travel: float = 0.015
    twist: float = 0.05


@dataclass(frozen=True)
class OdometryModel:
    """Systematic errors of the wheels' encoders: standard deviations among robots, as shares of the
    true value.
    """

    radius_error: float = 0.005
    separation_error: float = 0.01


@dataclass(frozen=True)
class RobotModel:
    """Everything about one kind of robot; the simulation chooses which of its sensors are fitted.

    `wheel_noise` is the relative slip of a wheel (standard deviation over one metre).
    """

    series: str
    title: str
    limits: Limits
    footprint: tuple[tuple[float, float], ...]
    wheel_separation: float
    camera: Camera
    tilt: TiltRange | None
    laser: LaserModel
    battery: BatteryModel
    body: tuple[BodyPart, ...]
    watchdog: float = 0.3
    wheel_noise: float = 0.008
    odometry: OdometryModel = field(default_factory=OdometryModel)
    dock: DockTolerance = field(default_factory=DockTolerance)
    sonar: SonarModel = field(default_factory=SonarModel)

    @property
    def radius(self) -> float:
        """Radius of the circle about the robot's centre that holds its footprint."""
        return max(math.hypot(x, y) for x, y in self.footprint)


def octagon(length: float, width: float, corner: float) -> tuple[tuple[float, float], ...]:
    """Return a rectangle with its corners cut, counter-clockwise, x along its length."""
    x, y = length / 2.0, width / 2.0
    right = ((-x, -y + corner), (-x + corner, -y), (x - corner, -y), (x, -y + corner))
    return (*right, *((-a, -b) for a, b in right))


GIRAFF = RobotModel(
    series="giraff",
    title="Giraff",
    limits=Limits(
        linear=0.7,
        reverse=0.3,
        angular=0.7,
        linear_acceleration=0.2,
        angular_acceleration=0.4,
        linear_braking=0.8,
        angular_braking=1.6,
    ),
    footprint=octagon(0.64, 0.56, 0.14),
    wheel_separation=0.467,
    camera=Camera(width=640, height=480, fps=30.0, hfov=1.5, x=0.1, z=1.32, pitch=0.0),
    tilt=TiltRange(minimum=-0.5, maximum=0.9, home=0.28, speed=0.8),
    laser=LaserModel(x=0.22, height=0.3, fov=math.radians(240.0), beams=241, range_max=10.0),
    battery=BatteryModel(
        capacity=260.0, idle=32.0, drive=45.0, charge=120.0, empty_voltage=24.0, full_voltage=29.0
    ),
    body=(
        BodyPart(0.0, 0.0, 0.62, 0.54, 0.04, 0.16, "#c3c7ca"),
        BodyPart(-0.04, 0.0, 0.34, 0.30, 0.16, 0.30, "#8e969e"),
        BodyPart(-0.06, 0.0, 0.09, 0.09, 0.30, 1.12, "#a9afb6", "cylinder"),
        BodyPart(0.02, 0.0, 0.10, 0.38, 1.08, 1.44, "#d7dadb", face="screen"),
    ),
)

RHODON = RobotModel(
    series="rhodon",
    title="Rhodon",
    limits=Limits(
        linear=0.5,
        reverse=0.25,
        angular=1.0,
        linear_acceleration=0.3,
        angular_acceleration=0.8,
        linear_braking=0.8,
        angular_braking=2.0,
    ),
    footprint=octagon(0.51, 0.425, 0.11),
    wheel_separation=0.38,
    camera=Camera(width=640, height=480, fps=30.0, hfov=1.4, x=0.12, z=1.15, pitch=0.26),
    tilt=None,
    laser=LaserModel(x=0.15, height=0.28, fov=math.radians(180.0), beams=181, range_max=12.0),
    battery=BatteryModel(
        capacity=430.0, idle=55.0, drive=70.0, charge=180.0, empty_voltage=22.0, full_voltage=27.6
    ),
    body=(
        BodyPart(0.0, 0.0, 0.50, 0.42, 0.05, 0.38, "#b3322b"),
        BodyPart(-0.05, 0.0, 0.32, 0.32, 0.38, 0.46, "#2d2f33"),
        BodyPart(-0.1, 0.0, 0.07, 0.07, 0.46, 1.05, "#5c6066", "cylinder"),
        BodyPart(0.12, 0.12, 0.06, 0.06, 0.46, 0.80, "#e0a030", "cylinder"),
        BodyPart(0.20, 0.12, 0.22, 0.06, 0.80, 0.86, "#e0a030"),
        BodyPart(0.0, 0.0, 0.08, 0.30, 1.02, 1.26, "#34373c", face="screen"),
    ),
)

MODELS = {model.series: model for model in (GIRAFF, RHODON)}


def model_of(series: str) -> RobotModel:
    """Return a robot by its series name.

    Raises:
        UnknownProfileError: there is no such robot.
    """
    if series not in MODELS:
        raise UnknownProfileError(
            f"no robot profile {series!r}: the simulator has {', '.join(sorted(MODELS))},"
            " and takes no file"
        )
    return MODELS[series]
