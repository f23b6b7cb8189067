"""Localization and navigation of one robot in one site.

    snapshot ──► localizer ──► navigator ──► output: pose, wanted velocity, news, path

The localizer is ours, or the pose that the robot reports. Pure: it expects ten to twenty snapshots
a second, and its clock is their stamps.
"""

import math
from dataclasses import dataclass

import numpy as np

from robots.agent.autonomy.area import Area, AreaError, own_dock
from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput, SensorSnapshot
from robots.agent.localization.localizer import Localizer
from robots.agent.localization.reported import ReportedLocalizer
from robots.agent.navigation.navigator import Navigator
from robots.agent.navigation.planning.costmap import NoWayError
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionProgress
from robots.agent.timing import Cadence
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import (
    Action,
    ActionState,
    Dock,
    Follow,
    Goto,
    Point,
    Relocalize,
    Undock,
    Velocity,
)
from robots.api.reasons import ReasonCode
from robots.world.grid import MapError
from robots.world.render_plan import with_stations
from robots.world.sensing import Estimate

PATH_PERIOD = 0.25  # seconds between two paths: it gets shorter all the time
NEWS_PERIOD = 1.0  # seconds between two reports of an action's progress
SEARCH_TIME = 90.0  # seconds for which the robot looks for itself before it gives up
SETTLING = 1.0  # seconds after which a pose that was given is confirmed by the laser, or not
DOCK_SPREAD, DOCK_TURN = 0.05, math.radians(4.0)
DOCK_DOUBT = 0.25  # metres from its dock beyond which a docked robot's pose is corrected
UNKNOWN_TURN = math.pi
Result = dict[str, float | str | bool | None]


class ActionError(ValueError):
    """An action that cannot begin; the message is the reason."""


@dataclass
class _Running:
    """An action under way, since a stamp; its last news: when, and with which reason."""

    action_id: str
    since: float
    reported_at: float = -math.inf
    reason: str = ""


