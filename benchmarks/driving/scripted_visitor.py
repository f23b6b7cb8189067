"""A visitor who drives through the whole office with one controller: out of the dock, through both
doors to the far end, and back.

They use only what the page shows. With the mouse or a finger on the video they press on the
farthest point of their route that is visible on the floor straight ahead, and on the next one
before the robot arrives. A press on the sides of the video turns the robot to what is beside it.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from playwright.sync_api import Page

from experiments.bots.driver import Driver, Guide, SpeedSetting
from experiments.bots.routes import RouteGrid
from experiments.bots.view import View
from robots.api.floorplan import FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Camera, Point
from sessions import protocol
from tests.support.browsers.drive_page import PAD
from tests.support.browsers.first_time_user import (
    LOOK,
    Hands,
    Pointer,
    UserDecisions,
    pose_on,
    stick_position,
)
from tests.support.patience import patient

AWAY: tuple[Point, ...] = ((3.0, 5.2), (5.0, 1.0), (10.0, 3.3))  # in the office, m
STOPS: tuple[Point, ...] = (*AWAY, (7.6, 6.2), *reversed(AWAY))
NEAR = 0.5  # m from a stop
LOOK_INTERVAL = 0.08  # s
FAR, NEAREST = 3.0, 1.25  # m to a point that is pressed
LEFT = 0.7  # m from the pressed point, at which the next one is pressed
ASIDE = 0.15  # m by which a route may leave the straight line to a point
EDGE = 0.04  # of the video, along its border, where points are not pressed
SIDE = 0.1  # of the video's width, at its sides, where a press turns
ENOUGH, PRESS_TURNS = 0.35, 0.9  # rad: where a turn by holding ends, and the turn of one press
STEP = 0.6  # m
APART = 4  # points of the route between a refused one and the next that is tried
STILL = 0.01  # m and rad
WAITS = 1.5  # s after a press for which a robot at rest may still start
PICTURE = """() => {
  const video = document.getElementById('video');
  const { left, top, width, height } = video.getBoundingClientRect();
  return { left, top, width, height, fit: getComputedStyle(video).objectFit };
}"""

IS_PICTURE = (
    "([x, y]) => document.elementFromPoint(x, y)?.matches('#viewport, #viewport video, #viewport"
    " canvas') ?? false"
)


@dataclass
class Pad:
    """A thumb on a gamepad's left stick."""

    page: Page

    def __post_init__(self) -> None:
        self.page.evaluate(PAD)

    def steer(self, speed: SpeedSetting, step: str) -> None:
        axes = list(stick_position(speed, step))
        self.page.evaluate("(axes) => { stub.axes = [...axes, 0, 0]; }", axes)

    def release(self) -> None:
        self.page.evaluate("() => { stub.axes = [0, 0, 0, 0]; }")


@dataclass
class Mouse:
    page: Page

    def down(self, x: float, y: float) -> None:
        self.page.mouse.move(x, y)
        self.page.mouse.down()

    def move(self, x: float, y: float) -> None:
        self.page.mouse.move(x, y)

    def up(self) -> None:
        self.page.mouse.up()


def in_picture(camera: Camera, tilt: float, robot: Pose2D, point: Point) -> Point | None:
    """Return the position of a point of the floor in the video, as shares of its width and height;
    None outside of it.
    """
    forward, left, _ = robot.inverse().compose(Pose2D(*point, 0.0))
    pitch = camera.pitch + tilt
    depth = math.cos(pitch) * (forward - camera.x) + math.sin(pitch) * camera.z
    if depth <= 0.0:
        return None
    below = math.cos(pitch) * camera.z - math.sin(pitch) * (forward - camera.x)
    focal = camera.width / 2.0 / math.tan(camera.hfov / 2.0)
    u, v = 0.5 - focal * left / depth / camera.width, 0.5 + focal * below / depth / camera.height
    return (u, v) if EDGE < u < 1.0 - EDGE and EDGE < v < 1.0 - EDGE else None


def next_of(route: Sequence[Point], robot: Pose2D) -> Point:
    """Return the next point, a step ahead, so that a bend behind a door is driven behind it."""
    return next((point for point in route if math.dist(point, robot[:2]) > STEP), route[-1])


def _towards(robot: Pose2D, to: Point, distance: float) -> Point:
    """Return the point at a distance in the direction of another, in the robot's frame."""
    x, y = robot.inverse().apply(*to)
    return distance * x / math.hypot(x, y), distance * y / math.hypot(x, y)


def is_straight(route: Sequence[Point], robot: Pose2D, to: Point) -> bool:
    """Tell whether a route is nearly straight up to one of its points."""
    line = Pose2D(robot.x, robot.y, math.atan2(to[1] - robot.y, to[0] - robot.x)).inverse()
    before = route[: route.index(to)]
    return all(abs(line.apply(*point)[1]) < ASIDE for point in before)


