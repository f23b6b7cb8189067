"""How a bot drives a course: from the cue to a place, from the place to a route, from the route to
a speed. Pure.

It uses what its page shows: the floor plan, the pose, the laser's points, the cues. A door that the
laser sees closed, or at which the bot gets stuck, counts as closed, and another route is planned.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from experiments.bots.routes import NoRouteError, RouteGrid
from experiments.bots.view import AT_CENTRE, View
from robots.api.floorplan import Door, FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Point

AHEAD = 0.55  # metres along the route to the point that is aimed at
SHARP = 0.7  # radians aside from which one turns on the spot
GAIN = 1.6  # rad/s for a radian
CREEP = 0.08  # m/s into a station
BRAKE = 0.15  # m/s², with which one slows down towards the end of a route
SLOWEST_TURN = 0.12  # rad/s on the spot
FACING = 0.1  # radians aside of the station's axis with which one may drive in
CLEAR_OF_DOCK = 0.75  # metres before the docked pose from which one may turn
STAGING = 0.95  # metres before the docked pose from which one drives in
MISSED = 0.13  # metres aside of the axis, close to the station, with which the bot starts again
STUCK_SECONDS = 5.0
STUCK_METRES = 0.12
BACK_SECONDS = 2.0
BEFORE_A_DOOR = 1.8  # metres of driving from which the laser is asked about it
LEAF_BEAMS = 6
LEAF_NEAR = 0.1
SURE = 3  # sweeps one after another that must agree
SETTLE_SECONDS = 0.7
LOOKING = 0.3  # rad/s while looking for the mirror
REPLAN_SECONDS = 4.0
WAITING = frozenset({"", "wait_for_picture", "completed", "timed_out", "ended"})
HOMEWARD = frozenset({"return_home", "dock_now", "dock_hold", "dock_again"})


@dataclass(frozen=True)
class SpeedSetting:
    """A speed in m/s and rad/s."""

    linear: float = 0.0
    angular: float = 0.0

    @property
    def is_zero(self) -> bool:
        return self.linear == 0.0 and self.angular == 0.0


STAND = SpeedSetting()
BACKING = SpeedSetting(-0.22, 0.0)


@dataclass(frozen=True)
class Guide:
    """The task as shown on the page: the docked pose, checkpoints by number, and the number of the
    one with a photo.
    """

    dock: Pose2D
    stops: dict[int, Point]
    photo_at: int | None = None

    @classmethod
    def of(cls, study: dict[str, Any], plan: FloorPlan, series: str) -> "Guide":
        """Read the page's configuration; without a course (a practice drive), home is the robot's
        own station.
        """
        dock, own, home = study.get("dock"), plan.dock_of(series), AT_CENTRE
        if dock is not None:
            home = Pose2D(dock["x"], dock["y"], dock["theta"])
        elif own is not None:
            home = Pose2D(own.x, own.y, own.theta)
        stops = {stop["number"]: (stop["x"], stop["y"]) for stop in study.get("checkpoints", ())}
        photo = study.get("photo")
        return cls(home, stops, photo["checkpoint"] if photo else None)


@dataclass(frozen=True)
class Intent:
    """The bot's present action: a speed, and perhaps a photo (`take`), or an answer about it
    (`keep`, `again`, `skip`).
    """

    speed: SpeedSetting = STAND
    take: bool = False
    answer: str = ""


@dataclass
class Driver:
    """One bot on one course. `decide` is called ten times a second; `now` in seconds of a steady
    clock.
    """

    plan: FloorPlan
    guide: Guide
    fastest: SpeedSetting
    skips_photo: bool = False
    practises: bool = False
    docks_early: bool = False  # drives into the station again before anything else
    closed: set[str] = field(default_factory=set)  # doors, by name
    no_route: str = ""
    _grid: RouteGrid | None = None
    _route: list[Point] = field(default_factory=list)
    _goal: Point | None = None
    _planned_at: float = -math.inf
    _moved_from: tuple[float, float, float] | None = None  # x, y, since
    _backing_until: float = -math.inf
    _stuck: int = 0
    _sweep: float = -math.inf
    _shut: tuple[str, int] = ("", 0)  # a door, and how many sweeps have seen it closed
    _docking: bool = False
    _photo_due: float | None = None  # once the robot may take it; infinite after that

    def decide(self, view: View, now: float) -> Intent:
        cue, pose = view.task.cue, view.pose
        if self.practises and pose is not None:
            return Intent(BACKING if self._in_station(pose) else SpeedSetting(0.0, LOOKING))
        if pose is None or not view.localized or cue in WAITING:
            self._moved_from = None
            return Intent()
        if cue.startswith("photo_"):
            return self._photo(cue, view, pose, now)
        self.photo_failed()
        is_lost_at_home = cue == "lost" and view.task.number == 0
        if self._is_early(cue, view, pose) or cue in HOMEWARD or is_lost_at_home:
            # until the robot is docked, or the contacts part again
            if cue == "dock_hold" or view.contact:
                return Intent()
            return Intent(self._unstuck(pose, self._home(view, pose, now), now))
        self._docking = False
        if view.task.x is None or view.task.y is None:
            return Intent()
        return self._go(view, pose, (view.task.x, view.task.y), now)

    def _is_early(self, cue: str, view: View, pose: Pose2D) -> bool:
        """Tell whether the bot returns too early: from leaving the station until it docks."""
        if self.docks_early and cue == "docked_early":
            self.docks_early = False
        is_out = self._docking or not self._in_station(pose)
        return self.docks_early and not view.docked and is_out

    # --- to a place -------------------------------------------------------------------------------

    def _go(self, view: View, pose: Pose2D, goal: Point, now: float) -> Intent:
        speed = BACKING if self._in_station(pose) else self._drive_to(view, pose, goal, now)
        return Intent(self._unstuck(pose, speed, now))

    def _in_station(self, pose: Pose2D) -> bool:
        seen = self.guide.dock.inverse().compose(pose)
        return -CLEAR_OF_DOCK < seen.x < 0.3 and abs(seen.y) < 0.3 and abs(seen.theta) < 0.6

    def _drive_to(self, view: View, pose: Pose2D, goal: Point, now: float) -> SpeedSetting:
        self._look_at_doors(view)
        here = (pose.x, pose.y)
        if self._grid is None or self._grid.closed != self.closed:
            self._grid, self._goal = RouteGrid(self.plan, self.closed), None
        if goal != self._goal or now - self._planned_at > REPLAN_SECONDS:
            try:
                self._route, self.no_route = self._grid.route(here, goal), ""
            except NoRouteError as error:
                self._route, self.no_route = [], str(error)
                self.closed.clear()  # at least one of them must be open, or have been opened
            self._goal, self._planned_at = goal, now
        if not self._route:
            return STAND
        nearest = min(range(len(self._route)), key=lambda n: math.dist(self._route[n], here))
        self._route = self._route[nearest:]
        return _follow(pose, self._route, self.fastest)

    def _door_ahead(self, within: float) -> Door | None:
        return self._grid.door_on(self._route, within) if self._grid and self._route else None

    def _look_at_doors(self, view: View) -> None:
        """Take a door to be closed when the laser sees something where its leaf would be."""
        if not self._route or view.scan is None or view.scan.stamp == self._sweep:
            return
        self._sweep = view.scan.stamp
        door = self._door_ahead(BEFORE_A_DOOR)
        if door is None or sum(_on_leaf(door, point) for point in view.points()) < LEAF_BEAMS:
            self._shut = ("", 0)
            return
        self._shut = (door.name, self._shut[1] + 1 if self._shut[0] == door.name else 1)
        if self._shut[1] >= SURE:
            self.closed.add(door.name)

    def _unstuck(self, pose: Pose2D, speed: SpeedSetting, now: float) -> SpeedSetting:
        """Return the wanted speed, or one to back off for a while after the robot got stuck."""
        if now < self._backing_until:
            return SpeedSetting(-0.18, 0.25 if self._stuck % 2 else -0.25)
        here, before = (pose.x, pose.y), self._moved_from
        if speed.linear == 0.0:
            self._moved_from = None
        elif before is None or math.dist(before[:2], here) > STUCK_METRES:
            self._moved_from = (*here, now)
        elif now - before[2] > STUCK_SECONDS:
            self._stuck += 1
            door = self._door_ahead(1.0)
            if door is not None and self._stuck > 1:
                self.closed.add(door.name)
            self._moved_from, self._goal, self._backing_until = None, None, now + BACK_SECONDS
        return speed

    # --- home -------------------------------------------------------------------------------------

    def _home(self, view: View, pose: Pose2D, now: float) -> SpeedSetting:
        dock = self.guide.dock
        seen = dock.inverse().compose(pose)
        if not self._docking:
            staging = dock.apply(-STAGING, 0.0)
            if math.dist(staging, (pose.x, pose.y)) > 0.2:
                return self._drive_to(view, pose, staging, now)
            self._docking = abs(seen.theta) <= FACING
            turn = math.copysign(max(GAIN * abs(seen.theta), SLOWEST_TURN), -seen.theta)
            turning = SpeedSetting(0.0, _within(turn, self.fastest.angular))
            return STAND if self._docking else turning
        too_far_aside = seen.x > -0.5 and abs(seen.y) > MISSED
        if too_far_aside or seen.x > 0.1 or abs(seen.theta) > 0.7:
            self._docking, self._backing_until = False, now + 3.0 * BACK_SECONDS
            return STAND
        return _into_station(seen, self.fastest)

    # --- the photo --------------------------------------------------------------------------------

    def _photo(self, cue: str, view: View, pose: Pose2D, now: float) -> Intent:
        if self.skips_photo:
            return Intent(answer="skip")
        if cue == "photo_review":
            return Intent(answer="keep")
        if cue == "photo_ready":  # after standing for a moment, once
            if self._photo_due is None:
                self._photo_due = now + SETTLE_SECONDS
            is_due = now >= self._photo_due
            if is_due:
                self._photo_due = math.inf
            return Intent(take=is_due)
        self.photo_failed()
        at = None if self.guide.photo_at is None else self.guide.stops.get(self.guide.photo_at)
        if cue == "photo_turn_right":
            return Intent(SpeedSetting(0.0, -LOOKING))
        if cue == "photo_turn_left" or at is None or math.dist(at, (pose.x, pose.y)) < 0.15:
            return Intent(SpeedSetting(0.0, LOOKING))
        return self._go(view, pose, at, now)

    def photo_failed(self) -> None:
        """Take the photo again when it is next possible."""
        self._photo_due = None


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _follow(pose: Pose2D, route: Sequence[Point], fastest: SpeedSetting) -> SpeedSetting:
    """Steer along a route as people do: towards a point ahead, slower in bends, turning on the spot
    when the point is far aside.
    """
    here = (pose.x, pose.y)
    target = next((point for point in route if math.dist(point, here) >= AHEAD), route[-1])
    aside = wrap_angle(math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.theta)
    turn = _within(GAIN * aside, fastest.angular)
    if abs(aside) > SHARP:
        return SpeedSetting(0.0, turn)
    left = math.dist(route[-1], here)
    linear = min(fastest.linear * math.cos(aside) ** 2, math.sqrt(2.0 * BRAKE * left) + CREEP)
    return SpeedSetting(linear, turn)


def _into_station(dock_from_robot: Pose2D, fastest: SpeedSetting) -> SpeedSetting:
    """Steer into a station from before it: along its axis, ever slower, and gently back onto the
    axis.
    """
    to_go, aside = -dock_from_robot.x, dock_from_robot.y
    heading = math.atan2(-aside, max(0.35, min(0.8, to_go)))
    turn = _within(2.0 * wrap_angle(heading - dock_from_robot.theta), 0.5)
    linear = CREEP if to_go < 0.35 else min(0.25, fastest.linear, CREEP + 0.35 * (to_go - 0.35))
    return SpeedSetting(linear, turn)


def _on_leaf(door: Door, point: Point) -> bool:
    """Tell whether a point lies on the closed leaf, away from its posts."""
    dx, dy = door.end[0] - door.start[0], door.end[1] - door.start[1]
    length = math.hypot(dx, dy)
    along = ((point[0] - door.start[0]) * dx + (point[1] - door.start[1]) * dy) / length**2
    aside = abs((point[0] - door.start[0]) * dy - (point[1] - door.start[1]) * dx) / length
    return 0.25 < along < 0.75 and aside < LEAF_NEAR
