"""Localization by a particle filter on laser and odometry, with a search of the whole map for a
robot that is lost.

    unknown ──search──► particles at every place that fits ──drive──► one cluster ──match──► pose
                ▲                                                            │
                └──────────── the scans stop fitting (carried away) ◄────────┘

Pure. The filter works at the times of the scans; an estimate moves the last pose on by odometry. A
search is spread over updates in slices, so that none takes much longer than another.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from robots.agent.localization.field import field_of
from robots.agent.localization.global_search import Found, GlobalSearch, Search, Searching
from robots.agent.localization.motion_model import MotionNoise, move
from robots.agent.localization.particle_filter import (
    Cluster,
    ParticleSet,
    Sampling,
    heaviest_cluster,
    places,
    scattered,
    uniform,
)
from robots.agent.localization.scan_matching import Matching, refine
from robots.agent.localization.sensor_model import (
    Agreement,
    SensorModel,
    Sweep,
    agreement,
    likelihood_field,
    sweep_of,
)
from robots.agent.safety.collision.odometry import OdometryTrack
from robots.api.geometry import Pose2D, wrap_angle
from robots.world.grid import OccupancyGrid
from robots.world.sensing import CENTRE, Covariance, Estimate, Floats, LaserScan

NOWHERE: Covariance = (1e4, 0.0, 0.0, 1e4, 0.0, 10.0)  # variances of an unknown pose
# what cells of five centimetres leave open however much the guesses agree
FLOOR = np.diag([0.02**2, 0.02**2, 0.01**2])


@dataclass(frozen=True)
class Scoring:
    """The conversion of a pose's merit into a score."""

    lost: float = 0.5  # score below which the robot is lost
    even: float = 0.52  # merit of a pose that scores one half
    slope: float = 14.0  # how fast the score rises there
    memory: float = 1.5  # s over which the score follows, so that a passer-by costs no pose
    granted: float = 0.3  # m without a sweep for which the score holds
    blind: float = 4.0  # m after that, over which it falls to 1/e
    plausible: float = 0.4  # merit from which a search takes a pose
    proof: float = 1.0  # m for which one of several places has to hold until it is believed


def quality(judged: Agreement, scoring: Scoring) -> float:
    """Return how well one scan fits one pose, from 0 to 1."""
    return 1.0 / (1.0 + math.exp(-scoring.slope * (float(judged.merit[0]) - scoring.even)))


def decay(step: Pose2D, scoring: Scoring) -> float:
    """Return the share of a score that remains after a step on odometry alone."""
    return math.exp(-max(0.0, metres_of(step) - scoring.granted) / scoring.blind)


def metres_of(step: Pose2D) -> float:
    """Return the metres of a step; a radian counts as half a metre."""
    return math.hypot(step.x, step.y) + 0.5 * abs(step.theta)


@dataclass(frozen=True)
class Settings:
    """All tuning constants, for an indoor robot with a laser of some metres and 180 degrees or
    more.

    A scan is weighed when the robot has moved; at rest, the first few are, and all that are
    informative.
    """

    sensor: SensorModel = field(default_factory=SensorModel)
    motion: MotionNoise = field(default_factory=MotionNoise)
    sampling: Sampling = field(default_factory=Sampling)
    matching: Matching = field(default_factory=Matching)
    searching: Searching = field(default_factory=Searching)
    scoring: Scoring = field(default_factory=Scoring)
    distance: float = 0.05  # m between two sweeps that are weighed
    turn: float = math.radians(3.0)  # rad, the same
    pause: float = 0.5  # s, the same while the robot stands
    at_rest: int = 4  # sweeps that are weighed while it is at rest
    much: float = 0.5  # share of a sweep that says something, from which later ones are too
    beams: int = 60  # that weigh a particle
    matched: int = 120  # beams that are matched to the map
    fewest_beams: int = 12  # a sweep with fewer is ignored
    shortest: float = 0.1  # m: nor does a beam that is shorter
    cluster: float = 0.6  # m within which particles are one place
    cluster_turn: float = math.radians(30.0)  # rad, the same
    clear: float = 0.9999  # share of the weight: with less, all places are judged thoroughly
    again: float = 1.0  # s from one search to the next
    again_here: float = 4.0  # s, the same while the robot is where the last one was
    elsewhere: float = 0.2  # m from there that are another place
    # share by which the score follows sweeps that say little: a robot that was carried away has to
    # notice within seconds
    least_gain: float = 0.3
    # log odds that a robot which seems lost is where it thought, and only surrounded, against
    # having been carried away
    stay_log_odds: float = 3.0


