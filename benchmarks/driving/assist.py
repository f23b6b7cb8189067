"""The benefit of assisted driving: collisions of a careless driver, and doors passed by a novice.

The careless driver holds forward, turns at random, and reverses or turns away only when the robot
no longer moves, with every robot in every shipped site. A collision is a contact that begins while
the robot moves (its fastest corner above 0.02 m/s). The novice sees the video with 0.3 s of delay,
aims some degrees beside the middle of the door, presses and releases keys too late, and backs off
when stuck. Each start is driven once at each level.

With sonars and a bumper instead of the laser, the careless driver may touch obstacles, but only at
a creep.

The simulation is headless and faster than real time: the world at 50 Hz, the laser at its own rate.
Results are for seeds from 1000; seeds below were used for tuning (`--first`). There are `--runs`
drives of `--minutes` each, per robot, site and level.
"""

import argparse
import itertools
import math
import sys
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from benchmarks.table import Figure, keep
from robots.agent.adapters.simulator.adapter import fitted, profile_of
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import NOWHERE, UNKNOWN_BATTERY, RcaState, SonarEcho
from robots.agent.safety.collision_monitor import MONITOR, monitor_of
from robots.agent.safety.contacts import sides_of
from robots.api.floorplan import FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import AssistLevel, Scan, Velocity
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import MODELS, RobotModel
from robots.world.sites import load_site, shipped_sites
from tests.support.agents.kernel_bench import Bench

TICK = 0.02
COMMANDED, RENEWED = 3, 250  # ticks between two commands, and between two renewals of the lease
STANDS = 0.02
LASER, BLIND = ("laser",), ("sonar", "bumper")
SENSORS = {"": LASER, " by sonar and bumper": BLIND}
LEVELS: tuple[AssistLevel, ...] = ("off", "slow", "steer")
JUDGED = 1000
REACTION = 0.3
PATIENCE = 60.0


class Rig:
    """A simulated robot whose driver's commands go through the safety kernel, as the agent has it:
    odometry and sensors in, velocities out.

    `touches` are contacts of any speed, `collisions` those above `STANDS`, `hardest` the speed in
    m/s of the fastest corner at the hardest. `sensors` are those that are fitted: "laser", "sonar",
    "bumper".
    """

    def __init__(
        self, simulation: Simulation, level: AssistLevel, sensors: tuple[str, ...] = LASER
    ) -> None:
        self.world = simulation
        model = simulation.model
        self.monitor = monitor_of(fitted(profile_of(model, "", has_camera=False), model, sensors))
        assert self.monitor is not None
        self.bench = Bench(limits=model.limits, watchdog=model.watchdog, monitor=self.monitor)
        self.bench.kernel.assist.level = level
        self.collisions, self.touches, self.hardest = 0, 0, 0.0
        self.seconds: list[float] = []
        self._sensors = sensors
        self.delay = 0.0  # seconds after which readings arrive
        self._ticks = itertools.count()
        self._readings: deque[tuple[float, RcaState]] = deque()
        self._scan_due = self._sonar_due = 0.0
        self._volley = 0

    def drive(self, wanted: Velocity) -> None:
        bench, tick, motion = self.bench, next(self._ticks), self.world.motion
        bench.now += TICK
        if tick % RENEWED == 0:
            bench.lease(renewal=tick, ttl=60.0)
            bench.know_clock(every=0.0)
        self._readings.append((bench.now + self.delay, self._reading()))
        while self._readings and self._readings[0][0] <= bench.now:
            self.monitor.sense(self._readings.popleft()[1], bench.now)
        bench.motion = Velocity(linear=motion.linear, angular=motion.angular)
        began = time.thread_time()
        if tick % COMMANDED == 0:
            bench.drive(wanted.linear, wanted.angular)
        else:
            bench.tick()
        self.seconds.append(time.thread_time() - began)
        self._step()
        bench.outputs.clear()

    @property
    def last_sent(self) -> Velocity:
        return self.bench.kernel.commanded

    @property
    def why(self) -> str:
        return self.monitor.why(self.bench.now)[0]

    @property
    def stands(self) -> bool:
        return self._speed() < STANDS

    def _speed(self) -> float:
        return abs(self.world.motion.linear) + self.world.model.radius * abs(
            self.world.motion.angular
        )

    def _step(self) -> None:
        self.world.command(self.last_sent.linear, self.last_sent.angular)
        speed, before, felt = self._speed(), self.world.contacts, sides_of(self.world.bumper())
        self.world.step(TICK)
        began = self.world.contacts - before
        self.touches += began
        self.collisions += began if speed > STANDS else 0
        self.hardest = max(self.hardest, speed if began else 0.0)
        if "bumper" in self._sensors and (felt := sides_of(self.world.bumper()) - felt):
            self.bench.kernel.touched(felt)

    def _reading(self) -> RcaState:
        world, now = self.world, self.bench.now
        scan, sonar = None, ()
        if (
            "laser" in self._sensors
            and self._is_due("_scan_due", 1.0 / world.model.laser.rate)
            and (beams := world.beams()) is not None
        ):
            ranges = tuple(
                value if math.isfinite(value) else None for value in beams.ranges.tolist()
            )
            scan = Scan(
                stamp=now,
                angle_min=beams.angle_min,
                angle_increment=beams.angle_increment,
                range_max=beams.range_max,
                ranges=ranges,
            )
        if "sonar" in self._sensors and self._is_due("_sonar_due", world.model.sonar.period):
            sounding = world.model.sonar.sounding(self._volley)
            self._volley += 1
            sonar = tuple(
                SonarEcho(*each)
                for each in zip(
                    sounding, itertools.repeat(now), world.echoes(sounding), strict=False
                )
            )
        return RcaState(
            stamp=now,
            pose=NOWHERE,
            velocity=self.bench.motion or ZERO,
            battery=UNKNOWN_BATTERY,
            odometry=world.odometry,
            scan=scan,
            sonar=sonar,
            bumper=world.bumper() if "bumper" in self._sensors else None,
        )

    def _is_due(self, name: str, period: float) -> bool:
        if self.world.time + 1e-9 < getattr(self, name):
            return False
        setattr(self, name, self.world.time + period)
        return True