@dataclass
class Tour:
    """One person on a drive page that drives already, and the stops to visit."""

    page: Page
    plan: FloorPlan
    stops: Sequence[Point] = STOPS
    presses: int = 0
    turns: int = 0
    alerts: list[str] = field(default_factory=list)

    def steer(self, hands: Hands, within: float) -> float:
        """Visit the stops with a controller, and return the seconds."""
        guide = Guide.of({}, self.plan, "giraff")
        user, step = UserDecisions(Driver(self.plan, guide, SpeedSetting(0.6, 0.6))), "Normal"
        began = time.monotonic()
        for number, (x, y) in enumerate(self.stops, 1):
            task = protocol.Task(
                session="seen", stamp=0.0, cue="go_to_checkpoint", number=number, x=x, y=y
            )
            while math.dist((x, y), (pose := self._pose(began + patient(within)))[:2]) > NEAR:
                view = View(pose=pose, localized=True, task=task)
                intent, wanted = user.decide(view, time.monotonic())
                if wanted != step:
                    hands.release()
                    self.page.get_by_role("button", name=wanted, exact=True).click()
                    step = wanted
                hands.steer(intent.speed, step)
                self.page.wait_for_timeout(1000 * LOOK_INTERVAL)
        hands.release()
        return time.monotonic() - began

    def point(self, hand: Pointer, camera: Camera, tilt: float, within: float) -> float:
        """Visit the stops by pressing on the video, and return the seconds."""
        began, grid = time.monotonic(), RouteGrid(self.plan)
        until, pressed, since = began + patient(within), None, -math.inf
        self.page.locator("#offer-main").click()
        before = self._pose(until)
        self.page.wait_for_selector(
            "#offer[hidden]", state="attached", timeout=1000 * patient(20.0)
        )
        for stop in self.stops:
            while math.dist(stop, (pose := self._pose(until))[:2]) > NEAR:
                moved = (
                    math.dist(pose[:2], before[:2]) > STILL
                    or abs(wrap_angle(pose.theta - before.theta)) > STILL
                )
                before, since = pose, time.monotonic() if moved else since
                if (
                    pressed is None
                    or math.dist(pressed, pose[:2]) < LEFT
                    or time.monotonic() - since > WAITS
                ):
                    route = grid.route(pose[:2], stop)
                    pressed, since = self._press(hand, camera, tilt, pose, route), time.monotonic()
                    if pressed is None:
                        self._turn(hand, pose, route, until)
                self.page.wait_for_timeout(1000 * LOOK_INTERVAL)
        return time.monotonic() - began

    def _press(
        self, hand: Pointer, camera: Camera, tilt: float, pose: Pose2D, route: Sequence[Point]
    ) -> Point | None:
        """Press on the farthest visible point of the route, and return it; None if there is none or
        the page refuses all.
        """
        reach = [
            point
            for point in route
            if math.dist(point, pose[:2]) <= FAR
            and (point == route[-1] or math.dist(point, pose[:2]) >= NEAREST)
        ]
        # for points nearer than the video shows
        beyond = pose.apply(*_towards(pose, next_of(route, pose), NEAREST + 0.1))
        straight = sorted(
            (point for point in reach if is_straight(route, pose, point)),
            key=lambda one: -math.dist(one, pose[:2]),
        )
        for point in [*straight[::APART], beyond]:
            place = self._place(camera, tilt, pose, point)
            if place is None:
                continue
            self.presses += 1
            hand.down(*place)
            self.page.wait_for_timeout(1000 * LOOK_INTERVAL)
            shows = self.page.get_attribute("#overlay", "data-shows")
            hand.up()
            if shows == "goal":
                return point
        return None

    def _place(self, camera: Camera, tilt: float, pose: Pose2D, point: Point) -> Point | None:
        """Return where on the page a point of the floor is shown."""
        seen = in_picture(camera, tilt, pose, point)
        if seen is None:
            return None
        box: dict[str, Any] = self.page.evaluate(PICTURE)
        ratios = box["width"] / camera.width, box["height"] / camera.height
        scale = max(ratios) if box["fit"] == "cover" else min(ratios)
        x = box["left"] + box["width"] / 2 + scale * camera.width * (seen[0] - 0.5)
        y = box["top"] + box["height"] / 2 + scale * camera.height * (seen[1] - 0.5)
        inside = (
            box["left"] + SIDE * box["width"] < x < box["left"] + (1 - SIDE) * box["width"]
            and box["top"] < y < box["top"] + box["height"]
        )
        return (x, y) if inside and self.page.evaluate(IS_PICTURE, [x, y]) else None

    def _turn(self, hand: Pointer, pose: Pose2D, route: Sequence[Point], until: float) -> None:
        """Hold a side of the video until the route leads about ahead, or press it once if it nearly
        does.
        """
        self.turns += 1
        target = next_of(route, pose)
        aside = self._aside(target, until)
        box: dict[str, Any] = self.page.evaluate(PICTURE)
        hand.down(
            box["left"] + box["width"] * (0.02 if aside > 0.0 else 0.98),
            box["top"] + 0.85 * box["height"],
        )
        while abs(self._aside(target, until)) > ENOUGH and abs(aside) > PRESS_TURNS:
            self.page.wait_for_timeout(1000 * LOOK_INTERVAL)
        hand.up()
        before = math.inf
        while abs(before - (now := self._aside(target, until))) > STILL:
            before = now
            self.page.wait_for_timeout(4000 * LOOK_INTERVAL)

    def _aside(self, target: Point, until: float) -> float:
        pose = self._pose(until)
        return wrap_angle(math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.theta)

    def _pose(self, until: float) -> Pose2D:
        """Return where the map shows the robot."""
        assert time.monotonic() < until, f"the tour took too long; alerts: {self.alerts}"
        seen = self.page.evaluate(LOOK)
        if seen["alert"] and seen["alert"] not in self.alerts[-1:]:
            self.alerts.append(seen["alert"])
        return pose_on(seen)
