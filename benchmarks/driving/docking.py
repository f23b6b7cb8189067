"""Docking from random poses, and the whole study run, for both robots in every shipped site:
`python -m benchmarks.driving.docking --runs 50`.

The study run starts in the dock, passes the route's checkpoints, faces the mirror if the last
checkpoint lies before one, returns and docks, among people who walk. Seeds below 20,000 are for
tuning, those from 20,000 for results; `--first` sets the first one.
"""

import argparse
import math
import sys
import time
from collections import Counter

import numpy as np

from benchmarks.driving.true_world import TrueWorld
from benchmarks.table import Figure, keep
from robots.agent.navigation.docking.approach import DOCKING, UNDOCKING
from robots.agent.navigation.docking.station import STATION
from robots.agent.navigation.planning.steps import NavigationStep
from robots.api.floorplan import Checkpoint, Place
from robots.api.geometry import wrap_angle
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import MODELS
from robots.world.sites import load_site, shipped_sites, with_doors
from tests.support.agents.navigation_rig import Rig

JUDGING = 20_000
TIMEOUT = 600.0  # simulated seconds to dock, and for each leg of the study run
MIRROR_NEAR = 0.8  # metres from the last checkpoint to a place called mirror that belongs to it
FACING, AT = 0.2, 0.35  # radians, metres


def docked_in(world: TrueWorld, seed: int) -> tuple[str, float]:
    """Dock from a random pose; return the outcome and the simulated seconds."""
    start = world.start(np.random.default_rng([seed, 78]), with_doors(world.site.plan, {}))
    sim = Simulation(world.model, world.site.plan, seed=seed, start="{},{},{}".format(*start))
    rig = Rig(sim, world.site.grid, seed, localizer=True)
    rig.navigator.dock()
    done = rig.run(TIMEOUT)
    tries = 1 + sum(reason.startswith("tries_again: ") for reason in rig.reasons)
    good = done.status == "FINISHED" and sim.docked and not rig.collisions
    return (
        f"docked at try {tries}" if good else f"not docked: {done.reason or done.status}"
    ), sim.time


def study_run(world: TrueWorld, seed: int, people: int) -> tuple[str, float]:
    """Drive the task of the study; return "done" or what went wrong, and the simulated seconds."""
    plan, series = world.site.plan, world.model.series
    route = plan.route_of(series)
    assert route is not None
    sim = Simulation(world.model, plan, seed=seed, start="dock", people=people)
    rig = Rig(sim, world.site.grid, seed, localizer=True)
    for checkpoint in route.checkpoints[1:]:
        rig.navigator.goto(checkpoint.x, checkpoint.y)
        done = rig.run(TIMEOUT)
        if not _reached(rig, checkpoint, done):
            return f"checkpoint {checkpoint.number}: {done.reason or done.status}", sim.time
    mirror = next(
        (
            place
            for place in plan.places
            if place.name == "mirror" and _near(place, route.checkpoints[-1])
        ),
        None,
    )
    if mirror is not None:
        rig.navigator.goto(mirror.x, mirror.y, mirror.theta)
        done = rig.run(TIMEOUT)
        if (
            math.dist((mirror.x, mirror.y), sim.pose[:2]) > AT
            or abs(wrap_angle(mirror.theta - sim.pose.theta)) > FACING
        ):
            return f"mirror: {done.reason or done.status}", sim.time
    rig.navigator.dock()
    done = rig.run(TIMEOUT)
    return (
        "done"
        if sim.docked and done.status == "FINISHED"
        else f"dock: {done.reason or done.status}"
    ), sim.time


def _reached(rig: Rig, checkpoint: Checkpoint, done: NavigationStep) -> bool:
    return (
        done.status == "FINISHED"
        and math.dist((checkpoint.x, checkpoint.y), rig.sim.pose[:2]) <= checkpoint.radius
    )


def _near(place: Place, checkpoint: Checkpoint) -> bool:
    return math.dist((place.x, place.y), (checkpoint.x, checkpoint.y)) <= MIRROR_NEAR


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--runs", type=int, default=25, help="for each site and robot: so many dockings"
    )
    parser.add_argument(
        "--study-runs", type=int, help="and so many study runs; a third as many when not given"
    )
    parser.add_argument("--first", type=int, default=JUDGING, help="the first seed")
    parser.add_argument("--people", type=int, default=1, help="who walk during the study run")
    parser.add_argument("--sites", nargs="+", default=list(shipped_sites()))
    wanted = parser.parse_args()
    print("  ", DOCKING, UNDOCKING, STATION, sep="\n  ", flush=True)
    studies = wanted.study_runs if wanted.study_runs is not None else max(1, wanted.runs // 3)
    figures, details, begun, simulated = [], {}, time.perf_counter(), 0.0
    for series, model in sorted(MODELS.items()):
        dockings, drives = Counter[str](), Counter[str]()
        for site in wanted.sites:
            world = TrueWorld(load_site(site), model)
            if world.site.plan.dock_of(series) is None:
                continue
            for seed in range(wanted.first, wanted.first + wanted.runs):
                outcome, seconds = docked_in(world, seed)
                dockings[outcome] += 1
                simulated += seconds
            for seed in range(
                wanted.first, wanted.first + (studies if world.site.plan.route_of(series) else 0)
            ):
                outcome, seconds = study_run(world, seed, wanted.people)
                drives[outcome] += 1
                simulated += seconds
        print(f"  {series}: {dict(dockings)} {dict(drives)}", flush=True)
        good = dockings["docked at try 1"] + dockings["docked at try 2"]
        figures.append(
            Figure(
                f"{series}: not docked at the first or second try",
                100.0 * (1.0 - good / max(dockings.total(), 1)),
                "%",
                3.0,
            )
        )
        figures.append(
            Figure(
                f"{series}: study runs that failed",
                100.0 * (1.0 - drives["done"] / max(drives.total(), 1)),
                "%",
                5.0,
            )
        )
        details[series] = {"dockings": dict(dockings), "study": dict(drives)}
    figures.append(Figure("simulated hours", simulated / 3600.0, "h"))
    figures.append(
        Figure("simulated seconds a second", simulated / (time.perf_counter() - begun), "")
    )
    return keep("docking", figures, how=vars(wanted), **details)


if __name__ == "__main__":
    sys.exit(main())