@dataclass
class Careless:
    """Holds forward and turns at random; turns on the spot or goes back when nothing moves, and
    does not look where.
    """

    rng: np.random.Generator
    stick: Velocity = ZERO
    until: float = 0.0
    stood: float = 0.0

    def wish(self, rig: Rig) -> Velocity:
        now, limits = rig.world.time, rig.world.model.limits
        self.stood = self.stood + TICK if rig.stands else 0.0
        if self.stood > 1.5:
            self.stood, self.until = 0.0, now + float(self.rng.uniform(0.5, 4.0))
            back = -limits.reverse if self.rng.random() < 0.3 else 0.0
            self.stick = Velocity(
                linear=back, angular=float(self.rng.choice([-1.0, 1.0])) * limits.angular
            )
        elif now >= self.until:
            self.until = now + float(self.rng.uniform(0.3, 4.0))
            turn = float(self.rng.choice([0.0, 0.0, 1.0, -1.0, float(self.rng.uniform(-1.0, 1.0))]))
            self.stick = Velocity(linear=limits.linear, angular=turn * limits.angular)
        return self.stick


def careless_drive(
    plan: FloorPlan,
    model: RobotModel,
    level: AssistLevel,
    seed: int,
    minutes: float,
    *,
    sensors: tuple[str, ...] = LASER,
) -> Rig:
    rng = np.random.default_rng(seed)
    start = plan.starts[int(rng.integers(len(plan.starts)))].name
    rig = Rig(Simulation(model, plan, seed=seed, start=start, charge=1.0), level, sensors)
    driver = Careless(rng)
    while rig.world.time < 60.0 * minutes:
        rig.drive(driver.wish(rig))
        rig.world.charge = 1.0
    return rig


