"""A simulated robot that navigates by itself, without an agent: simulation, obstacle memory,
localization and navigator, stepped.

The robot's own belief of where it is comes from the real localizer, or is the truth with an error
of a given size that changes slowly. The simulation goes at 50 Hz, laser, localizer and navigator at
10 Hz.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from robots.agent.localization.localizer import Localizer
from robots.agent.navigation.navigator import Navigator
from robots.agent.navigation.planning.steps import NavigationStep
from robots.agent.safety.collision.memory import RollingObstacleMap
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Velocity
from robots.simulator.physics.simulation import Simulation
from robots.world.grid import OccupancyGrid
from robots.world.render_plan import with_stations
from robots.world.sensing import Estimate, LaserScan

DT = 0.02
TICKS = 5  # of the simulation a step of navigation
REACH = 0.6  # metres from the robot's centre to that of somebody who touches it, at most
MOVING = 0.02  # m/s of the fastest corner from which a contact is a collision


@dataclass
class Wander:
    """An error of a pose that changes slowly: `metres` and `radians` are standard deviations,
    `seconds` how long it remembers itself.
    """

    rng: np.random.Generator
    metres: float = 0.05
    radians: float = math.radians(1.0)
    seconds: float = 5.0
    error: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.error = self.rng.standard_normal(3)

    def of(self, truth: Pose2D, dt: float) -> Pose2D:
        keep = math.exp(-dt / self.seconds)
        self.error = keep * self.error + math.sqrt(1.0 - keep * keep) * self.rng.standard_normal(3)
        x, y, turn = self.error
        axis = self.metres / math.sqrt(2.0)
        return Pose2D(
            truth.x + axis * x, truth.y + axis * y, wrap_angle(truth.theta + self.radians * turn)
        )


class Rig:
    """`sim` and the `navigator` that drives it. `collisions` counts contacts that began while the
    robot moved; `bumps` how often somebody walked into it meanwhile; `seen_collisions` those of
    both that happened before the eyes of its laser.
    """

    def __init__(
        self, sim: Simulation, grid: OccupancyGrid, seed: int, *, localizer: bool = False
    ) -> None:
        self.sim = sim
        grid = with_stations(grid, sim.plan)
        self.navigator = Navigator(
            grid, sim.plan, sim.footprint, sim.model.limits, sim.model.series
        )
        self.memory = RollingObstacleMap()
        self.wander = Wander(np.random.default_rng([seed, 1]))
        self.localizer = Localizer(grid, np.random.default_rng([seed, 2])) if localizer else None
        if self.localizer:
            self.localizer.set_pose(sim.pose, 0.1, 0.05)
        self.laser_works = self.knows_where = True
        self.wheels_turn = True
        self.velocity = Velocity(linear=0.0, angular=0.0)
        self.collisions = 0
        self.bumps = self.seen_collisions = 0
        self.collided_with: list[str] = []
        self.reasons: list[str] = []
        self.beams: LaserScan | None = None
        self.trail: list[Pose2D] = []

    def step(self) -> NavigationStep:
        """Let a tenth of a second pass."""
        self._sense()
        done = self.navigator.step(
            estimate=self._estimate(),
            odometry=self.sim.odometry,
            velocity=self._measured(),
            beams=self.beams,
            points=self.memory.near(self.sim.odometry, 3.0),
            charger_contact=self.sim.docked,
            now=self.sim.time,
        )
        if done.reason and (not self.reasons or self.reasons[-1] != done.reason):
            self.reasons.append(done.reason)
        if done.velocity is not None:
            self.velocity = done.velocity
        for _ in range(TICKS):
            if done.velocity is not None and self.wheels_turn:
                self.sim.command(self.velocity.linear, self.velocity.angular)
            self._tick()
        self.trail.append(self.sim.pose)
        return done

    def run(self, seconds: float) -> NavigationStep:
        """Step until the task has ended, `seconds` at most; return the last step."""
        for _ in range(round(seconds / (DT * TICKS))):
            done = self.step()
            if done.status != "RUNNING":
                break
        return done

    def settle(self) -> None:
        """Let the robot come to a stand."""
        for _ in range(10):
            self.step()

    def _tick(self) -> None:
        before, bumped, touching = self.sim.contacts, self.sim.bumped, self.sim.touching
        moving = (
            abs(self.sim.motion.linear) + self.sim.model.radius * abs(self.sim.motion.angular)
            > MOVING
        )
        self.sim.step(DT)
        if not moving or (self.sim.contacts == before and self.sim.bumped == bumped):
            return
        self.bumps += self.sim.bumped - bumped
        self.collisions += self.sim.contacts - before
        new = sorted(self.sim.touching - touching)
        self.collided_with += new
        person = self._nearest_person()
        known = [name for name in new if not name.startswith("person")]
        self.seen_collisions += len(known) + (1 if person is not None and self._sees(person) else 0)

    def _nearest_person(self) -> tuple[float, float] | None:
        """Return the nearest person as the robot sees them, when they touch it."""
        near = [self.sim.pose.inverse().apply(person.x, person.y) for person in self.sim.people]
        touching = [spot for spot in near if math.hypot(*spot) < REACH]
        return min(touching, key=lambda spot: math.hypot(*spot), default=None)

    def _sees(self, spot: tuple[float, float]) -> bool:
        laser = self.sim.model.laser
        return abs(math.atan2(spot[1], spot[0] - laser.x)) <= laser.fov / 2.0

    def _sense(self) -> None:
        if self.laser_works:
            laser = self.sim.model.laser
            mount = Pose2D(laser.x, 0.0, 0.0)
            self.beams = LaserScan(
                self.sim.time,
                laser.angle_min,
                laser.angle_increment,
                laser.range_max,
                self.sim.scan(),
                mount,
            )
            self.memory.update(self.sim.odometry, self.beams)

    def _estimate(self) -> Estimate:
        if self.localizer:
            return self.localizer.update(
                self.sim.time, self.sim.odometry, self.beams, docked=self.sim.docked
            )
        score = 0.9 if self.knows_where else 0.1
        covariance = (0.002, 0.0, 0.0, 0.002, 0.0, 0.0003)
        return Estimate(
            self.sim.time,
            self.wander.of(self.sim.pose, DT * TICKS),
            covariance,
            score,
            self.knows_where,
        )

    def _measured(self) -> Velocity:
        return Velocity(linear=self.sim.motion.linear, angular=self.sim.motion.angular)
