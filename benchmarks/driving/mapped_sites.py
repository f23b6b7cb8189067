"""Sites made from real maps by the pages of the administration, driven in: `python -m
benchmarks.driving.mapped_sites office.yaml willow.yaml:0.35`.

Each map is uploaded, a plan is proposed and saved as the page shows it, nothing corrected; a number
behind a colon is the least occupancy of a wall, as it is typed on the page. From its charging
station the robot goes to one goal after the other with its own navigation and localization, then
back into the station. It knows the robot's map, and the world that it drives in is the proposed
plan. A goal that is not reached is not tried again; the next one begins where the robot is then.

The goals are spread over the floor by a seed. Each is where the page would accept a place, and
where a robot with this footprint can stand and get to on the map and in the plan. The maps are not
part of the project: docs/howto/make-a-site.md says where the usual ones come from.
"""

import argparse
import dataclasses
import itertools
import math
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import scipy

from benchmarks.driving.navigation import AT_GOAL, JUDGING, TIMEOUT
from benchmarks.driving.true_world import Spot, TrueWorld
from benchmarks.table import Figure, keep
from robots.agent.navigation.planning.costmap import CostMap, NoWayError
from robots.agent.navigation.planning.steps import NavigationStep
from robots.api.geometry import Pose2D
from robots.simulator.physics.simulation import Simulation
from robots.world.grid import OCCUPIED, OccupancyGrid
from robots.world.inspection import BACKED_OUT, Floor, drawn_plan
from robots.world.render_plan import rasterise
from robots.world.robot_models import MODELS, RobotModel
from robots.world.sites import Site, load_site
from tests.support.agents.navigation_rig import Rig

CANDIDATES = 16  # of which the one farthest from all goals so far is the next


@dataclasses.dataclass
class Drives:
    """The results of the drives in one site: "reached", "refused" or "failed"."""

    outcomes: Counter[str] = dataclasses.field(default_factory=Counter)
    contacts: int = 0
    docked: bool = False
    metres: float = 0.0
    notes: list[str] = dataclasses.field(default_factory=list)


def made_sites(maps: list[str], folder: Path) -> dict[str, Site]:
    """Return the site that the pages make of each `MAP.yaml` or `MAP.yaml:OCCUPIED`, for a site of
    the project that keeps its data in `folder`.
    """
    os.environ["DJANGO_SETTINGS_MODULE"], os.environ["VAR_DIR"] = "tests.settings", str(folder)
    import django

    django.setup()
    from django.contrib.auth import get_user_model
    from django.core.management import call_command
    from django.test import Client
    from django.test.utils import setup_test_environment

    from tests.support.agents.page_sites import site_by_page

    setup_test_environment()
    call_command("migrate", verbosity=0)
    client = Client()
    client.force_login(get_user_model().objects.create_superuser("owner"))
    sites = {}
    for wanted in maps:
        name, _, occupied = wanted.partition(":")
        path = Path(name)
        sites[wanted] = load_site(str(site_by_page(client, path, path.stem, occupied)))
    return sites


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


def spread_goals(site: Site, model: RobotModel, seed: int, count: int) -> list[Spot]:
    """Return goals, each the candidate that is farthest from the station and from all before."""
    rng = np.random.default_rng([seed, 79])
    common = common_grid(site)
    world = TrueWorld(dataclasses.replace(site, grid=common), model)
    costmap = CostMap(common, np.array(model.footprint))
    fits = scipy.ndimage.label(costmap.clearance >= costmap.least, np.ones((3, 3)))[0]
    floors = (Floor.of(site.grid), Floor.of(drawn_plan(site.plan)))
    dock = site.plan.dock_of(model.series)
    assert dock is not None, f"no station for {model.series} was proposed"
    begin = Pose2D(dock.x, dock.y, dock.theta).apply(-BACKED_OUT, 0.0)
    home = costmap.sample(fits, np.array([begin]))[0]
    rows, columns = (floors[0].region == floors[0].largest).nonzero()
    goals = [begin]
    while len(goals) <= count:
        candidates: list[Spot] = []
        while len(candidates) < CANDIDATES:
            cell = int(rng.integers(len(rows)))
            spot = site.grid.transform.to_world(columns[cell] + 0.5, rows[cell] + 0.5)
            is_near = costmap.sample(fits, np.array([spot]))[0] == home
            if is_near and floors[1].is_reached(*spot):
                candidates.append(spot)
        candidates.sort(key=lambda spot: -min(math.dist(spot, goal) for goal in goals))
        reached = (s for s in candidates if world.shortest(begin, s, {}) is not None)
        goals += itertools.islice(reached, 1)
    return goals[1:]


