"""A first-time user of a study's drive page, who knows what the page shows and nothing else.

They read the robot's place and their route off the map, and the next action from the text. They
look ten times a second and have slow hands: keys that are up or down, or a finger on the stick.
They take a door for closed when the page reports that the robot touches something there.
"""

import contextlib
import json
import math
import re
import time
from dataclasses import dataclass, field
from typing import Any, Protocol

from playwright.sync_api import CDPSession, Locator, Page, TimeoutError as PlaywrightTimeout

from experiments.bots.driver import STAND, Driver, Guide, Intent, SpeedSetting
from experiments.bots.view import View
from robots.api.geometry import Pose2D, wrap_angle
from robots.world.sites import load_plan
from sessions import protocol
from tests.support.patience import patient

CUES = {
    "Well done": "completed",
    "Drive backwards out": "leave_station",
    "Go to checkpoint": "go_to_checkpoint",
    "This one comes later": "wrong_checkpoint",
    "turn left": "photo_turn_left",
    "turn right": "photo_turn_right",
    "drive until you are in front": "photo_move",
    "Do you see the robot": "photo_ready",
    "keep it, or take another": "photo_review",
    "Return to the charging station": "return_home",
    "Drive slowly into": "dock_now",
    "Release the controls and wait": "dock_hold",
    "Contact lost": "dock_again",
    "is still missing. Drive backwards": "docked_early",
    "does not know where it is": "lost",
    "Done. The robot is back": "completed",
    "Time is up": "timed_out",
    "The task is over": "ended",
}
OVER = {"completed", "timed_out", "ended"}
LOOK = """() => {
  const map = document.getElementById('map');
  const text = (id) => document.getElementById(id).innerText;
  return {
    ...map.dataset, width: map.clientWidth, height: map.clientHeight,
    cue: text('task-cue'), photo: text('photo'), alert: text('alert'),
    card: document.getElementById('card').hidden ? '' : text('card-title'),
  };
}"""
RELEASE = "Release the controls, then drive on"  # on the page after a stop
AHEAD = 0.25  # s that users extrapolate the motion
# m/s and rad/s for which a key is pressed
ENOUGH = {"ArrowUp": 0.05, "ArrowDown": 0.05, "ArrowLeft": 0.13, "ArrowRight": 0.13}
FULL = {"Slow": SpeedSetting(0.28, 0.44), "Normal": SpeedSetting(0.49, 0.58)}  # of each step
BACK = 0.3  # m/s, the fastest backwards
DEAD, LEAST = 0.14, 0.12  # a stick's dead zone (of its radius), and the speed at its edge
AT_A_DOOR = 0.9  # metres from its middle


class Hands(Protocol):
    """A controller that a user holds."""

    def steer(self, speed: SpeedSetting, step: str) -> None:
        """Drive at this speed, with this step of speed chosen on the page."""

    def release(self) -> None: ...


@dataclass
class Keys:
    """The arrow keys: each is up or down."""

    page: Page
    down: set[str] = field(default_factory=set)

    def steer(self, speed: SpeedSetting, step: str) -> None:
        wanted = {
            "ArrowUp": speed.linear,
            "ArrowDown": -speed.linear,
            "ArrowLeft": speed.angular,
            "ArrowRight": -speed.angular,
        }
        for key, amount in wanted.items():
            held = amount > ENOUGH[key]
            if held != (key in self.down):
                (self.page.keyboard.down if held else self.page.keyboard.up)(key)
                (self.down.add if held else self.down.discard)(key)

    def release(self) -> None:
        self.steer(STAND, "")


def stick_position(speed: SpeedSetting, step: str) -> tuple[float, float]:
    """Return where to push a stick for a speed, (right, down) in shares of its radius."""
    full = FULL[step]
    ahead = speed.linear / (full.linear if speed.linear > 0.0 else BACK)
    left = speed.angular / full.angular
    distance = math.hypot(ahead, left)
    if distance < LEAST:
        return 0.0, 0.0
    share = math.sqrt((min(1.0, distance) - LEAST) / (1.0 - LEAST))
    push = (DEAD + (1.0 - DEAD) * share) / distance
    return -push * left, -push * ahead


class Pointer(Protocol):
    """A hand on the screen; positions are in CSS pixels of the page."""

    def down(self, x: float, y: float) -> None: ...

    def move(self, x: float, y: float) -> None: ...

    def up(self) -> None: ...


@dataclass
class Touch:
    """One finger."""

    touch: CDPSession

    def down(self, x: float, y: float) -> None:
        self._send("touchStart", {"x": x, "y": y})

    def move(self, x: float, y: float) -> None:
        self._send("touchMove", {"x": x, "y": y})

    def up(self) -> None:
        self._send("touchEnd")

    def cancel(self) -> None:
        self._send("touchCancel")

    def _send(self, kind: str, *points: dict[str, float]) -> None:
        self.touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": list(points)})


def drag_with_finger(page: Page, x: float, y: float, right: float) -> None:
    """Drag from a point to the right, in CSS pixels."""
    finger = Touch(page.context.new_cdp_session(page))
    finger.down(x, y)
    for step in range(1, 6):
        finger.move(x + right * step / 5, y)
    finger.up()