@dataclass(frozen=True)
class Crossing:
    """A way through a door: its middle, and the direction through it."""

    name: str
    x: float
    y: float
    theta: float

    def beyond(self, ahead: float, aside: float = 0.0) -> tuple[float, float]:
        return Pose2D(self.x, self.y, self.theta).apply(ahead, aside)

    def within(self, pose: Pose2D) -> tuple[float, float]:
        """Return how far a robot is beyond the door, and how far to the left of its middle."""
        return Pose2D(self.x, self.y, self.theta).inverse().apply(pose.x, pose.y)


@dataclass
class Novice:
    """Steers with keys towards the middle of a door and then beyond it, seeing what was `REACTION`
    seconds ago.
    """

    rng: np.random.Generator
    door: Crossing
    seen: deque[Pose2D] = field(default_factory=deque)
    error: float = 0.0
    turning: float = 0.0
    stood: float = 0.0
    back_until: float = 0.0
    ahead: bool = False

    def wish(self, rig: Rig) -> Velocity:
        """Return which keys are pressed now."""
        world, limits = rig.world, rig.world.model.limits
        self.seen.append(world.pose)
        if len(self.seen) <= REACTION / TICK:
            return ZERO
        pose = self.seen.popleft()
        # The error of the eye wanders, 8 degrees (standard deviation) in some seconds.
        self.error += -self.error * TICK / 2.0 + math.radians(8.0) * math.sqrt(TICK) * float(
            self.rng.standard_normal()
        )
        along, aside = self.door.within(pose)
        goal = self.door.beyond(1.1 if along > -0.4 or abs(aside) < 0.15 else 0.0)
        wrong = wrap_angle(math.atan2(goal[1] - pose.y, goal[0] - pose.x) + self.error - pose.theta)
        pressed = abs(wrong) > math.radians(10.0) or (
            self.turning != 0.0 and abs(wrong) > math.radians(4.0)
        )
        self.turning = math.copysign(1.0, wrong) if pressed else 0.0
        self.stood = self.stood + TICK if rig.stands else 0.0
        if self.stood > 1.2:
            self.stood, self.back_until = 0.0, world.time + float(self.rng.uniform(1.5, 3.0))
        if world.time < self.back_until:
            return Velocity(linear=-limits.reverse, angular=0.0)
        self.ahead = abs(wrong) < math.radians(40.0 if self.ahead else 15.0)
        return Velocity(
            linear=limits.linear if self.ahead else 0.0, angular=self.turning * limits.angular
        )


def crossings(plan: FloorPlan) -> list[Crossing]:
    found = []
    for gap in (*plan.doors, *plan.passages):
        (x0, y0), (x1, y1) = gap.start, gap.end
        across = math.atan2(y1 - y0, x1 - x0) + math.pi / 2.0
        found += [
            Crossing(gap.name, (x0 + x1) / 2.0, (y0 + y1) / 2.0, wrap_angle(across + turn))
            for turn in (0.0, math.pi)
        ]
    return found


def novice_start(
    plan: FloorPlan, model: RobotModel, crossing: Crossing, rng: np.random.Generator
) -> Simulation | None:
    """Return a robot before a door, aside of it and not quite turned to it; None where nothing free
    is found.
    """
    for _ in range(50):
        x, y = crossing.beyond(-float(rng.uniform(1.1, 1.8)), float(rng.uniform(-0.6, 0.6)))
        theta = wrap_angle(crossing.theta + float(rng.uniform(-0.7, 0.7)))
        if plan.room_at(x, y) is None:
            continue
        try:
            world = Simulation(
                model, plan, seed=int(rng.integers(1 << 30)), start=f"{x},{y},{theta}", charge=1.0
            )
        except ValueError:
            continue
        if world.clearance() > 0.15:
            return world
    return None


def novice_drive(
    plan: FloorPlan, model: RobotModel, crossing: Crossing, level: AssistLevel, seed: int
) -> tuple[float, int] | None:
    """Return the seconds that a novice takes through a door, at most `PATIENCE`, and the contacts;
    None where there is no start.
    """
    rng = np.random.default_rng(
        [seed, *crossing.name.encode(), round(100.0 * (crossing.theta + math.pi))]
    )
    world = novice_start(plan, model, crossing, rng)
    if world is None:
        return None
    rig, driver = Rig(world, level), Novice(rng, crossing)
    while world.time < PATIENCE and crossing.within(world.pose)[0] < model.radius + 0.2:
        rig.drive(driver.wish(rig))
    return world.time, rig.touches


