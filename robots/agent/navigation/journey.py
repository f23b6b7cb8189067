"""Driving to places: plan, follow, replan when blocked, wait without a route, and report why at
last.

While no route is known, or a person walks before it, the robot stops and looks. It backs off a
little from obstacles that are too close, where that is free.
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
from robots.api.reasons import ReasonCode
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
    give_room_after: float = 5.0  # s face to face with a person
    give_room: float = 0.4  # m to back off from them
    give_room_within: float = 0.6  # m: they are close
    no_progress: float = 40.0  # s without getting `farther`
    farther: float = 0.1  # m that count as progress
    longest: float = 120.0  # s after which even a journey that seems to get on is given up
    longest_per_metre: float = 25.0  # s more for each metre of the route


JOURNEY = JourneyParams()


@dataclass(frozen=True, eq=False)
class _Route:
    """A path, the points that it leads over, and how far along it each of them is, metres."""

    path: PlannedPath
    over: list[tuple[float, float]]
    distances: list[float]


@dataclass(frozen=True, eq=False)
class _Back:
    """Getting away from something: where and when it began, by how many metres, and how."""

    begun: Sense
    distance: float
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
        self._obstacle_map, self._planner, self._plan = obstacle_map, planner, plan
        self._check, self._params = check, params
        self._follower = Follower(check, limits)
        self._over = list(over)
        self._heading = heading
        self._distances: list[float] = []  # along the path to each point that is left
        self._path: PlannedPath | None = None
        self._looked = self._sought = self._shorter = self._gave_room_at = -math.inf  # when last
        self._planned_in: Floats | None = None
        self._no_route_since: float | None = None
        self._held: Sense | None = None  # since when and where
        self._back: _Back | None = None
        self._back_offs = self._closer_looks = 0
        self._beside = self._progress = self._longest = self._best = 0.0  # metres
        self._best_at: float | None = None
        self._begun: float | None = None

    def step(self, sense: Sense) -> NavigationStep:
        self._begun = sense.now if self._begun is None else self._begun
        if self._back is not None:
            return self._back_off(sense, self._back)
        self._choose_route(sense)
        if self._path is None:
            return self._wait(sense)
        self._no_route_since = None
        followed = self._follower.step(sense.pose, sense.velocity, sense.hazards)
        passed = self._follower.along + self._params.off_path / 2.0
        while len(self._distances) > 1 and passed >= self._distances[0]:
            del self._distances[0], self._over[0]
        if followed.state == "arrived":
            beside = ReasonCode.GOAL_TAKEN.of(f"{self._beside:.1f} m")
            return finished(beside if self._beside > 0.0 else "")
        return self._given_up(sense, followed) or self._continue(sense, followed)

    # --- the way ----------------------------------------------------------------------------------

    def _choose_route(self, sense: Sense) -> None:
        """Plan when there is no way, or it is blocked or left; sometimes look for a shorter."""
        params, now = self._params, sense.now
        if self._path is None:
            if now - self._sought >= params.retry_every:
                self._sought = now
                self._take(self._route(sense))
            return
        if now - self._looked < params.look_every:
            return
        self._looked = now
        if self._follower.off_path(sense.pose) > params.off_path or self._blocked(sense):
            self._sought = now
            self._take(self._route(sense))
        elif now - self._shorter >= params.shorter_every:
            self._shorter = now
            clearance = self._obstacle_map.clearance(now)
            if clearance is self._planned_in:
                return  # nothing has changed since the last plan
            found = self._route(sense)
            if found and found.path.length < self._follower.remaining - params.shorter_by:
                self._take(found)

    def _route(self, sense: Sense) -> _Route | None:
        """Return a way over the points left; without one, a way to a closer look."""
        self._planned_in = self._obstacle_map.clearance(sense.now)
        found = self._through(sense, self._planned_in)
        if found is None and self._closer_looks < self._params.closer_looks:
            found = self._through(sense, self._obstacle_map.clearance_nearby(sense.pose, sense.now))
            self._closer_looks += 1 if found else 0
        return found

    def _through(self, sense: Sense, clearance: Floats) -> _Route | None:
        """Return a way through `clearance`, without intermediate points that are occupied."""
        here = (sense.pose.x, sense.pose.y)
        legs = [np.array([here])]
        over = list[tuple[float, float]]()
        distances = list[float]()
        length = 0.0
        for number, point in enumerate(self._over, start=1):
            leg = self._leg(here, point, clearance)
            if leg is None and number == len(self._over):
                return None
            if leg is not None:
                here, length = point, length + leg.length
                legs.append(leg.points)
                over.append(point)
                distances.append(length)
        points = np.vstack(legs)
        distinct = np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-6])
        return _Route(PlannedPath(points[distinct]), over, distances)

    def _leg(
        self, start: tuple[float, float], end: tuple[float, float], clearance: Floats
    ) -> PlannedPath | None:
        if len(self._over) > 1 and self._planner.straight(start, end, clearance):
            return self._planner.line(start, end)
        return self._planner.plan(start, end, clearance)

    def _take(self, route: _Route | None) -> None:
        self._path = route.path if route else None
        if route is None:
            return
        self._over, self._distances = route.over, route.distances
        self._longest = max(self._longest, route.path.length)
        self._best = math.inf
        self._follower.take(route.path, self._heading)

    def _blocked(self, sense: Sense) -> bool:
        ahead = self._follower.path.between(
            self._follower.along + 0.1, self._follower.along + self._params.look_ahead
        )
        costmap = self._obstacle_map.costmap
        # a start in a tight spot is no block
        least = np.minimum(costmap.least, costmap.sample(costmap.clearance, ahead))
        if self._closer_looks > 0:
            nearby = self._obstacle_map.clearance_nearby(sense.pose, sense.now)
            room = costmap.sample(nearby, ahead)
        else:
            room = self._obstacle_map.room_at(ahead, sense.now)
        return bool((room < least - costmap.transform.resolution).any())

    # --- getting on -------------------------------------------------------------------------------

    def _continue(self, sense: Sense, followed: Followed) -> NavigationStep:
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
            near = np.vstack([sense.hazards.things, sense.hazards.strangers])
            self._obstacle_map.note(sense.pose, near, sense.now)
            self._back, self._held = _Back(sense, params.back_off, self._escape(sense)), None
            self._back_offs += 1
        elif followed.why == "walker" and waited >= params.give_room_after:
            self._give_room(sense)
        if not held:
            return self._running(followed.velocity, "")
        is_person = followed.why == "walker"
        return self._running(ZERO, ReasonCode.PERSON if is_person else ReasonCode.VERY_CLOSE)

    def _moved_on(self, sense: Sense, held: Sense) -> bool:
        """Tell whether the robot got away from where it was held; creeping does not count."""
        params = self._params
        turned = abs(wrap_angle(sense.odometry.theta - held.odometry.theta))
        return sense.odometry.distance(held.odometry) > params.crept or turned > params.crept_turn

    def _give_room(self, sense: Sense) -> None:
        """Back off from a person before the robot who may want to pass, now and then."""
        params = self._params
        if sense.now - self._gave_room_at >= params.give_room_after and self._face_to_face(sense):
            backward = Velocity(linear=-params.back_speed, angular=0.0)
            self._back = _Back(sense, params.give_room, backward)
            self._gave_room_at = sense.now

    def _face_to_face(self, sense: Sense) -> bool:
        others = np.vstack([sense.hazards.strangers, sense.hazards.walkers])
        gaps = self._check.gaps(others[others[:, 0] > 0.0])
        return bool((gaps <= self._params.give_room_within).any())

    def _escape(self, sense: Sense) -> Velocity:
        """Return the slow motion, back if possible, away from near obstacles."""
        params = self._params
        backward = Velocity(linear=-params.back_speed, angular=0.0)
        seconds = params.back_off / params.back_speed
        best, most = backward, -math.inf
        for bend in params.escape_turn_rates:
            for speed in (-params.back_speed, params.back_speed):
                motion = Velocity(linear=speed, angular=bend)
                room = self._check.room_after(motion, seconds, sense.hazards)
                safe = self._check.fastest(sense.velocity, motion, sense.hazards).velocity
                if room > most + params.escape_gain and safe != ZERO:
                    best, most = motion, room
        return best

    def _back_off(self, sense: Sense, back: _Back) -> NavigationStep:
        done = self._check.fastest(sense.velocity, back.velocity, sense.hazards)
        backed = back.begun.odometry.distance(sense.odometry)
        if backed >= back.distance or sense.now - back.begun.now >= self._params.back_time:
            self._back, self._path, self._sought = None, None, -math.inf
        return self._running(done.velocity, ReasonCode.BACKS_OFF)

    def _wait(self, sense: Sense) -> NavigationStep:
        params = self._params
        self._no_route_since = sense.now if self._no_route_since is None else self._no_route_since
        if sense.now - self._no_route_since >= params.beside_after:
            self._aim_beside(sense.now)
            self._give_room(sense)
        patience = params.patience_with_people if self._face_to_face(sense) else params.patience
        if sense.now - self._no_route_since < patience:
            return self._running(ZERO, ReasonCode.WAITS_FOR_ROUTE)
        ends = ((sense.pose.x, sense.pose.y), self._over[-1])
        return failed(what_blocks(self._obstacle_map, self._planner, self._plan, ends, sense.now))

    def _aim_beside(self, now: float) -> None:
        """Aim for the nearest free place when the goal is occupied."""
        reach = PLANNER.goal_reach - self._beside
        beside = self._planner.place_near(*self._over[-1], self._obstacle_map.clearance(now), reach)
        if beside is not None and beside != self._over[-1]:
            self._beside += math.dist(beside, self._over[-1])
            self._over[-1] = beside

    def _given_up(self, sense: Sense, followed: Followed) -> NavigationStep | None:
        """Return the end of a journey that gets no farther."""
        params = self._params
        turning = followed.state == "driving" and followed.velocity.linear == 0.0
        if self._follower.remaining < self._best - params.farther:
            if self._best - self._follower.remaining < math.inf:
                self._progress += self._best - self._follower.remaining
            self._best, self._best_at = self._follower.remaining, sense.now
            if self._progress > 1.0:
                self._progress, self._back_offs = 0.0, 0
        assert self._begun is not None
        assert self._best_at is not None
        late = sense.now - self._begun > params.longest + params.longest_per_metre * self._longest
        is_person_ahead = followed.why == "walker" or self._face_to_face(sense)
        patience = params.patience_with_people if is_person_ahead else params.no_progress
        if late or (sense.now - self._best_at > patience and not turning):
            if is_person_ahead:
                return failed(ReasonCode.PERSON_STAYED)
            return failed(ReasonCode.NO_FARTHER.of(f"{self._follower.remaining:.1f} m"))
        return None

    def _running(self, velocity: Velocity, reason: str) -> NavigationStep:
        if self._path is None:
            return NavigationStep(velocity, "RUNNING", reason)
        ahead = self._path.between(self._follower.along, math.inf)
        share = 1.0 - self._follower.remaining / max(self._longest, 1e-6)
        return NavigationStep(velocity, "RUNNING", reason, ahead, min(max(share, 0.0), 1.0))