class NavigationNode:
    """One robot in one site; its pose is unknown until it is placed or has found itself."""

    def __init__(self, area: Area, body: Body, rng: np.random.Generator) -> None:
        """Read the map; raises AreaError when no robot can find its way there."""
        self._area = area
        self._dock = own_dock(area.plan, body.series)
        grid = area.grid if area.plan is None else with_stations(area.grid, area.plan)
        try:
            self.localizer: Localizer | ReportedLocalizer = (
                ReportedLocalizer() if body.localizes else Localizer(grid, rng)
            )
            self.navigator = Navigator(
                grid, area.plan, np.array(body.footprint), body.limits, body.series
            )
        except (MapError, NoWayError) as error:
            raise AreaError(str(error)) from error
        self.estimate: Estimate | None = None
        self._now = 0.0
        self._driving: _Running | None = None
        self._searching: _Running | None = None
        self._news: list[ActionProgress] = []
        self._path: tuple[Point, ...] = ()
        self._sent_path: tuple[Point, ...] = self._path
        self._path_due = Cadence(PATH_PERIOD)
        self._had_contact = False

    # --- orders -----------------------------------------------------------------------------------

    def place(self, pose: Pose2D, spread: float = 0.3, turn: float = math.radians(15.0)) -> None:
        """Set the pose, to within `spread` metres and `turn` radians."""
        self.localizer.set_pose(pose, spread, turn)
        self.navigator.forget()

    def forget(self) -> None:
        """Search the whole map for the robot."""
        self.localizer.forget()
        self.navigator.forget()

    def begin(self, action: Action) -> None:
        """Start an action; it replaces a running one of its kind. Raises ActionError with the
        reason.
        """
        if isinstance(action, Relocalize):
            self._relocalize(action)
            return
        try:
            self._go(action)
        except NoWayError as error:
            raise ActionError(str(error)) from error
        self._end_driving("CANCELLED", ReasonCode.REPLACED)
        self._driving = _Running(action.action_id, self._now)

    def cancel(self, action_id: str) -> None:
        """Cancel an action; unknown ids are ignored."""
        if self._driving is not None and self._driving.action_id == action_id:
            self.navigator.cancel()
            self._end_driving("CANCELLED", ReasonCode.CANCELLED)
        if self._searching is not None and self._searching.action_id == action_id:
            self._end_searching("CANCELLED", ReasonCode.CANCELLED)

    def preview(self, x: float, y: float) -> tuple[tuple[Point, ...], str]:
        """Return the points and the reason of `messages.RoutePreview`."""
        if self.estimate is None or not self.estimate.localized:
            return (), ReasonCode.LOST
        points, reason = self.navigator.preview(x, y)
        return tuple((x, y) for x, y in np.round(points, 3).tolist()), reason

    def _go(self, action: Action) -> None:
        match action:
            case Goto():
                self.navigator.goto(*self._goal(action))
            case Follow():
                self.navigator.follow(action.points)
            case Dock():
                self.navigator.dock()
            case Undock():
                self.navigator.undock()
            case _:
                raise ActionError(ReasonCode.UNSUPPORTED)

    def _goal(self, action: Goto) -> tuple[float, float, float | None]:
        if action.place is not None:
            return self._named(action.place)
        if action.x is None or action.y is None:
            raise ActionError(ReasonCode.NO_GOAL)
        return action.x, action.y, action.theta

    def _named(self, name: str) -> tuple[float, float, float | None]:
        for place in self._area.plan.places if self._area.plan else ():
            if name.casefold() in {place.name.casefold(), place.title.casefold()}:
                return place.x, place.y, place.theta
        raise ActionError(ReasonCode.UNKNOWN_PLACE.of(name))

    def _relocalize(self, action: Relocalize) -> None:
        if action.x is None or action.y is None:
            self.forget()
        elif action.theta is None:
            self.place(Pose2D(action.x, action.y, 0.0), turn=UNKNOWN_TURN)
        else:
            self.place(Pose2D(action.x, action.y, wrap_angle(action.theta)))
        self._end_searching("CANCELLED", ReasonCode.REPLACED)
        self._searching = _Running(action.action_id, self._now)
        self._tell(action.action_id, "RUNNING")

    # --- steps ------------------------------------------------------------------------------------

    def step(self, snapshot: SensorSnapshot) -> NavigationOutput:
        self._now = snapshot.stamp
        self._anchor(snapshot)
        if isinstance(self.localizer, ReportedLocalizer):
            self.localizer.report(snapshot.pose)
        stamp, odometry, beams = snapshot.stamp, snapshot.odometry, snapshot.beams
        estimate = self.estimate = self.localizer.update(
            stamp, odometry, beams, docked=snapshot.charger_contact
        )
        self._watch_search(estimate)
        wanted = self._drive(estimate, snapshot)
        path = None if self._path is self._sent_path else self._path
        self._sent_path = self._path
        news, self._news = tuple(self._news), []
        return NavigationOutput(
            stamp=stamp,
            odometry=odometry,
            pose=estimate.pose,
            covariance=estimate.covariance,
            score=float(estimate.score),
            localized=bool(estimate.localized),
            wanted=wanted,
            news=news,
            path=path,
        )

    def _anchor(self, snapshot: SensorSnapshot) -> None:
        """Set the pose of a robot that touches the contacts of its only dock."""
        came = snapshot.charger_contact and not self._had_contact
        self._had_contact = snapshot.charger_contact
        if not came or self._dock is None:
            return
        dock, estimate = Pose2D(self._dock.x, self._dock.y, self._dock.theta), self.estimate
        if estimate is None or not estimate.localized or estimate.pose.distance(dock) > DOCK_DOUBT:
            self.place(dock, DOCK_SPREAD, DOCK_TURN)

    def _drive(self, estimate: Estimate, snapshot: SensorSnapshot) -> Velocity | None:
        step = self.navigator.step(
            estimate=estimate,
            odometry=snapshot.odometry,
            velocity=snapshot.velocity,
            points=snapshot.points,
            beams=snapshot.beams,
            charger_contact=snapshot.charger_contact,
            now=snapshot.stamp,
        )
        running = self._driving
        if running is None:
            return None
        if step.status != "RUNNING":
            self._end_driving(step.status, step.reason)
            return ZERO
        if not self._path or self._path_due.due(self._now):
            self._path = tuple((x, y) for x, y in np.round(step.path, 3).tolist())
        if running.reason != step.reason or self._now - running.reported_at >= NEWS_PERIOD:
            running.reported_at, running.reason = self._now, step.reason
            progress: Result = {"progress": round(step.progress, 3)}
            self._tell(running.action_id, "RUNNING", step.reason, progress)
        return step.velocity or ZERO

    def _watch_search(self, estimate: Estimate) -> None:
        if self._searching is None:
            return
        seconds = self._now - self._searching.since
        if estimate.localized and seconds >= SETTLING:
            self._end_searching(
                "FINISHED", "", {**estimate.pose._asdict(), "score": estimate.score}
            )
        elif seconds >= SEARCH_TIME:
            self._end_searching("FAILED", ReasonCode.NOT_FOUND)

    # --- news -------------------------------------------------------------------------------------

    def _end_driving(self, status: ActionState, reason: str) -> None:
        if self._driving is not None:
            self._tell(self._driving.action_id, status, reason)
            self._driving, self._path = None, ()

    def _end_searching(
        self, status: ActionState, reason: str, result: Result | None = None
    ) -> None:
        if self._searching is not None:
            self._tell(self._searching.action_id, status, reason, result)
            self._searching = None

    def _tell(
        self, action_id: str, status: ActionState, reason: str = "", result: Result | None = None
    ) -> None:
        self._news.append(ActionProgress(action_id, status, reason, result or {}))
