"""From a key to a moving robot: a person, the page's ramp and steps, a simulated Giraff."""

import math
import random
from collections import deque
from dataclasses import dataclass, field

from experiments.bots.driver import Driver, Guide, SpeedSetting
from experiments.bots.view import View
from experiments.definition.cues import LEAVING, NEAR_HOME
from experiments.definition.shipped import shipped
from robots.api.docked import DOCKED, DockReading, DockState, follow
from robots.api.geometry import Pose2D
from robots.simulator.physics.drive import STILL
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_plan
from sessions import protocol
from tests.support.browsers.first_time_user import Keys, UserDecisions

DT = 0.02
START, RISE = 0.35, 0.9  # static/js/input/speeds.js
STEPS = {"Slow": 0.4, "Normal": 0.7}  # static/js/input/speeds.js


@dataclass
class Keyboard:
    """The keys of a page, as Playwright presses them, and the speed that the page makes of them."""

    held: set[str] = field(default_factory=set)
    shares: list[float] = field(default_factory=lambda: [0.0, 0.0])

    @property
    def keyboard(self) -> "Keyboard":
        return self

    def down(self, key: str) -> None:
        self.held.add(key)

    def up(self, key: str) -> None:
        self.held.discard(key)

    def speed(self, step: str) -> tuple[float, float]:
        """Return the robot's speeds (m/s, rad/s) after another DT."""
        for axis, (more, less) in enumerate(
            (("ArrowUp", "ArrowDown"), ("ArrowLeft", "ArrowRight"))
        ):
            sign = (more in self.held) - (less in self.held)
            before = abs(self.shares[axis]) if sign and self.shares[axis] * sign > 0 else 0.0
            self.shares[axis] = sign * min(1.0, max(START, before + (RISE * DT if before else 0.0)))
        share, (ahead, left), limits = STEPS[step], self.shares, GIRAFF.limits
        linear = ahead * share * (limits.linear if ahead > 0.0 else limits.reverse)
        return linear, left * math.sqrt(share) * limits.angular


@dataclass
class Person:
    """A person on the paper's course, who looks every `looks` s, reacts `late` s later, and
    misjudges the pose by `blur` (m, rad).
    """

    seed: int
    start: str = "dock"
    late: float = 0.15
    blur: tuple[float, float] = (0.01, 0.01)
    looks: float = 0.1
    closed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.rng = random.Random(self.seed)
        plan, _ = load_plan("office")
        course = next(
            course for course in shipped()["exploration"].courses if course.robot == "giraff"
        )
        stops = [{"number": stop.number, "x": stop.x, "y": stop.y} for stop in course.checkpoints]
        self.guide = Guide.of({"checkpoints": stops}, plan, "giraff")
        self.node = UserDecisions(Driver(plan, self.guide, SpeedSetting(0.6, 0.6)))
        self.sim = Simulation(GIRAFF, plan, seed=self.seed, start=self.start)
        self.sim.set_doors(
            {door.name: "closed" if door.name in self.closed else "open" for door in plan.doors}
        )
        self.cue, self.step, self.dock = "", "Normal", DockState()

    def drive(self, passed: int, within: float) -> float | None:
        """Pass the checkpoints after `passed` and dock; return the seconds, or None."""
        keyboard, next_look = Keyboard(), 0.0
        seen = deque[Pose2D](maxlen=max(1, round(self.late / DT)))
        keys = Keys(keyboard)
        while self.sim.time < within:
            seen.append(self.sim.pose)
            passed += self._at(passed)
            self._follow_dock()
            if passed == len(self.guide.stops) - 1 and self.dock.docked:
                return self.sim.time
            if self.sim.time >= next_look:
                next_look = self.sim.time + self.rng.uniform(0.7, 1.3) * self.looks
                self._look(seen[0], passed, keys)
            self.sim.command(*keyboard.speed(self.step))
            self.sim.step(DT)
        return None

    def _follow_dock(self) -> None:
        released = self.sim.commanded == STILL
        motion = self.sim.motion._asdict()
        reading = DockReading(
            at=self.sim.time, contact=self.sim.docked, released=released, **motion
        )
        self.dock = follow(DOCKED, self.dock, reading)

    def _at(self, passed: int) -> bool:
        stop = self.guide.stops.get(passed + 1)
        return stop is not None and math.dist(stop, self.sim.pose[:2]) < 0.6

    def _look(self, pose: Pose2D, passed: int, keys: Keys) -> None:
        metres, radians = self.blur
        errors = [self.rng.gauss(0, deviation) for deviation in (metres, metres, radians)]
        seen = Pose2D(*(value + error for value, error in zip(pose, errors, strict=True)))
        view = View(pose=seen, localized=True)
        view.task = self._task(passed)
        intent, self.step = self.node.decide(
            view, self.sim.time, bumped=bool(self.sim.touching - {"giraff-dock"})
        )
        keys.steer(intent.speed, self.step)

    def _task(self, passed: int) -> protocol.Task:
        stop = self.guide.stops.get(passed + 1)
        if stop is not None:
            self.cue = "leave_station" if self.sim.docked else "go_to_checkpoint"
            return protocol.Task(
                session="s", stamp=0.0, cue=self.cue, number=passed + 1, x=stop[0], y=stop[1]
            )
        if self.dock.touching:
            return protocol.Task(session="s", stamp=0.0, cue="dock_hold")
        distance = math.dist((self.guide.dock.x, self.guide.dock.y), self.sim.pose[:2])
        near = NEAR_HOME * (LEAVING if self.cue == "dock_now" else 1.0)
        self.cue = "dock_now" if distance <= near else "return_home"
        return protocol.Task(session="s", stamp=0.0, cue=self.cue)
