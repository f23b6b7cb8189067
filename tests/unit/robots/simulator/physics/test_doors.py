"""Doors that swing: their speed, obstacles in their arc, and laser, camera and wheels at a moving
leaf.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

from robots.api.geometry import Pose2D
from robots.simulator.physics.contact import shape
from robots.simulator.physics.doors import KEPT_OFF, SPEED, Doors
from robots.simulator.physics.people import BODY
from robots.simulator.physics.simulation import Simulation
from robots.simulator.render.camera import SceneCamera
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_plan, with_doors
from robots.world.solids import leaf_end, leaf_solid

PLAN, _ = load_plan("office")
DOOR = next(door for door in PLAN.doors if door.name == "lab-door")
DT = 0.02


def doors() -> Doors:
    return Doors(PLAN, with_doors(PLAN, {}))


def giraff(start: str = "lab-centre") -> Simulation:
    """A simulation after its first step, so that doors swing."""
    sim = Simulation(GIRAFF, PLAN, seed=1, start=start)
    sim.step(DT)
    return sim


def wait(sim: Simulation, seconds: float) -> float:
    """Let time pass and return the least distance between a moving leaf and the robot."""
    near = math.inf
    for _ in range(round(seconds / DT)):
        sim.step(DT)
        near = min([near, *(leaf.gap_to(sim.outline())[0] for leaf in sim._doors.moving)])
    return near


def test_a_leaf_moves_at_its_speed_without_jumps() -> None:
    sim = giraff()
    sim.set_doors({"lab-door": "closed"})
    ends, began = [leaf_end(DOOR, "open")], sim.time
    while sim.doors["lab-door"] == "open":
        sim.step(DT)
        ends.append(leaf_end(DOOR, sim.openings["lab-door"]))
    width = math.dist(DOOR.start, DOOR.end)
    assert sim.time - began == pytest.approx(abs(DOOR.swing) / SPEED, abs=2 * DT)
    assert max(math.dist(a, b) for a, b in pairwise(ends)) <= width * SPEED * DT + 1e-9
    assert all(math.dist(end, DOOR.start) == pytest.approx(width) for end in ends)
    assert ends[-1] == DOOR.end


def test_doors_are_set_at_once_before_the_first_step() -> None:
    sim = Simulation(GIRAFF, PLAN, seed=1, start="lab-centre")
    sim.set_doors({"lab-door": "closed"})
    assert sim.openings["lab-door"] == sim.doors["lab-door"] == "closed"


def test_a_moving_leaf_can_be_reversed() -> None:
    leaves = doors()
    leaves.want({"lab-door": "closed"})
    for _ in range(20):
        leaves.step(DT, [])
    opening = leaves.openings["lab-door"]
    assert isinstance(opening, float)
    assert 0.0 < opening < 1.0
    leaves.want({"lab-door": "open"})
    leaves.step(DT, [])
    assert leaves.openings["lab-door"] > opening
    for _ in range(25):
        leaves.step(DT, [])
    assert leaves.is_still()
    assert leaves.openings["lab-door"] == "open"
    assert leaves.moving == ()


@pytest.mark.parametrize("share", [0.3, 0.4, 0.5])
def test_a_leaf_waits_until_the_robot_has_left_its_arc(share: float) -> None:
    end = leaf_end(DOOR, share)
    sim = giraff()
    sim.carry_to(
        Pose2D(0.3 * DOOR.start[0] + 0.7 * end[0], 0.3 * DOOR.start[1] + 0.7 * end[1], 0.3)
    )
    sim.set_doors({"lab-door": "closed"})
    wait(sim, 3.0)
    assert sim.openings["lab-door"] == "open"
    sim.carry_to(Pose2D(2.0, 6.0, 0.0))
    wait(sim, 2.0)
    assert sim.openings["lab-door"] == "closed"


def test_leaf_turns_back_when_the_robot_enters_its_arc() -> None:
    sim = giraff()
    sim.set_doors({"lab-door": "closed"})
    wait(sim, 0.16)
    sim.carry_to(Pose2D(2.05, 2.3, math.pi / 2.0))
    assert sim.openings["lab-door"] not in {"open", "closed"}
    assert wait(sim, 3.0) > KEPT_OFF / 2.0
    assert sim.openings["lab-door"] == "open"
    assert sim.contacts == 0


def test_a_leaf_may_move_away_from_a_close_obstacle_and_not_back() -> None:
    beyond = np.array(leaf_end(DOOR, 1.06))  # on the side from which the leaf moves away
    thing = beyond + 0.02 * np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]])
    assert shape(leaf_solid(DOOR, "open")).gap_to(thing)[0] < KEPT_OFF
    leaves = doors()
    leaves.want({"lab-door": "closed"})
    for _ in range(100):
        leaves.step(DT, [thing])
    assert leaves.openings["lab-door"] == "closed"
    leaves.want({"lab-door": "open"})
    for _ in range(100):
        leaves.step(DT, [thing])
    assert leaves.openings["lab-door"] == "closed"


@pytest.mark.slow
def test_leaf_waits_for_people_and_no_person_walks_through_it() -> None:
    moved = 0
    for seed in range(2):
        sim = Simulation(GIRAFF, PLAN, seed=seed, start="dock", people=4, door_changes=3.0)
        for _ in range(1500):
            sim.step(DT)
            for leaf in sim._doors.moving:
                moved += 1
                for person in sim.people:
                    spot = np.array([person.x, person.y]) + 1e-6 * np.array(
                        [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]]
                    )
                    assert leaf.gap_to(spot)[0] > BODY / 2.0
    assert moved > 50


def test_a_robot_is_stopped_by_a_moving_leaf() -> None:
    sim = giraff("2.02,1.0,1.5708")
    for _ in range(600):
        sim.command(0.5, 0.0)
        sim.step(DT)
        if sim.pose.y > 1.35:
            sim.set_doors({"lab-door": "closed"})
        assert all(leaf.gap_to(sim.outline())[0] > -1e-3 for leaf in sim._doors.moving)
        assert not sim.obstacles.hits(sim.outline())


def test_the_laser_follows_a_moving_leaf() -> None:
    sim = giraff("2.02,1.0,1.5708")
    sim.set_doors({"lab-door": "closed"})
    middle, seen = len(sim.scan()) // 2, []
    while sim.doors["lab-door"] == "open":
        sim.step(DT)
        seen.append(float(np.nanmin(sim.scan()[middle - 12 : middle + 13])))
    assert len({round(distance, 1) for distance in seen}) > 2
    assert seen[-1] < seen[0] - 0.5


@pytest.mark.slow
def test_camera_shows_a_moving_leaf_until_it_is_closed() -> None:
    camera = SceneCamera(GIRAFF, PLAN, seed=1)

    def picture(opening: str | float) -> np.ndarray:
        out = np.zeros((GIRAFF.camera.height * 3 // 2, GIRAFF.camera.width), dtype=np.uint8)
        openings = {"lab-door": opening, "lounge-door": "open"}
        camera.render(Pose2D(2.0, 3.6, -math.pi / 2.0), 0.0, openings, (), out)
        return out[: GIRAFF.camera.height].astype(int)

    pictures = [picture(opening) for opening in ("open", 0.75, 0.5, 0.25, "closed")]
    assert all(np.abs(a - b).mean() > 0.5 for a, b in pairwise(pictures))
    assert np.abs(picture(1e-9) - pictures[-1]).mean() < 0.5
    assert np.abs(picture(1.0 - 1e-9) - pictures[0]).mean() < 0.5