def through(
    plan: FloorPlan, model: RobotModel, crossing: Crossing, level: AssistLevel, seeds: range
) -> tuple[float, float]:
    """Return the mean seconds and contacts of a novice at one door."""
    drives = [
        drive
        for seed in seeds
        if (drive := novice_drive(plan, model, crossing, level, seed)) is not None
    ]
    return float(np.mean([seconds for seconds, _ in drives])), float(
        np.mean([contacts for _, contacts in drives])
    )


def careless(first: int, runs: int, minutes: float) -> list[Figure]:
    figures = []
    for level, (name, sensors) in itertools.product(LEVELS, SENSORS.items()):
        minutes_run, hits, touches, metres = 0.0, 0, 0, 0.0
        costs, hardest = list[float](), 0.0
        for site in shipped_sites():
            for model in MODELS.values():
                for seed in range(first, first + (runs if level != "off" else 1)):
                    rig = careless_drive(
                        load_site(site).plan, model, level, seed, minutes, sensors=sensors
                    )
                    minutes_run, hits, touches, metres = (
                        minutes_run + rig.world.time / 60.0,
                        hits + rig.collisions,
                        touches + rig.touches,
                        metres + rig.world.distance,
                    )
                    costs += rig.seconds
                    hardest = max(hardest, rig.hardest)
                    print(
                        f"careless {level:<5}{name} {site} {model.series} seed {seed}:"
                        f" {rig.collisions} collisions, {rig.world.distance:.0f} m",
                        flush=True,
                    )
        helped, kind = level != "off", f"careless, {level}{name}"
        figures += [
            Figure(f"{kind}: collisions", hits, "", 0.0 if helped and not name else None),
            Figure(f"{kind}: contacts of any speed", touches, ""),
            Figure(f"{kind}: hardest contact", hardest, "m/s", MONITOR.creep if helped else None),
            Figure(f"{kind}: driven", minutes_run, "min"),
            Figure(f"{kind}: way a minute", metres / minutes_run, "m"),
            Figure(
                f"{kind}: one tick of the kernel, p50",
                float(np.percentile(costs, 50)) * 1000.0,
                "ms",
            ),
            Figure(
                f"{kind}: one tick of the kernel, p99",
                float(np.percentile(costs, 99)) * 1000.0,
                "ms",
            ),
        ]
    return figures


def novice(first: int, runs: int) -> list[Figure]:
    """Let a novice through every door at every level, and return the figures."""
    figures, failed = [], 0
    for site in shipped_sites():
        plan = load_site(site).plan
        for model in MODELS.values():
            for crossing in crossings(plan):
                found = {
                    level: through(plan, model, crossing, level, range(first, first + runs))
                    for level in LEVELS
                }
                for level, (seconds, contacts) in found.items():
                    name = (
                        f"{site} {crossing.name} {math.degrees(crossing.theta):+.0f},"
                        f" {model.series}, {level}"
                    )
                    figures += [
                        Figure(f"{name}: time", seconds, "s"),
                        Figure(f"{name}: contacts", contacts, ""),
                    ]
                    print(figures[-2], figures[-1], flush=True)
                failed += not any(
                    found[level][0] < found["off"][0] or found[level][1] < found["off"][1]
                    for level in ("slow", "steer")
                )
    return [
        *figures,
        Figure("doors that no level passes faster or with fewer contacts", failed, "", 0.0),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=6, help="drives per robot, site and level")
    parser.add_argument("--minutes", type=float, default=10.0, help="length of a careless drive")
    parser.add_argument("--first", type=int, default=JUDGED, help="the first seed")
    parser.add_argument("--only", choices=["careless", "novice"])
    options = parser.parse_args()
    figures = (
        [] if options.only == "novice" else careless(options.first, options.runs, options.minutes)
    )
    figures += [] if options.only == "careless" else novice(options.first, options.runs)
    return keep("assist", figures, first=options.first, runs=options.runs, minutes=options.minutes)


if __name__ == "__main__":
    sys.exit(main())
