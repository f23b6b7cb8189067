"""How fast a simulated robot runs without a camera, in simulated seconds a second of processor
time.

First its body alone: physics at 50 Hz, laser at 20 Hz, three people who walk. The robot drives
ahead, and turns when an obstacle is near. Then the whole robot, which navigates from place to
place: obstacle memory at 20 Hz, localization and navigation at 10 Hz. Seeds of this file: 900 to
909.
"""

import argparse
import sys
import time

import numpy as np

from benchmarks.table import Figure, keep
from robots.api.messages import Goto
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import MODELS
from robots.world.sensing import LaserScan
from robots.world.sites import load_plan, shipped_sites
from tests.support.agents.headless_robot import DT, HeadlessRobot

STEP = 0.02
LASER_EVERY = (0, 2, 5, 7)  # of ten steps: 20 Hz
SEED = 900
PEOPLE = 3
TARGET = 100.0
WHOLE_TARGET = 20.0
SHARE = 20.0  # percent of a core, beside the camera
ROUNDS = 3


def wander(beams: LaserScan, turning: float) -> tuple[float, float, float]:
    """Return linear and angular speed, and which way the robot turns (1 left, -1 right, 0 not): to
    where more room is.
    """
    points = beams.points()
    before = points[(points[:, 0] > 0.0) & (np.abs(points[:, 1]) < 0.4)]
    room = float(before[:, 0].min()) if len(before) else np.inf
    if room > (1.2 if turning else 0.8):
        return 0.4, 0.0, 0.0
    turning = turning or (
        1.0
        if np.median(beams.ranges[beams.angles > 0.0]) > np.median(beams.ranges[beams.angles < 0.0])
        else -1.0
    )
    return 0.0, 0.6 * turning, turning


def run(series: str, site: str, seconds: float, seed: int) -> tuple[float, float, Simulation]:
    """Simulate and return the processor's seconds for the physics and for the laser, and the robot
    as it ended.
    """
    robot = Simulation(
        MODELS[series], load_plan(site)[0], seed=seed, start="corridor-centre", people=PEOPLE
    )
    command, turning, walked, looked = (0.0, 0.0), 0.0, 0.0, 0.0
    for step in range(round(seconds / STEP)):
        begun = time.thread_time()
        robot.command(*command)
        robot.step(STEP)
        walked += time.thread_time() - begun
        if step % 10 in LASER_EVERY:
            begun = time.thread_time()
            beams = robot.beams()
            looked += time.thread_time() - begun
            if beams is not None:
                *speeds, turning = wander(beams, turning)
                command = (speeds[0], speeds[1])
    return walked, looked, robot


def travel(series: str, seconds: float, people: int, seed: int) -> float:
    """Send the whole robot from place to place in the office and return the processor's seconds
    that it took.
    """
    robot = HeadlessRobot(series, seed=seed, people=people)
    assert robot.area.plan is not None
    places, begun = [place.name for place in robot.area.plan.places], time.process_time()
    for number in range(1000):
        if robot.sim.time >= seconds:
            break
        action = Goto(action_id=str(number), stamp=0.0, place=places[number % len(places)])
        robot.autonomy.begin(action)
        robot.run(
            seconds - robot.sim.time + DT,
            lambda name=action.action_id: robot.last(name) is not None,
        )
    return time.process_time() - begun


def whole(seconds: float) -> list[Figure]:
    figures = []
    for series in MODELS:
        for people in (0, PEOPLE):
            used = min(travel(series, seconds, people, SEED + number) for number in range(ROUNDS))
            name = f"{series}, whole, {people} people"
            figures.append(
                Figure(
                    f"{name}: CPU time of a simulated second",
                    1000.0 * used / seconds,
                    "ms",
                    1000.0 / WHOLE_TARGET,
                )
            )
            figures.append(Figure(f"{name}: simulated seconds a second", seconds / used, "x"))
            figures.append(
                Figure(f"{name}: in real time, of a core", 100.0 * used / seconds, "%", SHARE)
            )
    return figures


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--seconds", type=float, default=60.0, help="simulated, in each run")
    seconds = words.parse_args().seconds
    figures = []
    for series in MODELS:
        for site in shipped_sites():
            runs = [run(series, site, seconds, SEED + number) for number in range(ROUNDS)]
            name = f"{series}, {site}"
            walked, looked = (
                min(walked for walked, _, _ in runs),
                min(looked for _, looked, _ in runs),
            )
            figures.append(
                Figure(
                    f"{name}: CPU time of a simulated second",
                    1000.0 * (walked + looked) / seconds,
                    "ms",
                    1000.0 / TARGET,
                )
            )
            figures.append(Figure(f"{name}: of it, the laser", 1000.0 * looked / seconds, "ms"))
            figures.append(
                Figure(f"{name}: simulated seconds a second", seconds / (walked + looked), "x")
            )
            figures.append(
                Figure(f"{name}: metres driven", sum(robot.distance for _, _, robot in runs), "m")
            )
    return keep("robot", figures + whole(seconds))


if __name__ == "__main__":
    sys.exit(main())
