"""Going to places, along lines, into the charging station and out of it: one task at a time,
stepped 10 to 20 times a second. Pure.

Before each step the navigator makes sure that the robot sees, knows where it is and can move. A
task that cannot continue ends with a reason, and with the robot at rest.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.docking.approach import Docking, Undocking
from robots.agent.navigation.journey import Journey
from robots.agent.navigation.obstacles.dynamic import LostObstacles
from robots.agent.navigation.obstacles.local_map import LocalObstacleMap, moved
from robots.agent.navigation.obstacles.recent import RecentSweeps
from robots.agent.navigation.planning.costmap import CostMap, NoWayError
from robots.agent.navigation.planning.path import resampled
from robots.agent.navigation.planning.planner import Planner
from robots.agent.navigation.planning.steps import NavigationStep, Sense, failed
from robots.agent.navigation.pose_buffer import PoseBuffer
from robots.agent.navigation.preview import NO_ROUTE, preview
from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import BrakeCheck, Hazards
from robots.agent.safety.collision.memory import sees
from robots.api.floorplan import FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Limits, Velocity
from robots.api.reasons import ReasonCode
from robots.world.grid import OccupancyGrid
from robots.world.sensing import Estimate, Floats, LaserScan


@dataclass(frozen=True)
class NavigatorParams:
    """How long a robot goes on that does not see, or does not know where it is."""

    blind_stop: float = 0.5  # s since the newest sweep, after which the robot stops
    blind_end: float = 2.5  # s, after which it gives up
    lost_end: float = 4.0  # s without a pose, after which it gives up
    drawn_spacing: float = 0.4  # m between points that are taken of a drawn line


NAVIGATOR = NavigatorParams()
IN_VAIN = 5.0  # seconds
MOVED, TURNED = 0.01, 0.02  # metres, radians
ASKED = 0.03  # m/s or rad/s that must move a base


class WheelWatch:
    """Detects a base that was asked to move for `IN_VAIN` s without a change of odometry."""

    def __init__(self) -> None:
        self._from: Pose2D | None = None
        self._since = 0.0

    def stuck(self, asked: Velocity, odometry: Pose2D, now: float) -> bool:
        """Take what the base was asked for since the last call, and its odometry."""
        is_asked = asked != ZERO and max(abs(asked.linear), abs(asked.angular)) >= ASKED
        if not is_asked or self._from is None or _moved(self._from, odometry):
            self._from, self._since = odometry, now
            return False
        return now - self._since > IN_VAIN


def _moved(before: Pose2D, after: Pose2D) -> bool:
    return before.distance(after) > MOVED or abs(wrap_angle(after.theta - before.theta)) > TURNED


class Navigator:
    """The tasks of one robot on one map.

    `plan` has doors, rooms, places and charging stations, None for a bare map; `footprint` is a
    convex polygon (n, 2) in the robot's frame, counter-clockwise, metres; `limits` may be replaced
    between tasks; `series` selects the robot's stations. Raises NoWayError when the map has no free
    space.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        plan: FloorPlan | None,
        footprint: Floats,
        limits: Limits,
        series: str,
    ) -> None:
        self.plan, self.limits, self.series = plan, limits, series
        self._costmap = CostMap(grid, np.asarray(footprint, dtype=np.float64))
        self._planner = Planner(self._costmap)
        self._obstacle_map = LocalObstacleMap(self._costmap, plan)
        self._check = BrakeCheck(self._costmap.footprint, limits)
        self._pose_buffer = PoseBuffer()
        self._wheels = WheelWatch()
        self._task: Journey | Docking | Undocking | None = None
        self._then: Journey | None = None
        self._beams: LaserScan | None = None
        self._walkers: Floats = np.zeros((0, 2))
        self._lost_obstacles = LostObstacles()
        self._recent = RecentSweeps(self._costmap.circumscribed)
        self._last = NavigationStep(None, "FINISHED")
        self._asked = ZERO
        self._lost_since: float | None = None
        self._began: float | None = None

    # --- tasks ------------------------------------------------------------------------------------

    def goto(self, x: float, y: float, theta: float | None = None) -> None:
        """Go to a point, with a final heading or any; raises NoWayError when it is not free."""
        if theta is not None and not math.isfinite(theta):
            raise NoWayError(ReasonCode.NO_GOAL)
        self._begin(self._journey([self._planner.goal(x, y)], theta))

    def preview(self, x: float, y: float) -> tuple[Floats, str]:
        """Return the route (n, 2) that `goto` would take now, and why it does not lead there; see
        `navigation.preview`.
        """
        if self._pose_buffer.now is None:
            return NO_ROUTE, ReasonCode.LOST
        pose = self._pose_buffer.pose()
        ends = (pose.x, pose.y), (x, y)
        return preview(self._obstacle_map, self._planner, self.plan, ends, self._pose_buffer.now)

    def follow(self, points: Sequence[tuple[float, float]]) -> None:
        """Drive along a drawn line to its end, around obstacles on it. Raises NoWayError for an
        invalid line, or an end where the robot does not fit.
        """
        line = np.array(points, dtype=np.float64).reshape(-1, 2)
        if len(line) < 2 or not np.isfinite(line).all():
            raise NoWayError(ReasonCode.NO_GOAL)
        end = self._planner.goal(float(line[-1, 0]), float(line[-1, 1]))
        drawn = resampled(line, NAVIGATOR.drawn_spacing)[:-1]
        fits = self._costmap.sample(self._costmap.clearance, drawn) >= self._costmap.least
        self._begin(self._journey([*((float(x), float(y)) for x, y in drawn[fits]), end], None))

    def dock(self) -> None:
        """Go into the robot's charging station; NoWayError without one, or without room."""
        dock = self.plan.dock_of(self.series) if self.plan else None
        if dock is None:
            raise NoWayError(ReasonCode.NO_DOCK.of(self.series))
        self._begin(Docking(dock, self._check, self.limits, self._approach))

    def undock(self) -> None:
        """Back out of the charging station and turn round."""
        self._begin(self._undocking(about=True))

    def cancel(self) -> None:
        """End the task; the next step brakes."""
        if self._task is not None:
            self._task, self._then = None, None
            self._last = NavigationStep(None, "FAILED", ReasonCode.CANCELLED)

    def forget(self) -> None:
        """Forget obstacles that are not on the map: the robot was carried, or got another pose."""
        self._obstacle_map.forget()

    # --- steps ------------------------------------------------------------------------------------

    def step(
        self,
        *,
        estimate: Estimate,
        odometry: Pose2D,
        velocity: Velocity,
        points: Floats,
        beams: LaserScan | None,
        charger_contact: bool,
        now: float,
    ) -> NavigationStep:
        """Return what to do now; call it while idle too, so that the robot knows its surroundings.

        Args:
            estimate: the newest pose on the map.
            odometry: the pose by the wheels, now.
            velocity: the measured velocity.
            points: (n, 2) remembered obstacles in the robot's frame now.
            beams: the newest scan, with a stamp by the same clock as `now` and the estimate's.
            charger_contact: whether the contacts of the charging station meet.
            now: seconds.
        """
        self._pose_buffer.take(now, odometry, estimate)
        if beams is not None and (self._beams is None or beams.stamp > self._beams.stamp):
            self._beams = beams
            self._look(beams, now, localized=estimate.localized)
        if self._task is None:
            return self._idle(velocity)
        self._began = now if self._began is None else self._began
        step = self._halted(estimate, odometry, now)
        if step is None:
            step = self._continue(odometry, velocity, points, now, charger_contact=charger_contact)
        return self._take(step)

    def _begin(self, task: Journey | Docking | Undocking) -> None:
        self._task, self._then, self._began, self._lost_since = task, None, None, None
        self._wheels = WheelWatch()

    def _journey(self, over: list[tuple[float, float]], heading: float | None) -> Journey:
        parts = self._obstacle_map, self._planner, self._check, self.limits, self.plan
        return Journey(*parts, over=over, heading=heading)

    def _approach(self, pose: Pose2D) -> Journey:
        return self._journey([self._planner.goal(pose.x, pose.y)], pose.theta)

    def _undocking(self, *, about: bool) -> Undocking:
        dock = self.plan.dock_of(self.series) if self.plan else None
        return Undocking(dock, self._check, self.limits, self._costmap.circumscribed, about=about)

    def _idle(self, velocity: Velocity) -> NavigationStep:
        is_at_rest = velocity == ZERO and self._asked == ZERO
        self._asked = ZERO
        return NavigationStep(None if is_at_rest else ZERO, self._last.status, self._last.reason)

    def _halted(self, estimate: Estimate, odometry: Pose2D, now: float) -> NavigationStep | None:
        """Return why the robot must stop now; None when all is well."""
        assert self._began is not None
        is_blind = self._beams is not None and not sees(self._beams)
        seen = self._began - NAVIGATOR.blind_stop
        if self._beams is not None and not is_blind:
            seen = self._beams.stamp
        if now - seen > NAVIGATOR.blind_end:
            return failed(ReasonCode.NO_LASER.of("blind" if is_blind else "silent"))
        if now - seen > NAVIGATOR.blind_stop:
            return NavigationStep(ZERO, "RUNNING", ReasonCode.NO_LASER)
        if estimate.localized or not self._task_needs_map():
            self._lost_since = None
        else:
            self._lost_since = now if self._lost_since is None else self._lost_since
            if now - self._lost_since > NAVIGATOR.lost_end:
                return failed(ReasonCode.LOST)
            return NavigationStep(ZERO, "RUNNING", ReasonCode.LOST)
        if self._wheels.stuck(self._asked, odometry, now):
            return failed(ReasonCode.WHEELS)
        return None

    def _task_needs_map(self) -> bool:
        return isinstance(self._task, Journey) or (self._task is not None and self._task.needs_map)

    def _continue(
        self,
        odometry: Pose2D,
        velocity: Velocity,
        points: Floats,
        now: float,
        *,
        charger_contact: bool,
    ) -> NavigationStep:
        assert self._task is not None
        assert self._beams is not None
        if charger_contact and isinstance(self._task, Journey) and self._then is None:
            # out of the station first; the journey itself turns
            self._then, self._task = self._task, self._undocking(about=False)
        pose = self._pose_buffer.pose()
        beams_from = self._pose_buffer.odometry_at(self._beams.stamp)
        hazards = self._hazards(odometry, beams_from, points, now)
        return self._task.step(
            Sense(now, pose, odometry, velocity, hazards, self._beams, beams_from, charger_contact)
        )

    def _hazards(self, odometry: Pose2D, beams_from: Pose2D, points: Floats, now: float) -> Hazards:
        assert self._beams is not None
        strange = self._obstacle_map.strange(self._pose_buffer.pose(), points, now)
        hidden = self._lost_obstacles.out_of_sight(now, odometry, self._beams)
        # only points of the memory can be people, who are wider than seen; recent scans are things
        return Hazards(
            np.concatenate([points[~strange], self._recent.near(odometry, now)]),
            points[strange],
            np.vstack([moved(self._walkers, beams_from, odometry), hidden]),
        )

    def _look(self, beams: LaserScan, now: float, *, localized: bool) -> None:
        """Take a new scan, and find possible walkers in it."""
        odometry = self._pose_buffer.odometry_at(beams.stamp)
        robot = self._pose_buffer.on_map(odometry)
        self._recent.take(odometry, beams)
        if localized:
            self._obstacle_map.look(robot, beams, now)
        strangers = beams.points()[self._obstacle_map.strange(robot, beams.points(), now)]
        self._walkers = strangers[~self._obstacle_map.settled(robot, strangers, now)]
        self._lost_obstacles.take(beams.stamp, odometry, self._walkers)

    def _take(self, step: NavigationStep) -> NavigationStep:
        """Note how a step ended; after an undocking, begin the journey."""
        self._asked = step.velocity or ZERO
        if step.status == "FINISHED" and self._then is not None:
            self._task, self._then = self._then, None
            return NavigationStep(ZERO, "RUNNING")
        if step.status != "RUNNING":
            self._task, self._then, self._last = None, None, step
        return step
