"""Somebody new on the drive page of a study: where the robot is they see on the map, what is next
in the words on the screen.

They look ten times a second and have slow hands: keys that are up or down, or a finger on the
stick. Where the way leads they read off the map, which has walls, doors and furniture; that a door
is closed they notice when the page says that the robot is touching something there. Nobody tells
them what the simulated robot or the server knows.
"""

import contextlib
import json
import math
import re
import time
from dataclasses import dataclass, field
from typing import Any, Protocol

from playwright.sync_api import CDPSession, Locator, Page
from playwright.sync_api import TimeoutError as PlaywrightTimeout

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
LET_GO = "Release the controls, then drive on"  # what the page says after a stop
# seconds that people think ahead of what they see, because the robot goes on for a moment
AHEAD = 0.25
# m/s and rad/s that are worth a key
ENOUGH = {"ArrowUp": 0.05, "ArrowDown": 0.05, "ArrowLeft": 0.13, "ArrowRight": 0.13}
FULL = {
    "Slow": SpeedSetting(0.28, 0.44),
    "Normal": SpeedSetting(0.49, 0.58),
}  # what the steps feel like
BACK = 0.3  # m/s, the most backwards
# of a stick's radius and of full speed: as far as a finger must move, and what it then does
DEAD, LEAST = 0.14, 0.12
AT_A_DOOR = 0.9  # metres from its middle


class Hands(Protocol):
    """Something that steers."""

    def steer(self, speed: SpeedSetting, step: str) -> None:
        """Do it at a step of speed."""

    def let_go(self) -> None:
        """Leave it alone."""


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

    def let_go(self) -> None:
        self.steer(STAND, "")


def push(share: float, other: float) -> float:
    """How far a finger pushes the stick along one axis for a share of full speed, when the other
    axis asks for another.
    """
    size = min(1.0, math.hypot(share, other))
    if size < LEAST:
        return 0.0
    return (
        share
        / math.hypot(share, other)
        * (DEAD + (1.0 - DEAD) * math.sqrt((size - LEAST) / (1.0 - LEAST)))
    )


@dataclass
class Finger:
    """One finger on the stick."""

    page: Page
    touch: CDPSession
    is_down: bool = False

    def steer(self, speed: SpeedSetting, step: str) -> None:
        full = FULL[step]
        ahead, left = (
            speed.linear / (full.linear if speed.linear > 0.0 else BACK),
            speed.angular / full.angular,
        )
        x, y = -push(left, ahead), -push(ahead, left)
        if not self.is_down and (x or y):
            self._send("touchStart", 0.0, 0.0)
        if self.is_down or x or y:
            self._send("touchMove", x, y)

    def let_go(self) -> None:
        if self.is_down:
            self.touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
            self.is_down = False

    def _send(self, kind: str, x: float, y: float) -> None:
        box = self.page.locator("#stick").bounding_box()
        if box is None:
            return  # the page has something else to say just now: a finger finds nothing to push
        at = {
            "x": box["x"] + box["width"] / 2 * (1 + x),
            "y": box["y"] + box["height"] / 2 * (1 + y),
        }
        self.touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [at]})
        self.is_down = True


@dataclass
class Mind:
    """What somebody makes of what they see: a wish for the hands, at which step of speed. Knows no
    page.
    """

    driver: Driver
    seen: tuple[float, Pose2D] | None = None
    step: str = "Normal"

    def decide(self, view: View, now: float, *, bumped: bool = False) -> tuple[Intent, str]:
        """Return what to do, and how fast; `view.pose` is what the map shows."""
        if view.pose is None:
            return Intent(), self.step
        shown = view.pose
        view.pose = self._soon(shown, now)
        if bumped:
            self._mark_closed(shown)
        self.step = self._step_for(view.task.cue, shown)
        return self.driver.decide(view, now), self.step

    def _soon(self, pose: Pose2D, now: float) -> Pose2D:
        """Where the robot will be in a moment if it goes on as it does."""
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
    """Return where the map of a page shows the robot, of what LOOK gave."""
    scale = float(seen["viewScale"])
    x = float(seen["viewX"]) + (float(seen["markerX"]) - seen["width"] / 2) / scale
    y = float(seen["viewY"]) - (float(seen["markerY"]) - seen["height"] / 2) / scale
    return Pose2D(x, y, float(seen["markerTheta"]))


@dataclass
class FirstTimeUser:
    """One person on a drive page."""

    page: Page
    hands: Hands
    said: list[str] = field(default_factory=list)

    def drive(self, within: float) -> list[str]:
        """Drive until the task is over, and return the cues that were shown, in order."""
        study: dict[str, Any] = json.loads(self.page.locator("#config").text_content() or "{}")[
            "study"
        ]
        plan, _ = load_plan("office")
        guide = Guide.of(study, plan, "giraff")
        node, step = Mind(Driver(plan, guide, SpeedSetting(0.6, 0.6))), "Normal"
        deadline = time.monotonic() + patient(within)
        while time.monotonic() < deadline:
            view, alert = self.look(guide)
            bumped = "ouched something" in alert
            if not self.said or self.said[-1] != view.task.cue:
                self.said.append(view.task.cue)
            if view.task.cue in OVER:
                break
            intent, wanted = node.decide(view, time.monotonic(), bumped=bumped)
            if wanted != step:
                self.hands.let_go()
                self.press(self.page.get_by_role("button", name=wanted, exact=True))
                step = wanted
            if LET_GO in alert:
                self.hands.let_go()
            else:
                self._do(intent, step)
            self.page.wait_for_timeout(60)
        else:
            self.said.append(f"not over; the page says: {alert or 'nothing'}")
        self.hands.let_go()
        return self.said

    def look(self, guide: Guide) -> tuple[View, str]:
        """What the map and the words say, and the line over the picture."""
        seen = self.page.evaluate(LOOK)
        # The end may come so soon after the last cue that only its card is ever seen.
        words = f"{seen['card']} {seen['photo']} {seen['cue']}"
        cue = next((name for said, name in CUES.items() if said in words), "")
        number = re.search(r"checkpoint (\d+)", seen["cue"])
        at = (
            guide.stops.get(int(number[1]))
            if number
            else guide.stops.get(1)
            if cue == "leave_station"
            else None
        )
        view = View(pose=pose_on(seen), localized=cue != "lost")
        view.task = protocol.Task(
            session="seen",
            stamp=0.0,
            cue=cue,
            number=int(number[1]) if number else None,
            x=at and at[0],
            y=at and at[1],
        )
        return view, seen["alert"]

    def _do(self, intent: Intent, step: str) -> None:
        self.hands.steer(intent.speed, step)
        if intent.take:
            self.press(self.page.get_by_role("button", name="Take photo"))
        if intent.answer == "keep":
            self.press(self.page.get_by_role("button", name="Keep", exact=True))

    @staticmethod
    def press(button: Locator) -> None:
        """Press a button if it is there to be pressed; between a look and a press the window may
        have gone on.
        """
        with contextlib.suppress(PlaywrightTimeout):
            if button.is_visible() and button.is_enabled(timeout=500):
                button.click(timeout=500)
