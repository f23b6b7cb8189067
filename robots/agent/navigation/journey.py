"""Getting to places: plan, follow, replan when blocked, wait without a way, and report why at last.

The robot waits for people and for doors: while no way is known, or a person walks before it, it
stops and looks. It backs off a little from obstacles that are too close, where that is free.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.obstacles.blocked_reason import what_blocks
from robots.agent.navigation.obstacles.local_map import LocalObstacleMap
from robots.agent.navigation.planning.follower import Followed, Follower
from robots.agent.navigation.planning.path import PlannedPath
from robots.agent.navigation.planning.planner import PLANNER, Planner
from robots.agent.navigation.planning.steps import NavigationStep, Sense, failed, finished
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BrakeCheck
from robots.api.floorplan import FloorPlan
from robots.api.geometry import wrap_angle
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats


@dataclass(frozen=True)
class JourneyParams:
    """When a journey plans, waits, backs off and gives up."""

    look_every: float = 0.5  # s between two looks whether the route is still free
    look_ahead: float = 5.0  # m of the route that must be free
    shorter_every: float = 5.0  # s between two looks for a shorter route
    shorter_by: float = 0.5  # m that a shorter route must save
    off_path: float = 0.4  # m beside the route, from which a new one is planned
    patience: float = 30.0  # s without a route until the action fails
    patience_with_people: float = 90.0  # s, the same with a person close before the robot
    # s after which a place beside an occupied goal will do
    beside_after: float = 5.0
    closer_looks: int = 6  # at what was seen in the way from afar
    retry_every: float = 1.0  # s between two searches for a route
    held_after: float = 2.0  # s before a thing until the robot backs off
    crept: float = 0.05  # m: a robot that moved less is still held by the same thing
    crept_turn: float = 0.15  # rad, the same
    back_off: float = 0.15  # m
    back_speed: float = 0.1  # m/s
    back_time: float = 6.0  # s, at most
    back_offs: int = 4  # without getting a metre farther
    escape_turn_rates: tuple[float, ...] = (0.0, 0.3, -0.3)  # rad/s, tried in this order
    escape_gain: float = 0.01  # m by which another way out must be better
    give_way_after: float = 5.0  # s face to face with a person
    give_way: float = 0.4  # m to back off from them
    give_way_within: float = 0.6  # m: they are close
    no_progress: float = 40.0  # s without getting `farther`
    farther: float = 0.1  # m that count as progress
    longest: float = 120.0  # s after which even a journey that seems to get on is given up
    longest_per_metre: float = 25.0  # s more for each metre of the route


JOURNEY = JourneyParams()


@dataclass(frozen=True, eq=False)
class _Way:
    """A path, the points that it leads over, and how far along it each of them is, metres."""

    path: PlannedPath
    over: list[tuple[float, float]]
    ways: list[float]


@dataclass(frozen=True, eq=False)
class _Back:
    """Getting away from something: where and when it began, by how many metres, and how."""

    begun: Sense
    way: float
    velocity: Velocity


class Journey:
    """The way over points (n, 2), all of which the map leaves free, to the last of them."""

    def __init__(
        self,
        obstacle_map: LocalObstacleMap,
        planner: Planner,
        check: BrakeCheck,
        limits: Limits,
        plan: FloorPlan | None,
        *,
        over: Sequence[tuple[float, float]],
        heading: float | None,
        params: JourneyParams = JOURNEY,
    ) -> None:
        self._obstacle_map = obstacle_map
        self._planner = planner
        self._limits = limits
        self._plan = plan
        self._params = params
        self._check = check
        self._follower = Follower(check, limits)
        self._over = list(over)
        self._heading = heading
        self._ways: list[float] = []  # along the path to each point that is left
        self._path: PlannedPath | None = None
        self._looked = -math.inf
        self._sought = -math.inf
        self._shorter = -math.inf
        self._planned_in: Floats | None = None
        self._no_way_since: float | None = None
        self._held: Sense | None = None  # since when and where
        self._back: _Back | None = None
        self._gave_way = -math.inf
        self._back_offs = 0
        self._closer_looks = 0
        self._beside = 0.0
        self._driven = 0.0
        self._longest = 0.0
        self._best = 0.0
        self._best_at: float | None = None
        self._begun: float | None = None

    def step(self, sense: Sense) -> NavigationStep:
        self._begun = sense.now if self._begun is None else self._begun
        if self._back is not None:
            return self._back_off(sense, self._back)
        self._choose_way(sense)
        if self._path is None:
            return self._wait(sense)
        self._no_way_since = None
        followed = self._follower.step(sense.pose, sense.velocity, sense.hazards)
        while (
            len(self._ways) > 1
            and self._follower.way >= self._ways[0] - self._params.off_path / 2.0
        ):
            del self._ways[0], self._over[0]
        if followed.state == "arrived":
            return finished(
                f"something stands on the goal; {self._beside:.1f} m beside it"
                if self._beside > 0.0
                else ""
            )
        return self._given_up(sense, followed) or self._on_the_way(sense, followed)

    # --- the way ----------------------------------------------------------------------------------

    def _choose_way(self, sense: Sense) -> None:
        """Plan when there is no way, or it is blocked or left; sometimes look for a shorter."""
        params = self._params
        now = sense.now
        if self._path is None:
            if now - self._sought >= params.retry_every:
                self._sought = now
                self._take(self._way(sense))
            return
        if now - self._looked < params.look_every:
            return
        self._looked = now
        if self._follower.off_path(sense.pose) > params.off_path or self._blocked(sense):
            self._sought = now
            self._take(self._way(sense))
        elif now - self._shorter >= params.shorter_every:
            self._shorter = now
            clearance = self._obstacle_map.clearance(now)
            # nothing has changed since: what was the best way still is
            if clearance is self._planned_in:
                return
            found = self._way(sense)
            if found and found.path.length < self._follower.remaining - params.shorter_by:
                self._take(found)

    def _way(self, sense: Sense) -> _Way | None:
        """Return a way over the points left; without one, a way to a closer look."""
        self._planned_in = self._obstacle_map.clearance(sense.now)
        found = self._through(sense, self._planned_in)
        if found is None and self._closer_looks < self._params.closer_looks:
            found = self._through(sense, self._obstacle_map.clearance_nearby(sense.pose, sense.now))
            self._closer_looks += 1 if found else 0
        return found

    def _through(self, sense: Sense, clearance: Floats) -> _Way | None:
        """Return a way through `clearance`, without intermediate points that are occupied."""
        here = (sense.pose.x, sense.pose.y)
        legs = [np.array([here])]
        over = list[tuple[float, float]]()
        ways = list[float]()
        driven = 0.0
        for number, point in enumerate(self._over, start=1):
            leg = self._leg(here, point, clearance)
            if leg is None and number == len(self._over):
                return None
            if leg is not None:
                here, driven = point, driven + leg.length
                legs.append(leg.points)
                over.append(point)
                ways.append(driven)
        points = np.vstack(legs)
        distinct = np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-6])
        return _Way(PlannedPath(points[distinct]), over, ways)

    def _leg(
        self, start: tuple[float, float], end: tuple[float, float], clearance: Floats
    ) -> PlannedPath | None:
        if len(self._over) > 1 and self._planner.straight(start, end, clearance):
            return self._planner.line(start, end)
        return self._planner.plan(start, end, clearance)

    def _take(self, way: _Way | None) -> None:
        self._path = way.path if way else None
        if way is None:
            return
        self._over, self._ways = way.over, way.ways
        self._longest = max(self._longest, way.path.length)
        self._best = math.inf
        self._follower.take(way.path, self._heading)

    def _blocked(self, sense: Sense) -> bool:
        ahead = self._follower.path.between(
            self._follower.way + 0.1, self._follower.way + self._params.look_ahead
        )
        costmap = self._obstacle_map.costmap
        # a start in a tight spot is no block
        least = np.minimum(costmap.least, costmap.sample(costmap.clearance, ahead))
        if self._closer_looks > 0:
            room = costmap.sample(self._obstacle_map.clearance_nearby(sense.pose, sense.now), ahead)
        else:
            room = self._obstacle_map.room_at(ahead, sense.now)
        return bool((room < least - costmap.transform.resolution).any())

    # --- getting on -------------------------------------------------------------------------------

    def _on_the_way(self, sense: Sense, followed: Followed) -> NavigationStep:
        params = self._params
        held = followed.state == "held"
        if self._held is None or self._moved_on(sense, self._held):
            self._held = sense if held else None
        if self._held is None:
            return self._running(followed.velocity, "")
        waited = sense.now - self._held.now
        holds = followed.why == "thing" and waited >= params.held_after
        if holds and self._follower.rest(sense.pose):
            return self._running(ZERO, "")
        if holds and self._back_offs < params.back_offs:
            self._obstacle_map.note(
                sense.pose, np.vstack([sense.hazards.things, sense.hazards.strangers]), sense.now
            )
            self._back, self._held = _Back(sense, params.back_off, self._way_out(sense)), None
            self._back_offs += 1
        elif followed.why == "walker" and waited >= params.give_way_after:
            self._give_way(sense)
        if not held:
            return self._running(followed.velocity, "")
        return self._running(
            ZERO,
            (
                "waits for somebody in the way"
                if followed.why == "walker"
                else "something stands very close"
            ),
        )

    def _moved_on(self, sense: Sense, held: Sense) -> bool:
        """Tell whether the robot got away from where it was held; creeping does not count."""
        params = self._params
        turned = abs(wrap_angle(sense.odometry.theta - held.odometry.theta))
        return sense.odometry.distance(held.odometry) > params.crept or turned > params.crept_turn

    def _give_way(self, sense: Sense) -> None:
        """Back off from a person before the robot who may want to pass, now and then."""
        params = self._params
        if sense.now - self._gave_way >= params.give_way_after and self._face_to_face(sense):
            backward = Velocity(linear=-params.back_speed, angular=0.0)
            self._back = _Back(sense, params.give_way, backward)
            self._gave_way = sense.now

    def _face_to_face(self, sense: Sense) -> bool:
        others = np.vstack([sense.hazards.strangers, sense.hazards.walkers])
        before = others[others[:, 0] > 0.0]
        return (
            len(before) > 0
            and float(self._check.gaps(before).min()) <= self._params.give_way_within
        )

    def _way_out(self, sense: Sense) -> Velocity:
        """Return the slow motion, back if possible, away from near obstacles."""
        params = self._params
        backward = Velocity(linear=-params.back_speed, angular=0.0)
        best, most = backward, -math.inf
        for bend in params.escape_turn_rates:
            for speed in (-params.back_speed, params.back_speed):
                motion = Velocity(linear=speed, angular=bend)
                room = self._check.room_after(
                    motion, params.back_off / params.back_speed, sense.hazards
                )
                if (
                    room > most + params.escape_gain
                    and self._check.fastest(sense.velocity, motion, sense.hazards).velocity != ZERO
                ):
                    best, most = motion, room
        return best

    def _back_off(self, sense: Sense, back: _Back) -> NavigationStep:
        done = self._check.fastest(sense.velocity, back.velocity, sense.hazards)
        if (
            back.begun.odometry.distance(sense.odometry) >= back.way
            or sense.now - back.begun.now >= self._params.back_time
        ):
            self._back, self._path, self._sought = None, None, -math.inf
        return self._running(done.velocity, "backs off")

    def _wait(self, sense: Sense) -> NavigationStep:
        params = self._params
        self._no_way_since = sense.now if self._no_way_since is None else self._no_way_since
        if sense.now - self._no_way_since >= params.beside_after:
            self._aim_beside(sense.now)
            self._give_way(sense)
        patience = params.patience_with_people if self._face_to_face(sense) else params.patience
        if sense.now - self._no_way_since < patience:
            return self._running(ZERO, "waits, because no way is free")
        way = ((sense.pose.x, sense.pose.y), self._over[-1])
        return failed(
            what_blocks(self._obstacle_map, self._planner, self._plan, way=way, now=sense.now)
        )

    def _aim_beside(self, now: float) -> None:
        """Aim for the nearest free place when the goal is occupied."""
        beside = self._planner.place_near(
            *self._over[-1], self._obstacle_map.clearance(now), PLANNER.goal_reach - self._beside
        )
        if beside is not None and beside != self._over[-1]:
            self._beside += math.dist(beside, self._over[-1])
            self._over[-1] = beside

    def _given_up(self, sense: Sense, followed: Followed) -> NavigationStep | None:
        """Return the end of a journey that gets no farther."""
        params = self._params
        turning = followed.state == "driving" and followed.velocity.linear == 0.0
        if self._follower.remaining < self._best - params.farther:
            if self._best - self._follower.remaining < math.inf:
                self._driven += self._best - self._follower.remaining
            self._best, self._best_at = self._follower.remaining, sense.now
            if self._driven > 1.0:
                self._driven, self._back_offs = 0.0, 0
        assert self._begun is not None
        assert self._best_at is not None
        late = sense.now - self._begun > params.longest + params.longest_per_metre * self._longest
        in_the_way = followed.why == "walker" or self._face_to_face(sense)
        patience = params.patience_with_people if in_the_way else params.no_progress
        if late or (sense.now - self._best_at > patience and not turning):
            if in_the_way:
                return failed("somebody has stood in the way for too long")
            return failed(
                f"the robot gets no farther, {self._follower.remaining:.1f} m before the goal"
            )
        return None

    def _running(self, velocity: Velocity, reason: str) -> NavigationStep:
        if self._path is None:
            return NavigationStep(velocity, "RUNNING", reason)
        ahead = self._path.between(self._follower.way, math.inf)
        share = 1.0 - self._follower.remaining / max(self._longest, 1e-6)
        return NavigationStep(velocity, "RUNNING", reason, ahead, min(max(share, 0.0), 1.0))
