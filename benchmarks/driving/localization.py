"""How well a robot knows where it is: drives among people and moving doors, starts without knowing,
and being carried away.

`python -m benchmarks.driving.localization --runs N` makes N drives of five minutes, and as many
short ones for each of the other two questions. Everything is simulated and seeded; judging takes
seeds from 20,000 on, tuning took those below (1,000 to 1,999).
"""

import argparse
import math
import sys
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.table import Figure, keep
from robots.agent.localization.localizer import Localizer, Settings
from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import MODELS
from robots.world.sensing import Estimate
from robots.world.sites import Site, load_site, shipped_sites
from tests.support.agents.wanderer import TICK, Wanderer, Ways, standing_somewhere

JUDGING = 20_000
EVERY = round(0.1 / TICK)  # ticks between two updates: 10 Hz
PEOPLE = 4
DOORS = 60.0  # seconds between two changes of a door, on average
SETTLED = 2.0  # seconds a robot may take to make use of the pose it was given
NEAR, TURNED = 0.3, math.radians(10.0)  # found: that near to the truth


@dataclass
class LocalizationRun:
    """One robot, driven about, and what it believes."""

    simulation: Simulation
    wanderer: Wanderer
    localizer: Localizer

    def update(self) -> tuple[Estimate, float]:
        """Let a tenth of a second pass and return what the localizer makes of it, and the
        milliseconds it took.
        """
        for _ in range(EVERY):
            self.wanderer.step()
        beams = self.simulation.beams()
        began = time.thread_time()
        estimate = self.localizer.update(self.simulation.time, self.simulation.odometry, beams)
        return estimate, 1000.0 * (time.thread_time() - began)

    def errors(self, estimate: Estimate) -> tuple[float, float]:
        """Return by how many metres and radians an estimate is wrong."""
        truth: Pose2D = self.simulation.pose
        return truth.distance(estimate.pose), abs(wrap_angle(estimate.pose.theta - truth.theta))

    def is_found(self, estimate: Estimate) -> bool:
        away, turned = self.errors(estimate)
        return estimate.localized and away < NEAR and turned < TURNED