def tour(site: Site, model: RobotModel, goals: list[Spot], seed: int) -> Drives:
    sim = Simulation(model, site.plan, seed=seed)
    rig, drives = Rig(sim, site.grid, seed, localizer=True), Drives()
    for number, goal in enumerate(goals, start=1):
        begun, before = sim.time, sim.contacts
        touched = len(rig.collided_with)
        try:
            rig.navigator.goto(*goal)
        except NoWayError as error:
            done, outcome = NavigationStep(None, "FAILED", str(error)), "refused"
        else:
            done, outcome = rig.run(TIMEOUT), "failed"
        away = math.dist((sim.pose.x, sim.pose.y), goal)
        if done.status == "FINISHED" and away <= AT_GOAL:
            outcome = "reached"
        drives.outcomes[outcome] += 1
        contacts = sim.contacts - before
        note = (
            f"{site.plan.map_id} {model.series} goal {number} ({goal[0]:.2f}, {goal[1]:.2f}):"
            f" {outcome}, {away:.2f} m away, {sim.time - begun:.0f} s, {contacts} contacts"
            f" {done.reason}"
        )
        print("   ", note, flush=True)
        if outcome != "reached" or contacts:
            drives.notes.append(f"{note} {', '.join(rig.collided_with[touched:])}")
    rig.navigator.dock()
    done = rig.run(TIMEOUT)
    drives.docked = sim.docked
    if not sim.docked:
        drives.notes.append(f"{site.plan.map_id} {model.series} not docked: {done.reason}")
    drives.contacts, drives.metres = sim.contacts, sim.distance
    return drives


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", nargs="+", metavar="MAP.yaml[:OCCUPIED]")
    parser.add_argument("--goals", type=int, default=20, help="for each map and robot")
    parser.add_argument("--seed", type=int, default=JUDGING)
    parser.add_argument("--series", nargs="+", default=sorted(MODELS))
    wanted = parser.parse_args()
    outcomes, contacts, undocked, notes = Counter[str](), 0, 0, list[str]()
    with tempfile.TemporaryDirectory() as folder:
        sites = made_sites(wanted.maps, Path(folder))
    for name, site in sites.items():
        for series in wanted.series:
            begun = time.perf_counter()
            goals = spread_goals(site, MODELS[series], wanted.seed, wanted.goals)
            drives = tour(site, MODELS[series], goals, wanted.seed)
            print(
                f"  {name} {series}: {dict(drives.outcomes)} of {wanted.goals},"
                f" {drives.contacts} contacts, {drives.metres:.0f} m,"
                f" {'docked' if drives.docked else 'NOT docked'},"
                f" {time.perf_counter() - begun:.0f} s",
                flush=True,
            )
            outcomes += drives.outcomes
            contacts += drives.contacts
            undocked += not drives.docked
            notes += drives.notes
    total = sum(outcomes.values())
    figures = [
        Figure("goals", total, ""),
        Figure("goals that were not reached", 100.0 * (1 - outcomes["reached"] / total), "%", 2.0),
        Figure("of them refused before the drive", outcomes["refused"], ""),
        Figure("contacts", contacts, "", 0.0),
        Figure("tours that did not end in the station", undocked, "", 0.0),
    ]
    return keep("mapped_sites", figures, notes=notes, how=vars(wanted))


if __name__ == "__main__":
    sys.exit(main())