@dataclass
class Thumb:
    """A pointer on the stick on the screen."""

    page: Page
    pointer: Pointer
    is_down: bool = False

    def steer(self, speed: SpeedSetting, step: str) -> None:
        box = self.page.locator("#stick").bounding_box()
        if box is None:
            return  # another view hides the stick
        x, y = stick_position(speed, step)
        if not self.is_down and not (x or y):
            return
        across, down = box["width"] / 2, box["height"] / 2
        if not self.is_down:
            self.pointer.down(box["x"] + across, box["y"] + down)
            self.is_down = True
        self.pointer.move(box["x"] + across * (1 + x), box["y"] + down * (1 + y))

    def release(self) -> None:
        if self.is_down:
            self.pointer.up()
            self.is_down = False


@dataclass
class UserDecisions:
    """Decides from what a user sees how to drive, and at which step of speed. Knows no page."""

    driver: Driver
    seen: tuple[float, Pose2D] | None = None
    step: str = "Normal"

    def decide(self, view: View, now: float, *, bumped: bool = False) -> tuple[Intent, str]:
        """Return what to do, and the step of speed; `view.pose` is what the map shows."""
        if view.pose is None:
            return Intent(), self.step
        shown = view.pose
        view.pose = self._soon(shown, now)
        if bumped:
            self._mark_closed(shown)
        self.step = self._step_for(view.task.cue, shown)
        return self.driver.decide(view, now), self.step

    def _soon(self, pose: Pose2D, now: float) -> Pose2D:
        """Return the pose in `AHEAD` seconds, extrapolating the turn."""
        if self.seen is None or now - self.seen[0] > 1.0:
            self.seen = (now, pose)
            return pose
        then, before = self.seen
        rate = wrap_angle(pose.theta - before.theta) / max(0.05, now - then)
        self.seen = (now, pose)
        return Pose2D(pose.x, pose.y, wrap_angle(pose.theta + rate * AHEAD))

    def _mark_closed(self, pose: Pose2D) -> None:
        for door in self.driver.plan.doors:
            middle = (door.start[0] + door.end[0]) / 2.0, (door.start[1] + door.end[1]) / 2.0
            if math.dist(middle, (pose.x, pose.y)) < AT_A_DOOR:
                self.driver.closed.add(door.name)

    def _step_for(self, cue: str, pose: Pose2D) -> str:
        dock = self.driver.guide.dock
        if (
            cue.startswith("photo_")
            or cue in {"dock_now", "dock_again"}
            or math.dist((dock.x, dock.y), (pose.x, pose.y)) < 1.6
        ):
            return "Slow"
        return "Normal"


def pose_on(seen: dict[str, Any]) -> Pose2D:
    """Return where the map of a page shows the robot, from the result of LOOK."""
    scale = float(seen["viewScale"])
    x = float(seen["viewX"]) + (float(seen["markerX"]) - seen["width"] / 2) / scale
    y = float(seen["viewY"]) - (float(seen["markerY"]) - seen["height"] / 2) / scale
    return Pose2D(x, y, float(seen["markerTheta"]))


@dataclass
class FirstTimeUser:
    """One person on a drive page."""

    page: Page
    hands: Hands
    cues: list[str] = field(default_factory=list)

    def drive(self, within: float) -> list[str]:
        """Drive until the task is over, and return the cues that were shown, in order."""
        config = json.loads(self.page.locator("#config").text_content() or "{}")
        plan, _ = load_plan("office")
        guide = Guide.of(config["study"], plan, "giraff")
        user, step = UserDecisions(Driver(plan, guide, SpeedSetting(0.6, 0.6))), "Normal"
        deadline = time.monotonic() + patient(within)
        while time.monotonic() < deadline:
            view, alert = self.look(guide)
            bumped = "ouched something" in alert
            if self.cues[-1:] != [view.task.cue]:
                self.cues.append(view.task.cue)
            if view.task.cue in OVER:
                break
            intent, wanted = user.decide(view, time.monotonic(), bumped=bumped)
            if wanted != step:
                self.hands.release()
                self.press(self.page.get_by_role("button", name=wanted, exact=True))
                step = wanted
            if RELEASE in alert:
                self.hands.release()
            else:
                self._do(intent, step)
            self.page.wait_for_timeout(60)
        else:
            self.cues.append(f"not over; the alert is {alert!r}")
        self.hands.release()
        return self.cues

    def look(self, guide: Guide) -> tuple[View, str]:
        """Return what map and text show, and the alert over the video."""
        seen = self.page.evaluate(LOOK)
        # The end may follow the last cue so soon that only its card is seen.
        words = f"{seen['card']} {seen['photo']} {seen['cue']}"
        cue = next((name for text, name in CUES.items() if text in words), "")
        match = re.search(r"checkpoint (\d+)", seen["cue"])
        number = int(match[1]) if match else None
        x, y = guide.stops.get(1 if cue == "leave_station" else number) or (None, None)
        view = View(pose=pose_on(seen), localized=cue != "lost")
        view.task = protocol.Task(session="seen", stamp=0.0, cue=cue, number=number, x=x, y=y)
        return view, seen["alert"]

    def _do(self, intent: Intent, step: str) -> None:
        self.hands.steer(intent.speed, step)
        if intent.take:
            self.press(self.page.get_by_role("button", name="Take photo"))
        if intent.answer == "keep":
            self.press(self.page.get_by_role("button", name="Keep", exact=True))

    @staticmethod
    def press(button: Locator) -> None:
        """Press a button if it is shown: the page may have changed since it was looked at."""
        with contextlib.suppress(PlaywrightTimeout):
            if button.is_visible() and button.is_enabled(timeout=500):
                button.click(timeout=500)
