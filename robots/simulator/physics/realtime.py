"""A simulation in real time, with a history.

All steps have the same length, so that a run depends only on when commands arrive. After a pause
of the whole process (a suspended laptop, SIGSTOP) the lost time is dropped: a robot that was not
simulated has not moved.
"""

import itertools
from collections import deque
from dataclasses import dataclass

from robots.api.geometry import Pose2D
from robots.simulator.physics.drive import WheelMotion
from robots.simulator.physics.people import Person
from robots.simulator.physics.simulation import Simulation
from robots.simulator.wire import Truth
from robots.world.solids import Opening

STEP = 0.01
LONGEST_LAG = 0.25
CLOCK_STEP = 0.1  # seconds: the wall clock was set, or the process slept
CLOCK_SLEW = 0.02
REMEMBERED = 180.0  # seconds

Row = tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True)
class CameraView:
    """The scene at one moment, for a camera; `stamp` in Unix seconds."""

    stamp: float
    pose: Pose2D
    motion: WheelMotion
    tilt: float
    doors: dict[str, Opening]
    people: tuple[Person, ...] = ()


class Playback:
    """Drives a `Simulation` by the caller's clocks: monotonic for steps, Unix for stamps."""

    def __init__(self, simulation: Simulation, monotonic: float, unix: float) -> None:
        self.simulation = simulation
        self._origin = monotonic
        self._unix_origin = unix
        self._history: deque[Row] = deque(maxlen=round(REMEMBERED / STEP))
        self.view = self._view()

    def advance(self, monotonic: float, unix: float) -> int:
        """Take all steps that are due and return how many."""
        lag = monotonic - self._origin - self.simulation.time
        if lag > LONGEST_LAG:
            self._origin += lag - LONGEST_LAG
        self._set_wall_clock(unix - (monotonic - self._origin))
        count = 0
        while self.simulation.time + STEP <= monotonic - self._origin:
            self.simulation.step(STEP)
            count += 1
            self._history.append((self.stamp(), *self.simulation.sample()[1:]))
        if count:
            self.view = self._view()
        return count

    def _set_wall_clock(self, unix_origin: float) -> None:
        """Follow the wall clock slowly, so that stamps never go backwards."""
        error = unix_origin - self._unix_origin
        self._unix_origin += error if abs(error) > CLOCK_STEP else CLOCK_SLEW * error

    def stamp(self) -> float:
        """Return the Unix time of the last step."""
        return self._unix_origin + self.simulation.time

    def history(self, seconds: float) -> tuple[Row, ...]:
        """Return the rows of the last seconds, oldest first."""
        count = min(len(self._history), max(0, round(seconds / STEP)))
        return tuple(itertools.islice(self._history, len(self._history) - count, None))

    def truth(self, *, measured: bool = True) -> Truth:
        """Return the robot's truth; without `measured` no clearance, which costs most."""
        sim = self.simulation
        return Truth(
            stamp=self.stamp(),
            x=sim.pose.x,
            y=sim.pose.y,
            theta=sim.pose.theta,
            odometry=(sim.odometry.x, sim.odometry.y, sim.odometry.theta),
            linear=sim.motion.linear,
            angular=sim.motion.angular,
            commanded=(sim.commanded.linear, sim.commanded.angular),
            commanded_at=self._unix_origin + sim.commanded_at if sim.commanded_at >= 0.0 else 0.0,
            charge=sim.charge,
            voltage=sim.voltage(),
            docked=sim.docked,
            tilt=sim.tilt,
            clearance=min(sim.clearance(), 1e3) if measured else None,
            contacts=sim.contacts,
            distance=sim.distance,
            doors=dict(sim.doors),
            errors=sim.errors(),
            bumped=sim.bumped,
            people=tuple((person.x, person.y, person.heading) for person in sim.people),
            bumper=sim.bumper(),
        )

    def _view(self) -> CameraView:
        sim = self.simulation
        return CameraView(self.stamp(), sim.pose, sim.motion, sim.tilt, sim.openings, sim.people)
