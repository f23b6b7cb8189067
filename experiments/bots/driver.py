"""How a bot drives a course: from the cue to a place, from the place to a way, from the way to a
speed. Decides, sends nothing.

It goes by what its page shows: the floor plan, the pose, the laser's points, the cues. A door that
the laser sees closed, or at which it gets stuck, is taken to be closed, and another way is looked
for.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from experiments.bots.steering import STAND, SpeedSetting, follow, into, rest_of, turn_to
from experiments.bots.view import View
from experiments.bots.ways import NoRouteError, RouteGrid
from robots.api.floorplan import Door, FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Point

BACKING = SpeedSetting(-0.22, 0.0)
CLEAR_OF_DOCK = 0.75  # metres before the docked pose from which one may turn
STAGING = 0.95  # metres before the docked pose from which one drives in
MISSED = 0.13  # metres aside of the axis, close to the station, with which one begins anew
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


@dataclass(frozen=True)
class Guide:
    """What the page is told of the task: the docked pose, checkpoints by number, and after which of
    them the photo is.
    """

    dock: Pose2D
    stops: dict[int, Point]
    photo_at: int | None = None

    @classmethod
    def of(cls, study: dict[str, Any], plan: FloorPlan, series: str) -> "Guide":
        """Read the page's configuration; without a course (a practice drive) the robot's own
        station is home.
        """
        dock, own = study.get("dock"), plan.dock_of(series)
        if dock is None and own is not None:
            dock = {"x": own.x, "y": own.y, "theta": own.theta}
        home = (
            Pose2D(dock["x"], dock["y"], dock["theta"])
            if dock is not None
            else Pose2D(0.0, 0.0, 0.0)
        )
        stops = {stop["number"]: (stop["x"], stop["y"]) for stop in study.get("checkpoints", ())}
        photo = study.get("photo")
        return cls(home, stops, photo["checkpoint"] if photo else None)


@dataclass(frozen=True)
class Intent:
    """What the bot does now: a speed, and perhaps a photo (`take`), or an answer about it (`keep`,
    `again`, `skip`).
    """

    speed: SpeedSetting = STAND
    take: bool = False
    answer: str = ""


@dataclass
class Driver:
    """One bot on one course. `decide` is called ten times a second; `now` in seconds of any clock
    that goes steadily.
    """

    plan: FloorPlan
    guide: Guide
    fastest: SpeedSetting
    skips_photo: bool = False
    practises: bool = False
    docks_early: bool = False  # drives into the station again before anything else
    closed: set[str] = field(default_factory=set)
    _ways: RouteGrid | None = None
    _way: list[Point] = field(default_factory=list)
    _goal: Point | None = None
    _planned_at: float = -math.inf
    _moved_from: tuple[float, float, float] | None = None  # x, y, since
    _backing_until: float = -math.inf
    _stuck: int = 0
    _sweep: float = -math.inf
    _shut: tuple[str, int] = ("", 0)  # a door, and how many sweeps have seen it closed
    _docking: bool = False
    _steady_since: float | None = None
    _asked_photo: bool = False
    no_way: str = ""

    def decide(self, view: View, now: float) -> Intent:
        """Return what to do."""
        cue, pose = view.task.cue, view.pose
        if self.practises and pose is not None:
            return Intent(BACKING if self._in_station(pose) else SpeedSetting(0.0, LOOKING))
        if (
            pose is None
            or not view.localized
            or cue in {"", "wait_for_picture", "completed", "timed_out", "ended"}
        ):
            self._moved_from = None
            return Intent()
        if cue.startswith("photo_"):
            return self._photo(cue, view, pose, now)
        self._asked_photo, self._steady_since = False, None
        is_early = self._is_early(cue, view, pose)
        if (
            cue in {"return_home", "dock_now", "dock_hold", "dock_again"}
            or (cue == "lost" and view.task.number == 0)
            or is_early
        ):
            # until the robot is docked, or the contacts part again
            lets_go = cue == "dock_hold" or view.contact
            return (
                Intent()
                if lets_go
                else Intent(self._unstuck(pose, self._home(view, pose, now), now))
            )
        self._docking = False
        if view.task.x is None or view.task.y is None:
            return Intent()
        return Intent(
            self._unstuck(pose, self._go(view, pose, (view.task.x, view.task.y), now), now)
        )

    def _is_early(self, cue: str, view: View, pose: Pose2D) -> bool:
        """Tell whether it is on its way back too soon: from the moment at which it is out of the
        station until it is in again.
        """
        if self.docks_early and cue == "docked_early":
            self.docks_early = False
        return (
            self.docks_early and not view.docked and (self._docking or not self._in_station(pose))
        )

    # --- to a place -------------------------------------------------------------------------------

    def _go(self, view: View, pose: Pose2D, goal: Point, now: float) -> SpeedSetting:
        if self._in_station(pose):
            return BACKING
        self._look_at_doors(view)
        way = self._way_to(pose, goal, now)
        return follow(pose, way, self.fastest) if way else STAND

    def _in_station(self, pose: Pose2D) -> bool:
        seen = self.guide.dock.inverse().compose(pose)
        return -CLEAR_OF_DOCK < seen.x < 0.3 and abs(seen.y) < 0.3 and abs(seen.theta) < 0.6

    def _way_to(self, pose: Pose2D, goal: Point, now: float) -> Sequence[Point]:
        if self._ways is None or self._ways.closed != self.closed:
            self._ways, self._goal = RouteGrid(self.plan, self.closed), None
        if goal != self._goal or now - self._planned_at > REPLAN_SECONDS:
            try:
                self._way, self.no_way = self._ways.way((pose.x, pose.y), goal), ""
            except NoRouteError as error:
                self._way, self.no_way = [], str(error)
                self.closed.clear()  # at least one of them must be open, or have been opened
            self._goal, self._planned_at = goal, now
        self._way = rest_of(self._way, pose.x, pose.y) if self._way else []
        return self._way

    def _look_at_doors(self, view: View) -> None:
        """Take a door for closed when the laser sees something where its leaf would be."""
        if (
            self._ways is None
            or not self._way
            or view.scan is None
            or view.scan.stamp == self._sweep
        ):
            return
        self._sweep = view.scan.stamp
        name = self._ways.door_on(self._way, BEFORE_A_DOOR)
        door = next((door for door in self.plan.doors if door.name == name), None)
        if door is None or sum(1 for point in view.points() if _on_leaf(door, point)) < LEAF_BEAMS:
            self._shut = ("", 0)
            return
        self._shut = (door.name, self._shut[1] + 1 if self._shut[0] == door.name else 1)
        if self._shut[1] >= SURE:
            self.closed.add(door.name)

    # --- stuck ------------------------------------------------------------------------------------

    def _unstuck(self, pose: Pose2D, speed: SpeedSetting, now: float) -> SpeedSetting:
        if now < self._backing_until:
            return SpeedSetting(-0.18, 0.25 if self._stuck % 2 else -0.25)
        if speed.linear == 0.0:
            self._moved_from = None
            return speed
        if (
            self._moved_from is None
            or math.dist(self._moved_from[:2], (pose.x, pose.y)) > STUCK_METRES
        ):
            self._moved_from = (pose.x, pose.y, now)
        elif now - self._moved_from[2] > STUCK_SECONDS:
            self._stuck += 1
            door = (
                self._ways.door_on(self._way, 1.0) if self._ways is not None and self._way else None
            )
            if door is not None and self._stuck > 1:
                self.closed.add(door)
            self._moved_from, self._goal, self._backing_until = None, None, now + BACK_SECONDS
        return speed

    # --- home -------------------------------------------------------------------------------------

    def _home(self, view: View, pose: Pose2D, now: float) -> SpeedSetting:
        dock = self.guide.dock
        seen = dock.inverse().compose(pose)
        staging = dock.apply(-STAGING, 0.0)
        if not self._docking:
            if math.dist(staging, (pose.x, pose.y)) > 0.2:
                self._look_at_doors(view)
                way = self._way_to(pose, staging, now)
                return follow(pose, way, self.fastest) if way else STAND
            turned = turn_to(pose, dock.theta, self.fastest, within=0.1)
            self._docking = turned.is_zero
            return turned
        too_far_aside = seen.x > -0.5 and abs(seen.y) > MISSED
        if too_far_aside or seen.x > 0.1 or abs(wrap_angle(seen.theta)) > 0.7:
            self._docking, self._backing_until = False, now + 3.0 * BACK_SECONDS
            return STAND
        return into(pose, dock, self.fastest)

    # --- the photo --------------------------------------------------------------------------------

    def _photo(self, cue: str, view: View, pose: Pose2D, now: float) -> Intent:
        if self.skips_photo:
            return Intent(answer="skip")
        if cue == "photo_review":
            return Intent(answer="keep")
        if cue == "photo_ready":
            return self._steady_photo(now)
        self._steady_since = None
        if cue in {"photo_turn_left", "photo_turn_right"}:
            return Intent(SpeedSetting(0.0, LOOKING if cue == "photo_turn_left" else -LOOKING))
        at = self.guide.stops.get(self.guide.photo_at if self.guide.photo_at is not None else -1)
        if at is None or math.dist(at, (pose.x, pose.y)) < 0.15:
            return Intent(SpeedSetting(0.0, LOOKING))
        return Intent(self._unstuck(pose, self._go(view, pose, at, now), now))

    def _steady_photo(self, now: float) -> Intent:
        """Stand for a moment, and take it once."""
        if self._steady_since is None:
            self._steady_since, self._asked_photo = now, False
        if now - self._steady_since < SETTLE_SECONDS or self._asked_photo:
            return Intent()
        self._asked_photo = True
        return Intent(take=True)

    def photo_failed(self) -> None:
        """Try again."""
        self._asked_photo, self._steady_since = False, None


def _on_leaf(door: Door, point: Point) -> bool:
    """Tell whether a point lies on the closed leaf, away from its posts."""
    dx, dy = door.end[0] - door.start[0], door.end[1] - door.start[1]
    length = math.hypot(dx, dy)
    along = ((point[0] - door.start[0]) * dx + (point[1] - door.start[1]) * dy) / length**2
    aside = abs((point[0] - door.start[0]) * dy - (point[1] - door.start[1]) * dx) / length
    return 0.25 < along < 0.75 and aside < LEAF_NEAR
