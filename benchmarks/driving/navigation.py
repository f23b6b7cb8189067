"""Navigation to random places in every shipped site, among people who walk and doors that close:
`python -m benchmarks.driving.navigation --runs 50`.

Both robots use their own localization; half of the runs close one door at random some seconds after
the start. A run that ends "blocked" counts as right only if the true world has no path either.
Seeds below 10,000 are for tuning, those from 10,000 for results; `--first` sets the first one.

A collision is any contact with the simulated robot while its fastest corner moves faster than 0.02
m/s, even if a person walked into it. People never yield, and also approach from behind, where the
robot has no sensor; such contacts are shown on a separate line.
"""

import argparse
import math
import sys
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from benchmarks.driving.true_world import TrueWorld
from benchmarks.table import Figure, keep
from robots.agent.navigation.journey import JOURNEY
from robots.agent.navigation.obstacles.local_map import LOCAL_MAP
from robots.agent.navigation.planning.follower import FOLLOWER
from robots.agent.navigation.planning.planner import PLANNER
from robots.agent.safety.collision.braking import BRAKING
from robots.api.floorplan import DoorState
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import MODELS, RobotModel
from robots.world.sites import load_site, shipped_sites, with_doors
from tests.support.agents.navigation_rig import Rig

JUDGING = 10_000
AT_GOAL = 0.3  # metres, by the truth
TIMEOUT = 600.0  # simulated seconds
CLOSES = (1.0, 12.0)  # seconds after the start


@dataclass
class Tally:
    """The results of the runs."""

    outcomes: Counter[str] = field(default_factory=Counter)
    ratios: list[float] = field(default_factory=list)
    disturbed: list[float] = field(default_factory=list)
    into_things: int = 0
    into_people_seen: int = 0
    with_people_unseen: int = 0
    simulated: float = 0.0
    notes: list[str] = field(default_factory=list)


def one_run(world: TrueWorld, seed: int, people: int, tally: Tally) -> None:
    rng = np.random.default_rng([seed, 77])
    plan = world.site.plan
    doors: dict[str, DoorState] = with_doors(plan, {})
    start = world.start(rng, doors)
    goal = world.goal(rng, start[:2], doors)
    sim = Simulation(world.model, plan, seed=seed, start="{},{},{}".format(*start), people=people)
    rig = Rig(sim, world.site.grid, seed, localizer=True)
    closing = (
        str(rng.choice([door.name for door in plan.doors])) if seed % 2 and plan.doors else None
    )
    closes_at = float(rng.uniform(*CLOSES))
    rig.navigator.goto(*goal)
    done = rig.step()
    while done.status == "RUNNING" and sim.time < TIMEOUT:
        if closing and sim.time >= closes_at:
            sim.set_doors({closing: "closed"})
        done = rig.step()
    _count(
        world,
        rig,
        NavigationTrial(start[:2], goal, doors),
        tally,
        f"{plan.map_id} {world.model.series} seed {seed}: {done.status} {done.reason}",
    )


@dataclass(frozen=True)
class NavigationTrial:
    """From where to where, and the doors at the start."""

    start: tuple[float, float]
    goal: tuple[float, float]
    doors: dict[str, DoorState]


def _count(world: TrueWorld, rig: Rig, task: NavigationTrial, tally: Tally, what: str) -> None:
    goal = task.goal
    sim = rig.sim
    here = (sim.pose.x, sim.pose.y)
    arrived = math.dist(here, goal) <= AT_GOAL and "FINISHED" in what
    blocked = not arrived and world.shortest(here, goal, dict(sim.doors)) is None
    outcome = "arrived" if arrived else "rightly blocked" if blocked else "failed"
    tally.outcomes[outcome] += 1
    if outcome == "failed":
        tally.notes.append(
            f"{what}, at ({here[0]:.1f}, {here[1]:.1f}), goal ({goal[0]:.1f}, {goal[1]:.1f}), after"
            f" {sim.time:.0f} s"
        )
    shortest = world.shortest(task.start, goal, task.doors)
    if arrived and shortest:
        now = world.shortest(task.start, goal, dict(sim.doors))
        same = now is not None and abs(now - shortest) < 0.1
        (tally.ratios if same else tally.disturbed).append(
            sim.distance / (shortest if same else now or shortest)
        )
    things = sum(not name.startswith("person") for name in rig.collided_with)
    tally.into_things += things
    tally.into_people_seen += rig.seen_collisions - things
    tally.with_people_unseen += rig.bumps + rig.collisions - rig.seen_collisions
    if rig.seen_collisions:
        tally.notes.append(f"{what}: touched {', '.join(rig.collided_with) or 'a person'}")
    tally.simulated += sim.time


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=25, help="for each site and robot")
    parser.add_argument("--first", type=int, default=JUDGING, help="the first seed")
    parser.add_argument("--people", type=int, default=2)
    parser.add_argument("--sites", nargs="+", default=list(shipped_sites()))
    parser.add_argument("--series", nargs="+", default=sorted(MODELS))
    wanted = parser.parse_args()
    print("  ", JOURNEY, FOLLOWER, PLANNER, BRAKING, LOCAL_MAP, sep="\n  ", flush=True)
    tally, begun = Tally(), time.perf_counter()
    for site in wanted.sites:
        for series in wanted.series:
            model: RobotModel = MODELS[series]
            world = TrueWorld(load_site(site), model)
            for seed in range(wanted.first, wanted.first + wanted.runs):
                one_run(world, seed, wanted.people, tally)
            print(f"  {site} {series}: {dict(tally.outcomes)} so far", flush=True)
    return _report(tally, time.perf_counter() - begun, vars(wanted))


def _report(tally: Tally, seconds: float, how: dict[str, object]) -> int:
    for note in tally.notes:
        print("  ", note)
    runs = sum(tally.outcomes.values())
    judged = max(runs - tally.outcomes["rightly blocked"], 1)
    ratios = tally.ratios or [math.nan]
    figures = [
        Figure(
            "runs that did not arrive though there was a way",
            100.0 * tally.outcomes["failed"] / judged,
            "%",
            2.0,
        ),
        Figure(
            "runs that were rightly blocked",
            100.0 * tally.outcomes["rightly blocked"] / max(runs, 1),
            "%",
        ),
        Figure(
            "collisions, all of them",
            tally.into_things + tally.into_people_seen + tally.with_people_unseen,
            "",
            0.0,
        ),
        Figure("of them with things", tally.into_things, "", 0.0),
        Figure("of them with people before the laser's eyes", tally.into_people_seen, "", 0.0),
        Figure(
            "of them with people who came from where no laser looks", tally.with_people_unseen, ""
        ),
        Figure("way driven / shortest way, mean", float(np.mean(ratios)), "", 1.25),
        Figure("way driven / shortest way, p95", float(np.percentile(ratios, 95)), ""),
        Figure(
            "the same where a door closed on the way, mean",
            float(np.mean(tally.disturbed)) if tally.disturbed else 0.0,
            "",
        ),
        Figure("simulated hours", tally.simulated / 3600.0, "h"),
        Figure("simulated seconds a second", tally.simulated / seconds, ""),
    ]
    return keep(
        "navigation",
        figures,
        outcomes=dict(tally.outcomes),
        ratios=tally.ratios,
        notes=tally.notes,
        how=how,
    )


if __name__ == "__main__":
    sys.exit(main())
