"""Getting to places: plan, follow, plan again when something stands in the way, wait when there is
no way, and say why at last.

Waiting is for people and for doors: while no way is known, or somebody walks before the robot, it
stands and looks. What stands too close to move is got away from by backing off a little, where that
is free.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.assistance.braking import BrakeCheck
from robots.agent.navigation.obstacles.blocked_reason import what_blocks
from robots.agent.navigation.obstacles.local_map import LocalObstacleMap
from robots.agent.navigation.planning.follower import Followed, Follower
from robots.agent.navigation.planning.path import Path
from robots.agent.navigation.planning.planner import GOAL_REACH, Planner
from robots.agent.navigation.planning.steps import Sense, Step, failed, finished
from robots.agent.ramp import ZERO
from robots.api.floorplan import FloorPlan
from robots.api.geometry import wrap_angle
from robots.api.messages import Limits, Velocity
from robots.world.sensing import Floats

LOOK_EVERY = 0.5  # is the way still free?: seconds
SHORTER_EVERY, SHORTER = 5.0, 0.5  # is there a shorter way?: seconds, metres that it must save
LOOK_AHEAD = 5.0  # metres of the way that must be free
OFF_PATH = 0.4  # metres
# seconds without a way until the task fails; with somebody close before the robot
PATIENCE, PATIENCE_WITH_PEOPLE = 30.0, 90.0
NEAR_ENOUGH = 5.0  # seconds after which a place beside a goal that something stands on will do
CLOSER_LOOKS = 6  # at what was seen in the way from afar
RETRY = 1.0  # seconds between two looks for a way
HELD = 2.0  # seconds before a thing until the robot backs off
CREPT, CREPT_TURN = 0.05, 0.15  # metres, radians: no way off from where something holds the robot
BACK_OFF, BACK_SPEED, BACK_TIME = 0.15, 0.1, 6.0  # metres, m/s, seconds at most
ESCAPE_TURN_RATES, AWAY = (
    (0.0, 0.3, -0.3),
    0.01,
)  # rad/s, and metres by which another way out must be better
# seconds face to face with somebody, metres to back off, metres that are close
GIVE_WAY_AFTER, GIVE_WAY, GIVE_WAY_TO = 5.0, 0.4, 0.6
BACK_OFFS = 4  # without getting a metre farther
NO_PROGRESS, FARTHER = 40.0, 0.1  # seconds without getting so many metres farther
# seconds after which even a task that seems to get on is given up
TAKES, TAKES_A_METRE = 120.0, 25.0


@dataclass(frozen=True, eq=False)
class _Way:
    """A path, the points that it leads over, and how far along it each of them is, metres."""

    path: Path
    over: list[tuple[float, float]]
    ways: list[float]


@dataclass(frozen=True, eq=False)
class _Back:
    """Getting away from something: where and when it began, by how many metres, and how."""

    begun: Sense
    way: float
    velocity: Velocity


class Journey:
    """The way over some points (n, 2), in order, to the last of them; all must be places where the
    map lets the robot stand.
    """

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
    ) -> None:
        self._obstacle_map, self._planner, self._limits, self._plan = (
            obstacle_map,
            planner,
            limits,
            plan,
        )
        self._check, self._follower = check, Follower(check, limits)
        self._over, self._heading = list(over), heading
        self._ways: list[float] = []  # along the path to each point that is left
        self._path: Path | None = None
        self._looked = self._sought = self._shorter = -math.inf
        self._planned_in: Floats | None = None
        self._no_way_since: float | None = None
        self._held: Sense | None = None  # since when and where
        self._back: _Back | None = None
        self._gave_way = -math.inf
        self._back_offs = 0
        self._closer_looks = 0
        self._beside = 0.0
        self._driven = self._longest = self._best = 0.0
        self._best_at: float | None = None
        self._begun: float | None = None

    def step(self, sense: Sense) -> Step:
        """Return what to do now."""
        self._begun = sense.now if self._begun is None else self._begun
        if self._back is not None:
            return self._back_off(sense, self._back)
        self._choose_way(sense)
        if self._path is None:
            return self._wait(sense)
        self._no_way_since = None
        followed = self._follower.step(sense.pose, sense.velocity, sense.hazards)
        while len(self._ways) > 1 and self._follower.way >= self._ways[0] - OFF_PATH / 2.0:
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
        """Plan when there is no way yet, when it is blocked or left, and look now and then for a
        shorter one.
        """
        now = sense.now
        if self._path is None:
            if now - self._sought >= RETRY:
                self._sought = now
                self._take(self._way(sense))
            return
        if now - self._looked < LOOK_EVERY:
            return
        self._looked = now
        if self._follower.off_path(sense.pose) > OFF_PATH or self._blocked(sense):
            self._sought = now
            self._take(self._way(sense))
        elif now - self._shorter >= SHORTER_EVERY:
            self._shorter = now
            clearance = self._obstacle_map.clearance(now)
            # nothing has changed since: what was the best way still is
            if clearance is self._planned_in:
                return
            found = self._way(sense)
            if found and found.path.length < self._follower.remaining - SHORTER:
                self._take(found)

    def _way(self, sense: Sense) -> _Way | None:
        """Return a way over the points that are left; where none is known, one to a closer look at
        what is in the way.
        """
        self._planned_in = self._obstacle_map.clearance(sense.now)
        found = self._through(sense, self._planned_in)
        if found is None and self._closer_looks < CLOSER_LOOKS:
            found = self._through(sense, self._obstacle_map.clearance_nearby(sense.pose, sense.now))
            self._closer_looks += 1 if found else 0
        return found

    def _through(self, sense: Sense, clearance: Floats) -> _Way | None:
        """Return a way through `clearance`, without those points in between that something stands
        on.
        """
        here = (sense.pose.x, sense.pose.y)
        legs, over, ways, driven = (
            [np.array([here])],
            list[tuple[float, float]](),
            list[float](),
            0.0,
        )
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
        return _Way(Path(points[distinct]), over, ways)

    def _leg(
        self, start: tuple[float, float], end: tuple[float, float], clearance: Floats
    ) -> Path | None:
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
            self._follower.way + 0.1, self._follower.way + LOOK_AHEAD
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

    def _on_the_way(self, sense: Sense, followed: Followed) -> Step:
        held = followed.state == "held"
        if self._held is None or self._moved_on(sense, self._held):
            self._held = sense if held else None
        if self._held is None:
            return self._running(followed.velocity, "")
        waited = sense.now - self._held.now
        if followed.why == "thing" and waited >= HELD and self._back_offs < BACK_OFFS:
            self._obstacle_map.note(
                sense.pose, np.vstack([sense.hazards.things, sense.hazards.strangers]), sense.now
            )
            self._back, self._held = _Back(sense, BACK_OFF, self._way_out(sense)), None
            self._back_offs += 1
        elif followed.why == "walker" and waited >= GIVE_WAY_AFTER:
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

    @staticmethod
    def _moved_on(sense: Sense, held: Sense) -> bool:
        """Tell whether the robot has come away from where it was held: it may creep in between, a
        finger's breadth at a time.
        """
        turned = abs(wrap_angle(sense.odometry.theta - held.odometry.theta))
        return sense.odometry.distance(held.odometry) > CREPT or turned > CREPT_TURN

    def _give_way(self, sense: Sense) -> None:
        """Back off from somebody who stands before the robot and may want to pass, now and then."""
        if sense.now - self._gave_way >= GIVE_WAY_AFTER and self._face_to_face(sense):
            self._back, self._gave_way = (
                _Back(sense, GIVE_WAY, Velocity(linear=-BACK_SPEED, angular=0.0)),
                sense.now,
            )

    def _face_to_face(self, sense: Sense) -> bool:
        others = np.vstack([sense.hazards.strangers, sense.hazards.walkers])
        before = others[others[:, 0] > 0.0]
        return len(before) > 0 and float(self._check.gaps(before).min()) <= GIVE_WAY_TO

    def _way_out(self, sense: Sense) -> Velocity:
        """Return the slow motion, back if possible, that leads away from what is near."""
        backward = Velocity(linear=-BACK_SPEED, angular=0.0)
        best, most = backward, -math.inf
        for bend in ESCAPE_TURN_RATES:
            for speed in (-BACK_SPEED, BACK_SPEED):
                motion = Velocity(linear=speed, angular=bend)
                room = self._check.room_after(motion, BACK_OFF / BACK_SPEED, sense.hazards)
                if (
                    room > most + AWAY
                    and self._check.fastest(sense.velocity, motion, sense.hazards).velocity != ZERO
                ):
                    best, most = motion, room
        return best

    def _back_off(self, sense: Sense, back: _Back) -> Step:
        done = self._check.fastest(sense.velocity, back.velocity, sense.hazards)
        if (
            back.begun.odometry.distance(sense.odometry) >= back.way
            or sense.now - back.begun.now >= BACK_TIME
        ):
            self._back, self._path, self._sought = None, None, -math.inf
        return self._running(done.velocity, "backs off")

    def _wait(self, sense: Sense) -> Step:
        self._no_way_since = sense.now if self._no_way_since is None else self._no_way_since
        if sense.now - self._no_way_since >= NEAR_ENOUGH:
            self._aim_beside(sense.now)
            self._give_way(sense)
        patience = PATIENCE_WITH_PEOPLE if self._face_to_face(sense) else PATIENCE
        if sense.now - self._no_way_since < patience:
            return self._running(ZERO, "waits, because no way is free")
        way = ((sense.pose.x, sense.pose.y), self._over[-1])
        return failed(
            what_blocks(self._obstacle_map, self._planner, self._plan, way=way, now=sense.now)
        )

    def _aim_beside(self, now: float) -> None:
        """Aim for the nearest free place when something stands on the goal."""
        beside = self._planner.place_near(
            *self._over[-1], self._obstacle_map.clearance(now), GOAL_REACH - self._beside
        )
        if beside is not None and beside != self._over[-1]:
            self._beside += math.dist(beside, self._over[-1])
            self._over[-1] = beside

    def _given_up(self, sense: Sense, followed: Followed) -> Step | None:
        """Return the end of a journey that gets no farther."""
        turning = followed.state == "driving" and followed.velocity.linear == 0.0
        if self._follower.remaining < self._best - FARTHER:
            if self._best - self._follower.remaining < math.inf:
                self._driven += self._best - self._follower.remaining
            self._best, self._best_at = self._follower.remaining, sense.now
            if self._driven > 1.0:
                self._driven, self._back_offs = 0.0, 0
        assert self._begun is not None
        assert self._best_at is not None
        late = sense.now - self._begun > TAKES + TAKES_A_METRE * self._longest
        in_the_way = followed.why == "walker" or self._face_to_face(sense)
        patience = PATIENCE_WITH_PEOPLE if in_the_way else NO_PROGRESS
        if late or (sense.now - self._best_at > patience and not turning):
            if in_the_way:
                return failed("somebody has stood in the way for too long")
            return failed(
                f"the robot gets no farther, {self._follower.remaining:.1f} m before the goal"
            )
        return None

    def _running(self, velocity: Velocity, reason: str) -> Step:
        if self._path is None:
            return Step(velocity, "RUNNING", reason)
        ahead = self._path.between(self._follower.way, math.inf)
        share = 1.0 - self._follower.remaining / max(self._longest, 1e-6)
        return Step(velocity, "RUNNING", reason, ahead, min(max(share, 0.0), 1.0))
