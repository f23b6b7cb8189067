"""Sites made from real maps, driven in: `python -m benchmarks.driving.mapped_sites office.yaml
willow.yaml:0.35`.

Each map becomes a site as `make_site` makes it, nothing finished by hand; a number behind a colon
is the occupancy from which a cell is a wall. In each, the robot goes to random places with its own
navigation and localization; it knows the robot's map, and the world that it drives in is the
proposed plan. A goal is reachable when a robot can get there on the map and in the plan. The maps
are not part of the project: docs/howto/make-a-site.md says where the usual ones come from.
"""

import argparse
import dataclasses
import math
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.driving.navigation import AT_GOAL, JUDGING, TIMEOUT
from benchmarks.driving.true_world import TrueWorld
from benchmarks.table import Figure, keep
from robots.agent.simulator.physics.simulation import Simulation
from robots.world.grid import OCCUPIED, OccupancyGrid, load_grid
from robots.world.inspection import inspect_site
from robots.world.render_plan import rasterise
from robots.world.robot_models import MODELS, RobotModel
from robots.world.sites import Site
from robots.world.tracing.proposal import propose_plan
from tests.support.navigation_rig import Rig


@dataclasses.dataclass
class Drives:
    """What became of the drives in one site."""

    arrived: int = 0
    contacts: int = 0
    notes: list[str] = dataclasses.field(default_factory=list)


def made_site(wanted: str) -> Site:
    """Return the site that is proposed for `MAP.yaml` or `MAP.yaml:OCCUPIED`."""
    name, _, threshold = wanted.partition(":")
    grid = load_grid(Path(name))
    if threshold:
        grid = dataclasses.replace(grid, occupied_thresh=float(threshold))
    plan = propose_plan(grid, "mapped", Path(name).stem)
    problems = inspect_site(plan, grid)
    if problems:
        raise SystemExit(f"{name}: {'; '.join(problems)}")
    return Site(plan, grid, Path(name).parent)


def common_grid(site: Site) -> OccupancyGrid:
    """Return the map with what only the plan has: where a robot can be in both."""
    grid, drawn = site.grid, rasterise(site.plan)
    free = np.pad(drawn.free(), 1)
    image = grid.image.copy()
    rows, columns = grid.free().nonzero()
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        at = drawn.transform.to_cell(*grid.transform.to_world(column + 0.5, row + 0.5))
        down, right = (min(max(at[axis] + 1, 0), free.shape[axis] - 1) for axis in (0, 1))
        if not free[down, right]:
            image[row, column] = 255 if grid.negate else OCCUPIED
    return dataclasses.replace(grid, image=image)


def drive(site: Site, world: TrueWorld, model: RobotModel, seed: int, drives: Drives) -> None:
    """Go from one random place to another, and count."""
    rng = np.random.default_rng([seed, 78])
    start = world.start(rng, {})
    goal = world.goal(rng, start[:2], {})
    sim = Simulation(model, site.plan, seed=seed, start="{},{},{}".format(*start))
    rig = Rig(sim, site.grid, seed, localizer=True)
    rig.navigator.goto(*goal)
    done = rig.step()
    while done.status == "RUNNING" and sim.time < TIMEOUT:
        done = rig.step()
    away = math.dist((sim.pose.x, sim.pose.y), goal)
    contacts = rig.collisions + rig.bumps
    drives.contacts += contacts
    if done.status == "FINISHED" and away <= AT_GOAL:
        drives.arrived += 1
    elif not contacts:
        drives.notes.append(
            f"seed {seed}: {done.status} {done.reason} {away:.1f} m from ({goal[0]:.1f},"
            f" {goal[1]:.1f}) after {sim.time:.0f} s, start ({start[0]:.1f}, {start[1]:.1f})"
        )
    if contacts:
        drives.notes.append(f"seed {seed}: {done.status}, touched {', '.join(rig.collided_with)}")


def main() -> int:
    """Drive, print and keep the figures; return how many missed their bound."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", nargs="+", metavar="MAP.yaml[:OCCUPIED]")
    parser.add_argument("--goals", type=int, default=20, help="for each map and robot")
    parser.add_argument("--first", type=int, default=JUDGING, help="the first seed")
    parser.add_argument("--series", nargs="+", default=sorted(MODELS))
    wanted = parser.parse_args()
    total, arrived, contacts, notes, seconds = 0, 0, 0, [], 0.0
    for name in wanted.maps:
        begun = time.perf_counter()
        site = made_site(name)
        seconds = max(seconds, time.perf_counter() - begun)
        common = dataclasses.replace(site, grid=common_grid(site))
        for series in wanted.series:
            world, drives = TrueWorld(common, MODELS[series]), Drives()
            for seed in range(wanted.first, wanted.first + wanted.goals):
                drive(site, world, MODELS[series], seed, drives)
            print(
                f"  {name} {series}: {drives.arrived} of {wanted.goals} reached,"
                f" {drives.contacts} contacts",
                *drives.notes,
                sep="\n    ",
                flush=True,
            )
            total, arrived = total + wanted.goals, arrived + drives.arrived
            contacts += drives.contacts
            notes += [f"{name} {series} {note}" for note in drives.notes]
    figures = [
        Figure("goals that were not reached", 100.0 * (total - arrived) / total, "%", 2.0),
        Figure("contacts", contacts, "", 0.0),
        Figure("seconds to propose the slowest plan", seconds, "s"),
    ]
    return keep("mapped_sites", figures, notes=notes, how=vars(wanted))


if __name__ == "__main__":
    sys.exit(main())