class Localizer:
    """One robot on one map, lost until `set_pose` or a search."""

    def __init__(
        self, grid: OccupancyGrid, rng: np.random.Generator, settings: Settings | None = None
    ) -> None:
        """Read the map; raises MapError without free space or obstacles."""
        self.settings = settings or Settings()
        self.rng = rng
        self.field = field_of(grid)
        self.likelihood = likelihood_field(self.field, self.settings.sensor)
        self.search = GlobalSearch(self.field, self.settings.sensor, self.settings.searching)
        self.track = OdometryTrack()
        self.forget()

    def forget(self) -> None:
        """Lose the pose: the next scan starts a search of the whole map."""
        self.particles: ParticleSet | None = None
        self.believed: Cluster | None = None
        self.confidence = self.match_score = 0.0
        self.judged = Agreement(np.zeros(1), np.zeros(1), np.zeros(1))
        self._searching: Search | None = None
        self._searched_from = CENTRE
        self._searched_at = -math.inf
        self._weighed_from = CENTRE
        self._judged_at = -math.inf
        self._stood = 0
        self._seen_at = -math.inf
        self._jumps = self.track.jumps
        self._proven = math.inf
        self._contested = False

    def set_pose(self, pose: Pose2D, spread: float = 0.5, turn: float = math.radians(20.0)) -> None:
        """Accept `pose`, with standard deviations `spread` (metres) and `turn` (radians)."""
        self.forget()
        # the given pose is trusted until the laser disagrees
        self.confidence = self.match_score = self.settings.scoring.lost
        start = np.array([self.field.world_from_field.inverse().compose(pose)])
        count = np.array([self.settings.sampling.most])
        self.particles = uniform(scattered(start, count, spread, turn, self.rng))
        self.believed = heaviest_cluster(self.particles, 3.0 * spread + 0.1, math.pi)
        self._weighed_from = self.track.newest()

    def update(
        self, stamp: float, odometry: Pose2D, beams: LaserScan | None, *, docked: bool = False
    ) -> Estimate:
        """Take the sensors' data and return the estimate at `stamp`, seconds by the robot's clock.

        `odometry` is in a frame of its own; `beams` is the newest scan, which may be None or an
        earlier one; a `docked` robot feels the contacts of its station.
        """
        here = self.track.add(stamp, odometry)
        if self.track.jumps != self._jumps:
            self._jumps = self.track.jumps
            self._open_up()
        if beams is not None and beams.stamp != self._seen_at and math.isfinite(beams.stamp):
            self._seen_at = beams.stamp
            self._see(sweep_of(beams, self.settings.shortest), beams.stamp, docked=docked)
        if self._searching is not None:
            self._search_on()
        return self._estimate(stamp, here)

    def _see(self, sweep: Sweep, stamp: float, *, docked: bool) -> None:
        if len(sweep) < self.settings.fewest_beams:
            return
        there = self.track.at(stamp)
        step = self._weighed_from.inverse().compose(there)
        if self.particles is None:
            self._weighed_from = there
        elif _exceeds(step, self.settings.distance, self.settings.turn):
            self._stood = 0
            self._weigh(sweep, there, stamp)
        elif not 0.0 <= stamp - self._judged_at < self.settings.pause:
            self._stand(sweep, there, stamp, docked=docked)
        if self._is_time_to_search(there, stamp):
            self._searching = self.search.begin(sweep)
            self._searched_from = there
            self._searched_at = stamp

    def _is_time_to_search(self, there: Pose2D, stamp: float) -> bool:
        if self._searching is not None or self.match_score >= self.settings.scoring.lost:
            return False
        moved = metres_of(self._searched_from.inverse().compose(there)) >= self.settings.elsewhere
        pause = self.settings.again if moved else self.settings.again_here
        return not 0.0 <= stamp - self._searched_at < pause

    def _stand(self, sweep: Sweep, there: Pose2D, stamp: float, *, docked: bool) -> None:
        """Weigh the first scans of a robot at rest, and those that are informative: a door at its
        nose would slowly bend the pose. So would a station that is not where the map has it, close
        before a docked robot, where none is weighed while they fit.
        """
        self._stood += 1
        fits = docked and self.match_score >= self.settings.scoring.lost
        is_telling = self._stood <= self.settings.at_rest or self._telling() > self.settings.much
        if is_telling and not fits:
            self._weigh(sweep, there, stamp)
        elif self.believed is not None:
            step = self._weighed_from.inverse().compose(there)
            pose = Pose2D(*self.believed.mean.tolist()).compose(step)
            self._judge(np.array([pose]), sweep, stamp)

    def _weigh(self, sweep: Sweep, there: Pose2D, stamp: float) -> None:
        assert self.particles is not None
        step, self._weighed_from = self._weighed_from.inverse().compose(there), there
        self._proven += metres_of(step)
        poses = move(self.particles.poses, step, self.settings.motion, self.rng)
        evidence = self._telling() * self._evidence(poses, sweep)
        evidence -= 5.0 * ~self.field.is_free(poses[:, 0], poses[:, 1])
        particles = ParticleSet(poses, self.particles.weights).reweighted(evidence)
        self.believed = self._match(particles, sweep)
        self._judge(self.believed.mean[None], sweep, stamp)
        self._contested = self.believed.share < self.settings.clear
        if particles.is_depleted():
            particles = particles.resampled(self.settings.sampling, self.rng)
        self.particles = particles

    def _evidence(self, poses: Floats, sweep: Sweep) -> Floats:
        """Return (n,) the log-likelihoods of a scan at poses (n, 3).

        Within one place the distances of the beams' ends decide. Between places what lies between
        robot and wall decides, too costly for every particle: an open door's leaf beside the robot
        may hide half of what the map predicts, and a corner elsewhere that shows a wall there would
        win by as many beams, if it did not need some others to pass through its walls.
        """
        sensor, some = self.settings.sensor, sweep.thinned(self.settings.beams)
        fits = self.likelihood.of(poses, some)
        if not self._contested:
            return fits
        owner, best = places(poses, fits, self.settings.cluster, self.settings.cluster_turn)
        merit = agreement(self.field, sensor, poses[best], some).against_others
        return fits + (sensor.log_likelihood_scale * merit - fits[best])[owner]

    def _match(self, particles: ParticleSet, sweep: Sweep) -> Cluster:
        """Return the heaviest cluster, its mean moved onto the map if it fits better there."""
        cluster = heaviest_cluster(particles, self.settings.cluster, self.settings.cluster_turn)
        covariance = cluster.covariance + FLOOR
        prior = np.asarray(np.linalg.inv(covariance), dtype=np.float64) / self._telling()
        start, points = cluster.mean[None], sweep.thinned(self.settings.matched).points
        matched = refine(self.field, start, points, prior, self.settings.matching)
        both = np.vstack([start, matched])
        best = both[np.argmax(self.likelihood.of(both, sweep))]
        return Cluster(best, covariance, cluster.share)

    def _judge(self, pose: Floats, sweep: Sweep, stamp: float) -> None:
        """Update score and confidence by how well the accepted pose (1, 3) explains a scan."""
        assert self.believed is not None
        seconds, self._judged_at = min(max(stamp - self._judged_at, 0.0), 1.0), stamp
        scoring, some = self.settings.scoring, sweep.thinned(self.settings.beams)
        self.judged = agreement(self.field, self.settings.sensor, pose, some)
        certain = self.believed.share**4 * min(1.0, self._proven / scoring.proof)
        match_score = quality(self.judged, scoring)
        weight = max(self._telling(), self.settings.least_gain)
        gain = 1.0 - math.exp(-seconds * weight / scoring.memory)
        self.match_score += (match_score - self.match_score) * gain
        self.confidence += (match_score * certain - self.confidence) * gain

    def _telling(self) -> float:
        """Return how informative a scan is, from 0.1 to 1: less with ends on unmapped things."""
        return max(0.1, 1.0 - float(self.judged.short[0])) if self.believed is not None else 1.0

    def _search_on(self) -> None:
        assert self._searching is not None
        try:
            next(self._searching)
        except StopIteration as end:
            self._searching = None
            self._consider(end.value)

    def _consider(self, found: Found) -> None:
        """Add particles at the places that a search has found."""
        good = found.merit >= self.settings.scoring.plausible
        if not good.any():
            return
        step = self._searched_from.inverse().compose(self._weighed_from)
        still = MotionNoise(0.0, 0.0, 0.0, 0.0)
        poses = move(found.poses[good], step, still, self.rng)
        scale = self.settings.sensor.log_likelihood_scale
        share = np.exp(scale * (found.merit[good] - found.merit[0]))
        each = np.full(len(poses), max(self.settings.sampling.fewest // len(poses), 50))
        self.match_score = max(self.match_score, self.settings.scoring.lost)
        self._proven, self._stood = math.inf if len(poses) == 1 else 0.0, 0
        hypotheses = scattered(poses, each, 0.08, math.radians(2.5), self.rng)
        weights = np.repeat(share / each, each)
        if self.particles is not None:
            better = float(self.judged.against_others[0]) - float(found.merit[0])
            stay = math.exp(scale * better + self.settings.stay_log_odds)
            hypotheses = np.vstack([self.particles.poses, hypotheses])
            weights = np.concatenate([self.particles.weights * stay, weights])
        self.particles = ParticleSet(hypotheses, weights / weights.sum())
        self._contested = True

    def _open_up(self) -> None:
        """Spread the particles: the odometry jumped, and the robot may have moved."""
        if self.particles is not None:
            poses, sigmas = self.particles.poses, (0.15, 0.15, math.radians(8.0))
            spread = self.rng.standard_normal(poses.shape) * sigmas
            self.particles = ParticleSet(poses + spread, self.particles.weights)

    def _estimate(self, stamp: float, here: Pose2D) -> Estimate:
        if self.believed is None:
            high, wide = (cells * self.field.resolution for cells in self.field.signed.shape)
            middle = self.field.world_from_field.compose(Pose2D(wide / 2.0, high / 2.0, 0.0))
            return Estimate(stamp, middle, NOWHERE, 0.0, localized=False)
        step = self._weighed_from.inverse().compose(here)
        x, y, theta = (float(value) for value in self.believed.mean)
        pose = self.field.world_from_field.compose(Pose2D(x, y, wrap_angle(theta)).compose(step))
        score = self.confidence * decay(step, self.settings.scoring)
        localized = score >= self.settings.scoring.lost
        return Estimate(stamp, pose, self._covariance(step), score, localized=localized)

    def _covariance(self, step: Pose2D) -> Covariance:
        assert self.believed is not None
        noise, metres, turn = self.settings.motion, math.hypot(step.x, step.y), abs(step.theta)
        grown = self.believed.covariance.copy()
        grown[2, 2] += noise.turn_by_turn * turn + noise.turn_by_distance * metres
        along = noise.distance_by_distance * metres + noise.distance_by_turn * turn
        grown[[0, 1], [0, 1]] += along + metres**2 * grown[2, 2]
        turned = np.eye(3)
        cosine = math.cos(self.field.world_from_field.theta)
        sine = math.sin(self.field.world_from_field.theta)
        turned[:2, :2] = [[cosine, -sine], [sine, cosine]]
        world: Floats = turned @ grown @ turned.T
        return tuple(world[np.triu_indices(3)].tolist())


def _exceeds(step: Pose2D, metres: float, radians: float) -> bool:
    return math.hypot(step.x, step.y) >= metres or abs(step.theta) >= radians