def begin(seed: int, sites: dict[str, tuple[Site, Ways]]) -> LocalizationRun:
    names = sorted(sites)
    site, ways = sites[names[seed // 2 % len(names)]]
    model = MODELS[sorted(MODELS)[seed % 2]]
    simulation = Simulation(model, site.plan, seed=seed, people=PEOPLE, door_changes=DOORS)
    wanderer = standing_somewhere(simulation, ways, np.random.default_rng([seed, 1]))
    return LocalizationRun(
        simulation, wanderer, Localizer(site.grid, np.random.default_rng([seed, 2]))
    )


@dataclass
class Tracked:
    """A drive with a known start: errors in metres and degrees, milliseconds an update, share of
    the time that it thought itself lost.
    """

    away: list[float]
    turned: list[float]
    cost: list[float]
    lost: float


def track(drive: LocalizationRun, seconds: float) -> Tracked:
    """Drive around from a start pose that the robot knows to within 0.1 m and ten degrees."""
    drive.localizer.set_pose(drive.simulation.pose, 0.1, math.radians(10.0))
    result, lost = Tracked([], [], [], 0.0), 0
    while drive.simulation.time < seconds:
        estimate, cost = drive.update()
        if drive.simulation.time < SETTLED:
            continue
        away, turned = drive.errors(estimate)
        result.away.append(away)
        result.turned.append(math.degrees(turned))
        result.cost.append(cost)
        lost += not estimate.localized
    result.lost = lost / len(result.away)
    return result


def find(drive: LocalizationRun, seconds: float = 60.0) -> tuple[float, float, float]:
    """Return the seconds from knowing nothing to being right, the share of the time that it was
    wrong and sure, and the longest update in ms.
    """
    found, wrong, updates, longest = math.inf, 0, 0, 0.0
    begin_at = drive.simulation.time
    while drive.simulation.time - begin_at < seconds:
        estimate, cost = drive.update()
        updates, longest = updates + 1, max(longest, cost)
        wrong += estimate.localized and not drive.is_found(estimate)
        if drive.is_found(estimate):
            found = min(found, drive.simulation.time - begin_at)
    return found, wrong / updates, longest


def carry(drive: LocalizationRun, seconds: float = 60.0) -> tuple[float, float]:
    """Return the seconds from being carried away to noticing it, or being right without, and to
    being right again.
    """
    drive.localizer.set_pose(drive.simulation.pose, 0.1, math.radians(10.0))
    while drive.simulation.time < 20.0:
        drive.update()
    drive.wanderer.carry_away()
    carried, noticed, found = drive.simulation.time, math.inf, math.inf
    while found == math.inf and drive.simulation.time - carried < seconds:
        estimate, _ = drive.update()
        since = drive.simulation.time - carried
        if drive.is_found(estimate):
            found = since
        if found == since or not estimate.localized:
            noticed = min(noticed, since)
    return noticed, found


def missed(values: list[float], limit: float = math.inf) -> float:
    """Return how many percent of the values are not below a limit."""
    return 100.0 * sum(not value < limit for value in values) / len(values)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--first", type=int, default=JUDGING, help="the first seed")
    return parser.parse_args()


def drives(seeds: range, seconds: float, sites: dict[str, tuple[Site, Ways]]) -> list[Tracked]:
    tracked = []
    for seed in seeds:
        one = track(begin(seed, sites), seconds)
        tracked.append(one)
        print(
            f"drive {seed}: median {np.median(one.away):.3f} m, p95"
            f" {np.percentile(one.away, 95):.3f} m, {np.percentile(one.turned, 95):.2f}°, lost"
            f" {one.lost:.1%}",
            flush=True,
        )
    return tracked


def tracking_figures(tracked: list[Tracked]) -> list[Figure]:
    """Return how far off the poses of all drives are, and what an update costs."""
    away, turned, cost = (
        np.concatenate([getattr(one, name) for one in tracked])
        for name in ("away", "turned", "cost")
    )
    worst = max(float(np.percentile(one.away, 95)) for one in tracked)
    lost = 100.0 * float(np.mean([one.lost for one in tracked]))
    return [
        Figure("position error, median", float(np.median(away)), "m", 0.07),
        Figure("position error, p95", float(np.percentile(away, 95)), "m", 0.18),
        Figure("position error, worst drive's p95", worst, "m"),
        Figure("heading error, p95", float(np.percentile(turned, 95)), "degrees", 2.0),
        Figure("time thought lost on drives", lost, "%"),
        Figure("update, median", float(np.median(cost)), "ms", 4.0),
        Figure("update, p99", float(np.percentile(cost, 99)), "ms"),
    ]


def unknown_figures(unknown: list[tuple[float, float, float]]) -> list[Figure]:
    """Return how robots fare that begin without a pose (`find`)."""
    found, wrong, longest = zip(*unknown, strict=True)
    not_found = missed(list(found), 60.0)
    return [
        Figure("update while searching, longest", max(longest), "ms"),
        Figure("unknown pose not found in 60 s of driving", not_found, "%", 10.0),
        Figure("unknown pose, time wrong and sure", 100.0 * float(np.mean(wrong)), "%"),
    ]


def carried_figures(carried: list[tuple[float, float]]) -> list[Figure]:
    """Return how robots fare that are carried away (`carry`)."""
    noticed, found = zip(*carried, strict=True)
    return [
        Figure("carried away and not noticed in 10 s", missed(list(noticed), 10.0), "%", 5.0),
        Figure("carried away and not found in 60 s", missed(list(found), 60.0), "%", 15.0),
    ]


def main() -> int:
    asked = arguments()
    print(Settings(), flush=True)
    loaded = {name: load_site(name) for name in shipped_sites()}
    sites = {name: (site, Ways(site.grid)) for name, site in loaded.items()}
    seeds = range(asked.first, asked.first + asked.runs)
    tracked = drives(seeds, asked.seconds, sites)
    unknown = [find(begin(seed + 10_000, sites)) for seed in seeds]
    print(
        "from an unknown pose, seconds, wrong and sure, ms:",
        [(round(a, 1), round(b, 3), round(c)) for a, b, c in unknown],
        flush=True,
    )
    carried = [carry(begin(seed + 20_000, sites)) for seed in seeds]
    print(
        "carried away, seconds to noticing and to knowing:",
        [(round(a, 1), round(b, 1)) for a, b in carried],
        flush=True,
    )
    return keep(
        "localization",
        [*tracking_figures(tracked), *unknown_figures(unknown), *carried_figures(carried)],
        runs=asked.runs,
        first=asked.first,
        unknown=[a for a, _, _ in unknown],
        carried=carried,
    )


if __name__ == "__main__":
    sys.exit(main())
