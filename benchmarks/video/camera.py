"""The cost of the simulated camera: processor milliseconds a frame, in one thread of an otherwise
idle process.

There are four drives, each a sequence of different frames: turning at every start of the site, at
rest while two people walk by, in front of the mirror with a person beside the robot, and driving
while the head tilts. `--frames` sets their number for each drive, 60 by default.

On a busy computer the median measures the other work rather than the camera; `at best` is the
median over the frames of the fastest of three renderings of each.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from benchmarks.table import Figure, keep, quantiles
from robots.api.floorplan import DoorState, FloorPlan
from robots.api.geometry import Pose2D
from robots.simulator.physics.people import Person
from robots.simulator.render.camera import SceneCamera
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_plan

BOUND = 8.0  # ms a frame
DRAWINGS = 3
SEED = 11
FPS = 30.0


class Shot(NamedTuple):
    """The robot's pose and head tilt, and the people in the scene."""

    pose: Pose2D
    tilt: float
    people: tuple[Person, ...] = ()


def turning(plan: FloorPlan) -> Iterator[Shot]:
    """Turn on one start after the other, 6 degrees a frame."""
    number = 0
    while True:
        start = plan.starts[number % len(plan.starts)]
        yield Shot(Pose2D(start.x, start.y, math.radians(6.0 * number + 0.1)), GIRAFF.tilt.home)
        number += 1


def people(plan: FloorPlan) -> Iterator[Shot]:
    """Stay at rest in the corridor while two people walk by."""
    start = next(place for place in plan.starts if abs(place.theta) < 0.1)
    number = 0
    while True:
        ahead, stride = 3.5 + 2.5 * math.sin(0.02 * number), 0.2 * number
        there = (
            Person(start.x + ahead, start.y + 0.3, math.pi, stride, 1, 1.0),
            Person(start.x + 6.0 - ahead / 2.0, start.y - 0.3, 0.0, stride, 2, 1.0),
        )
        yield Shot(Pose2D(start.x, start.y, start.theta), GIRAFF.tilt.home, there)
        number += 1


def mirror(plan: FloorPlan) -> Iterator[Shot]:
    """Drive to and fro in front of the mirror, with a person walking on the spot beside it."""
    glass = plan.mirrors[0]
    middle = Pose2D(
        (glass.start[0] + glass.end[0]) / 2.0, (glass.start[1] + glass.end[1]) / 2.0, 0.0
    )
    facing = math.atan2(glass.end[0] - glass.start[0], glass.start[1] - glass.end[1])
    number = 0
    while True:
        away, turn = 1.3 + 0.5 * math.sin(0.05 * number), 0.15 * math.sin(0.11 * number)
        outwards = Pose2D(middle.x, middle.y, facing)
        place, beside = outwards.apply(away, 0.0), outwards.apply(away, 0.7)
        person = Person(*beside, facing, 0.2 * number, 3, 1.0)
        yield Shot(Pose2D(*place, facing + turn), GIRAFF.tilt.home, (person,))
        number += 1


def tilting(plan: FloorPlan) -> Iterator[Shot]:
    """Drive along the corridor while the head moves: every frame needs tables of its own."""
    start = next(place for place in plan.starts if abs(place.theta) < 0.1)
    number = 0
    while True:
        yield Shot(
            Pose2D(start.x + 0.01 * number, start.y, 0.002 * number),
            GIRAFF.tilt.home + 0.2 * math.sin(0.1 * number),
        )
        number += 1


def measure(
    camera: SceneCamera, shots: list[Shot], doors: dict[str, DoorState]
) -> tuple[list[float], list[float]]:
    """Return the milliseconds of each frame at first and at best; everything was
    drawn once before.
    """
    out = np.zeros((camera.camera.height * 3 // 2, camera.camera.width), dtype=np.uint8)
    elsewhere = Pose2D(shots[0].pose.x, shots[0].pose.y, shots[0].pose.theta + 1.0)
    for shot in shots:
        camera.render(shot.pose, shot.tilt, doors, shot.people, out)
    first, best = [], []
    for shot in shots:
        times = []
        for _ in range(DRAWINGS):
            # so that the same picture is drawn again
            camera.render(elsewhere, shot.tilt, doors, (), out)
            begun = time.thread_time()
            camera.render(shot.pose, shot.tilt, doors, shot.people, out)
            times.append((time.thread_time() - begun) * 1e3)
        first.append(times[0])
        best.append(min(times))
    return first, best


def at_rest(
    camera: SceneCamera, doors: dict[str, DoorState], shot: Shot, frames: int
) -> list[float]:
    """Return the milliseconds of frames in which nothing moves."""
    out = np.zeros((camera.camera.height * 3 // 2, camera.camera.width), dtype=np.uint8)
    times = []
    for _ in range(frames):
        begun = time.thread_time()
        camera.render(shot.pose, shot.tilt, doors, shot.people, out)
        times.append((time.thread_time() - begun) * 1e3)
    return times[1:]


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--frames", type=int, default=60)
    frames = words.parse_args().frames
    plan, _ = load_plan("office")
    begun = time.thread_time()
    camera = SceneCamera(GIRAFF, plan, seed=SEED)
    figures = [Figure("building the scene", time.thread_time() - begun, "s")]
    doors: dict[str, DoorState] = {door.name: "open" for door in plan.doors}
    for drive in (turning, people, mirror, tilting):
        first, best = measure(camera, list(islice(drive(plan), frames)), doors)
        figures += quantiles(f"{drive.__name__}", first, "ms", p50=None, p95=None)
        figures += quantiles(
            f"{drive.__name__}, at best",
            best,
            "ms",
            p50=BOUND if drive is not tilting else None,
            p95=None,
        )
    figures += quantiles(
        "standing", at_rest(camera, doors, next(turning(plan)), frames), "ms", p50=0.5, p95=None
    )
    turn = next(figure.value for figure in figures if figure.what == "turning, p50")
    figures.append(Figure(f"turning at {FPS:g} frames a second", turn * FPS / 10.0, "% of a core"))
    return keep("camera", figures)


if __name__ == "__main__":
    sys.exit(main())
