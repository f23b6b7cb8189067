"""People who walk: where they can, and where they cannot."""

import math
from itertools import combinations, pairwise

import numpy as np
import pytest

from robots.api.geometry import Pose2D
from robots.simulator.physics.pedestrians import APART, Pedestrians
from robots.simulator.physics.people import BODY, Person, legs, solid
from robots.simulator.physics.walkways import SHOULDERS, Footways
from robots.world.sites import load_plan
from robots.world.solids import fixed_solids, inside, leaf_solid

PLAN, _ = load_plan("office")
OPEN = {door.name: "open" for door in PLAN.doors}
SHUT = {door.name: "closed" for door in PLAN.doors}
FOOTPRINT = np.array([(0.3, -0.3), (0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3)])
AWAY = Pose2D(100.0, 100.0, 0.0)


def crowd(count: int = 3, seed: int = 1, doors: dict = OPEN) -> Pedestrians:
    return Pedestrians(PLAN, count, doors, (0.5, 6.3), np.random.default_rng(seed))


def walk(
    people: Pedestrians, seconds: float, doors: dict = OPEN, robot: Pose2D = AWAY
) -> list[tuple[Person, ...]]:
    seen = []
    for step in range(round(seconds / 0.02)):
        people.step(0.02, doors, FOOTPRINT, robot)
        if step % 10 == 0:
            seen.append(people.people)
    return seen


def room_of(person: Person) -> str | None:
    room = PLAN.room_at(person.x, person.y)
    return room.name if room else None


def test_the_same_seed_gives_the_same_walks_and_another_seed_others() -> None:
    assert walk(crowd(), 20.0) == walk(crowd(), 20.0) != walk(crowd(seed=2), 20.0)


def test_people_walk_at_their_pace_and_face_forwards() -> None:
    seen = walk(crowd(), 120.0)
    for number in range(3):
        one = [moment[number] for moment in seen]
        steps = [math.dist(a[:2], b[:2]) / 0.2 for a, b in pairwise(one)]
        assert max(steps) <= 1.2 + 1e-6
        assert sum(steps) * 0.2 > 15.0
        assert {room_of(person) for person in one} >= {"corridor"} or len(
            {room_of(person) for person in one}
        ) > 1
        moving = [(a, b) for a, b in pairwise(one) if math.dist(a[:2], b[:2]) > 0.18]
        ahead = [math.cos(math.atan2(b.y - a.y, b.x - a.x) - b.heading) for a, b in moving]
        assert np.mean(ahead) > 0.95
        assert len({person.stride for person in one}) > 100


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_people_walk_through_no_walls_furniture_leaves_or_people(seed: int) -> None:
    solids = [*fixed_solids(PLAN), *(leaf_solid(door, "open") for door in PLAN.doors)]
    moments = walk(crowd(seed=seed), 60.0)
    x, y = np.array([(person.x, person.y) for moment in moments for person in moment]).T
    assert not any(inside(each.outline, x, y).any() for each in solids)
    for moment in moments:
        apart = min(math.dist(a[:2], b[:2]) for a, b in combinations(moment, 2))
        assert apart > APART - 0.05


@pytest.mark.slow
@pytest.mark.parametrize("site", ["office", "clinic"])
def test_people_do_not_get_stuck_for_long(site: str) -> None:
    plan, _ = load_plan(site)
    doors = {door.name: "open" for door in plan.doors}
    people = Pedestrians(plan, 3, doors, (0.5, 6.3), np.random.default_rng(6))
    still, before = np.zeros(3), people.people
    for _ in range(300):
        for _ in range(50):
            people.step(0.02, doors, FOOTPRINT, AWAY)
        moved = np.array(
            [math.dist(a[:2], b[:2]) > 0.05 for a, b in zip(before, people.people, strict=True)]
        )
        still, before = np.where(moved, 0.0, still + 1.0), people.people
        assert still.max() < 40.0


def test_behind_closed_doors_people_stay() -> None:
    people = crowd(seed=5, doors=SHUT)
    rooms = [
        {"corridor"} if room_of(person) == "corridor" else {"lab", "lounge", None}
        for person in people.people
    ]
    for moment in walk(people, 120.0, SHUT):
        assert all(
            room_of(person) in allowed for person, allowed in zip(moment, rooms, strict=True)
        )


def test_people_do_not_start_beside_the_robot() -> None:
    for seed in range(20):
        assert all(math.dist(person[:2], (0.5, 6.3)) > 1.0 for person in crowd(5, seed).people)


def test_a_plan_with_less_room_than_people_has_fewer() -> None:
    assert 0 < len(crowd(1000).people) < 100


def test_person_blocked_by_the_robot_turns_round_after_a_while() -> None:
    people = crowd(1)
    walker = people._walkers[0]
    walker.x, walker.y, walker.path = 2.0, 1.0, [(10.0, 1.0)]
    walker.stay, walker.patience = 0.0, 2.0
    walk(people, 8.0, robot=Pose2D(5.3, 1.0, 0.0))
    assert people.bumped == 1
    assert walker.path != [(10.0, 1.0)]
    assert walker.x < 5.0 - BODY + 1e-6


def test_legs_stay_within_the_body_that_is_touched() -> None:
    for stride in np.linspace(0, math.tau, 30):
        person = Person(3.0, 4.0, 0.7, float(stride), 0, 1.2)
        for x, y, _, _ in legs((person,)):
            assert math.hypot(x - 3.0, y - 4.0) < BODY + 0.04
    assert solid(person).name == "person-0"
    assert legs(()).shape == (0, 4)


def test_a_way_keeps_off_the_walls_and_ends_at_the_goal() -> None:
    ways = Footways(PLAN)
    goal = ways.nearest(8.6, 4.4, OPEN)
    path = ways.path((2.0, 6.0), goal, OPEN)
    assert path[-1] == goal
    assert all(ways.is_free(x, y, OPEN) for x, y in path)
    assert ways.path((2.0, 1.0), goal, SHUT) is None
    assert not ways.is_free(2.0, 2.08, SHUT)
    assert not ways.is_free(-5.0, 2.0, OPEN)
    assert SHOULDERS > BODY
