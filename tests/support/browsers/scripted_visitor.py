"""Somebody who shows themselves the whole office with one controller: out of the dock, through both
doors to the far end, and back.

They go by what the page shows, as a newcomer does. Who presses on the picture looks for the
farthest place of their way that lies on the floor in it, straight ahead of the robot, presses
there, and presses on before the robot has arrived; what is aside of the picture they turn to by its
sides.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from playwright.sync_api import CDPSession, Page

from experiments.bots.driver import Driver, Guide, SpeedSetting
from experiments.bots.routes import RouteGrid
from experiments.bots.view import View
from robots.api.floorplan import FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Camera, Point
from sessions import protocol
from tests.support.browsers.first_time_user import BACK, FULL, LOOK, Hands, Mind, pose_on, push
from tests.support.patience import patient

# of the office
STOPS: tuple[Point, ...] = (
    (3.0, 5.2),
    (5.0, 1.0),
    (10.0, 3.3),
    (7.6, 6.2),
    (10.0, 3.3),
    (5.0, 1.0),
    (3.0, 5.2),
)
NEAR = 0.5  # metres from a stop
LOOKS = 0.08  # seconds between two looks
FAR, NEAREST = 3.0, 1.25  # metres to a place that is pressed
LEFT = 0.7  # metres from the place that was pressed last, at which the next one is
ASIDE = 0.15  # metres that a way may bend away from the straight line to a place
EDGE = 0.04  # of the picture: nearer to its rim nobody presses
SIDE = 0.1  # of the picture's width: nearer to its edge a press turns
ENOUGH, PRESS_TURNS = 0.35, 0.9  # rad: where a turn by holding ends, and what one press about does
STEP = 0.6  # metres
APART = 4  # places of the way, from one that the page refused to the next that is tried
STILL = 0.01  # metres and rad
WAITS = 1.5  # seconds after a press in which a robot that stands still may still be about to go
PAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false }));
  const pad = { index: 0, id: "stub", mapping: "standard", axes: [0, 0, 0, 0], buttons };
  window.stub = pad;
  navigator.getGamepads = () => [pad];
  window.dispatchEvent(Object.assign(new Event("gamepadconnected"), { gamepad: pad }));
}"""
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
        full = FULL[step]
        ahead, left = (
            speed.linear / (full.linear if speed.linear > 0.0 else BACK),
            speed.angular / full.angular,
        )
        self.page.evaluate(
            "(axes) => { stub.axes = [...axes, 0, 0]; }", [-push(left, ahead), -push(ahead, left)]
        )

    def let_go(self) -> None:
        self.page.evaluate("() => { stub.axes = [0, 0, 0, 0]; }")


class Pointer(Protocol):
    """A hand on the screen."""

    def down(self, x: float, y: float) -> None:
        """Touch the page there, in CSS pixels."""

    def move(self, x: float, y: float) -> None:
        """Drag."""

    def up(self) -> None:
        """Lift."""


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


@dataclass
class Touch:
    touch: CDPSession

    def down(self, x: float, y: float) -> None:
        self._send("touchStart", {"x": x, "y": y})

    def move(self, x: float, y: float) -> None:
        self._send("touchMove", {"x": x, "y": y})

    def up(self) -> None:
        self._send("touchEnd")

    def _send(self, kind: str, *points: dict[str, float]) -> None:
        self.touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": list(points)})


@dataclass
class Thumb:
    """The stick on the screen, with whatever points."""

    page: Page
    pointer: Pointer
    is_down: bool = False

    def steer(self, speed: SpeedSetting, step: str) -> None:
        full = FULL[step]
        ahead, left = (
            speed.linear / (full.linear if speed.linear > 0.0 else BACK),
            speed.angular / full.angular,
        )
        box = self.page.locator("#stick").bounding_box()
        if box is None:
            return  # the page has something else to say just now
        if not self.is_down:
            self.pointer.down(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            self.is_down = True
        x, y = -push(left, ahead), -push(ahead, left)
        self.pointer.move(
            box["x"] + box["width"] / 2 * (1 + x), box["y"] + box["height"] / 2 * (1 + y)
        )

    def let_go(self) -> None:
        if self.is_down:
            self.pointer.up()
            self.is_down = False


def in_picture(camera: Camera, tilt: float, robot: Pose2D, point: Point) -> Point | None:
    """Return where in a picture a place of the floor is seen, as shares of its width and height;
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


def next_of(way: Sequence[Point], robot: Pose2D) -> Point:
    """Return where a way leads next: a step ahead, so that a bend behind a door is driven behind
    it.
    """
    return next((point for point in way if math.dist(point, robot[:2]) > STEP), way[-1])


def _towards(robot: Pose2D, to: Point, distance: float) -> Point:
    """Return the place so far away in the direction of a point, in the robot's frame."""
    x, y = robot.inverse().apply(*to)
    return distance * x / math.hypot(x, y), distance * y / math.hypot(x, y)


def is_straight(way: Sequence[Point], robot: Pose2D, to: Point) -> bool:
    """Tell whether a way up to a point of it hardly leaves the straight line to it."""
    line = Pose2D(robot.x, robot.y, math.atan2(to[1] - robot.y, to[0] - robot.x)).inverse()
    before = way[: way.index(to)]
    return all(abs(line.apply(*point)[1]) < ASIDE for point in before)


@dataclass
class Tour:
    """One person, one drive page that drives already, and the stops that they want to see."""

    page: Page
    plan: FloorPlan
    stops: Sequence[Point] = STOPS
    presses: int = 0
    turns: int = 0
    answers: list[str] = field(default_factory=list)  # alerts that the page gave

    def steer(self, hands: Hands, within: float) -> float:
        """Visit the stops with hands that steer, and return the seconds that it took."""
        guide = Guide.of({}, self.plan, "giraff")
        node, step = Mind(Driver(self.plan, guide, SpeedSetting(0.6, 0.6))), "Normal"
        began = time.monotonic()
        for number, (x, y) in enumerate(self.stops, 1):
            task = protocol.Task(
                session="seen", stamp=0.0, cue="go_to_checkpoint", number=number, x=x, y=y
            )
            while math.dist((x, y), (pose := self._pose(began + patient(within)))[:2]) > NEAR:
                intent, wanted = node.decide(
                    View(pose=pose, localized=True, task=task), time.monotonic()
                )
                if wanted != step:
                    hands.let_go()
                    self.page.get_by_role("button", name=wanted, exact=True).click()
                    step = wanted
                hands.steer(intent.speed, step)
                self.page.wait_for_timeout(1000 * LOOKS)
        hands.let_go()
        return time.monotonic() - began

    def point(self, hand: Pointer, camera: Camera, tilt: float, within: float) -> float:
        """Visit the stops by pressing on the picture, and return the seconds that it took."""
        began, ways, pressed, since = time.monotonic(), RouteGrid(self.plan), None, -math.inf
        until = began + patient(within)
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
                    way = ways.route(pose[:2], stop)
                    pressed, since = self._press(hand, camera, tilt, pose, way), time.monotonic()
                    if pressed is None:
                        self._turn(hand, pose, way, until)
                self.page.wait_for_timeout(1000 * LOOKS)
        return time.monotonic() - began

    def _press(
        self, hand: Pointer, camera: Camera, tilt: float, pose: Pose2D, way: Sequence[Point]
    ) -> Point | None:
        """Press on the farthest place of the way that is seen, and return it; None when none is, or
        the page says no.
        """
        reach = [
            point
            for point in way
            if math.dist(point, pose[:2]) <= FAR
            and (point == way[-1] or math.dist(point, pose[:2]) >= NEAREST)
        ]
        # for what is nearer than the picture shows
        beyond = pose.apply(*_towards(pose, next_of(way, pose), NEAREST + 0.1))
        straight = sorted(
            (point for point in reach if is_straight(way, pose, point)),
            key=lambda one: -math.dist(one, pose[:2]),
        )
        for point in [*straight[::APART], beyond]:
            place = self._place(camera, tilt, pose, point)
            if place is None:
                continue
            self.presses += 1
            hand.down(*place)
            self.page.wait_for_timeout(1000 * LOOKS)
            shows = self.page.get_attribute("#overlay", "data-shows")
            hand.up()
            if shows == "goal":
                return point
        return None

    def _place(self, camera: Camera, tilt: float, pose: Pose2D, point: Point) -> Point | None:
        """Return where on the page a place of the floor is seen."""
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

    def _turn(self, hand: Pointer, pose: Pose2D, way: Sequence[Point], until: float) -> None:
        """Hold a side of the picture until the way leads about ahead, or press it once where it
        nearly does.
        """
        self.turns += 1
        target = next_of(way, pose)
        aside = self._aside(target, until)
        box: dict[str, Any] = self.page.evaluate(PICTURE)
        hand.down(
            box["left"] + box["width"] * (0.02 if aside > 0.0 else 0.98),
            box["top"] + 0.85 * box["height"],
        )
        while abs(self._aside(target, until)) > ENOUGH and abs(aside) > PRESS_TURNS:
            self.page.wait_for_timeout(1000 * LOOKS)
        hand.up()
        before = math.inf
        while abs(before - (now := self._aside(target, until))) > STILL:
            before = now
            self.page.wait_for_timeout(4000 * LOOKS)

    def _aside(self, target: Point, until: float) -> float:
        pose = self._pose(until)
        return wrap_angle(math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.theta)

    def _pose(self, until: float) -> Pose2D:
        """Return where the map shows the robot."""
        assert time.monotonic() < until, f"the tour took too long; the page said: {self.answers}"
        seen = self.page.evaluate(LOOK)
        if seen["alert"] and seen["alert"] not in self.answers[-1:]:
            self.answers.append(seen["alert"])
        return pose_on(seen)
