"""Driving by pressing on the video, and with other controllers, in a real Chromium, with the scene
as the robot's camera sees it.
"""

import math
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from playwright.async_api import Browser, Page

from robots.agent.safety.permissions import CommandSender
from robots.api.geometry import wrap_angle
from robots.api.messages import (
    Dock,
    Goto,
    RoutePreview,
    RouteRequest,
    Stop,
    VelocityCommand,
)
from robots.world.sites import load_plan
from tests.support.browsers.drive_page import (
    PAD,
    UPRIGHT,
    WIDE,
    actions,
    driven,
    hold,
    stands,
    stops,
)
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.browsers.present_robot_page import CAPABILITIES, PresentRobotPage
from tests.support.media.scene_source import SceneSource
from tests.support.patience import until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
PATIENCE_MS = 40_000  # the page's own seconds are slow on a busy computer
UNPLUG = """() => {
  window.dispatchEvent(Object.assign(new Event('gamepaddisconnected'), { gamepad: stub }));
}"""


@asynccontextmanager
async def at(
    browser: Browser, start: str, size: tuple[int, int] = WIDE
) -> AsyncIterator[tuple[Page, FakeRobotPage]]:
    """Drive a robot whose camera sees the office, from one of its starts."""
    plan, _ = load_plan("office")
    with FakeRobotPage(SceneSource(plan, 5.0), start=start) as site:
        async with driven(browser, site, size) as page:
            yield page, site


def commands(site: FakeRobotPage, method: str) -> list[VelocityCommand]:
    return [command for _, command in site.applied if command.method == method]


async def place(page: Page, across: float, down: float) -> tuple[float, float]:
    """Return a point of the video in CSS pixels, from shares of its width and height."""
    box = await page.locator("#video").bounding_box()
    assert box is not None
    return box["x"] + across * box["width"], box["y"] + down * box["height"]


async def goal(page: Page) -> tuple[float, float]:
    await page.wait_for_selector("#overlay[data-shows=goal]", timeout=PATIENCE_MS)
    x, y = (await page.get_attribute("#overlay", "data-goal")).split()
    return float(x), float(y)


async def test_press_shows_the_path_and_its_release_drives_or_turns(browser):
    async with at(browser, "corridor-centre") as (page, site):
        await page.mouse.click(*await place(page, 0.5, 0.04))
        await page.wait_for_selector("#point-note[data-word='point.sky']")
        assert not site.applied
        await page.mouse.move(*await place(page, 0.5, 0.8))
        await page.mouse.down()
        x, y = await goal(page)
        await page.mouse.up()
        await until(lambda: [c for c in commands(site, "mouse") if c.linear > 0.05])
        await until(lambda: stands(site))
        assert math.hypot(site.simulation.pose.x - x, site.simulation.pose.y - y) < 0.35
        before = site.simulation.pose.theta
        await page.mouse.click(*await place(page, 0.02, 0.6))
        await until(lambda: wrap_angle(site.simulation.pose.theta - before) > 0.4)
        await until(lambda: stands(site))
        assert {c.method for _, c in site.applied} == {"mouse"}
        assert not stops(site)


async def test_refused_press_is_marked_and_explained_at_the_point_while_it_is_held(browser):
    async with at(browser, "lab-before-door") as (page, site):
        x, y = await place(page, 0.2, 0.62)  # the wall beside the door
        await page.mouse.move(x, y)
        await page.mouse.down()
        await page.wait_for_selector("#point-note[data-word='point.wall']", timeout=PATIENCE_MS)
        await page.wait_for_selector("#overlay[data-shows=blocked]", timeout=PATIENCE_MS)
        note = await page.locator("#point-note").bounding_box()
        assert note is not None
        assert math.hypot(note["x"] + note["width"] / 2 - x, note["y"] + note["height"] - y) < 180
        assert not note["y"] < y < note["y"] + note["height"], "the point is covered"
        assert not await page.is_visible("#hints")
        await page.mouse.up()
        assert await page.is_visible("#point-note")
        await page.wait_for_selector("#point-note", state="hidden", timeout=PATIENCE_MS)
        assert not site.applied


async def test_robot_that_a_held_press_drove_says_why_it_stops_at_the_release(browser):
    async with at(browser, "corridor-centre") as (page, site):
        await page.mouse.move(*await place(page, 0.5, 0.7))
        await page.mouse.down()
        await until(lambda: [c for c in commands(site, "mouse") if c.linear > 0.0])
        await page.mouse.up()
        await page.wait_for_selector("#alert[data-word='point.let_go']", timeout=PATIENCE_MS)
        await until(lambda: stands(site))


async def test_key_overrides_mouse_gamepad_overrides_key_and_unplugging_stops(browser):
    async with at(browser, "corridor-centre") as (page, site):
        await page.mouse.click(*await place(page, 0.5, 0.75))
        await until(lambda: [c for c in commands(site, "mouse") if c.linear > 0.0])
        left = lambda: [c for c in commands(site, "keyboard") if c.angular > 0.1]
        await hold(page, "ArrowLeft", left)
        await page.evaluate(PAD)
        await page.wait_for_selector("#alert[data-word='pad.left']")
        await page.evaluate("() => { stub.axes = [1, 0, 0, 0]; }")
        await until(lambda: [c for c in commands(site, "gamepad") if c.angular < -0.1])
        await page.evaluate(UNPLUG)
        await until(lambda: stops(site))
        await page.wait_for_selector("#alert[data-word='pad.gone']")
        await page.keyboard.up("ArrowLeft")
        pads = lambda: [one for one in site.received("page/event") if one.type == "gamepad"]
        await until(lambda: [event.data["there"] for event in pads()] == [True, False])


async def test_finger_held_on_the_video_drives_and_lifting_it_stops(browser):
    async with at(browser, "corridor-centre", UPRIGHT) as (page, site):
        x, y = await place(page, 0.5, 0.7)
        touches = await page.context.new_cdp_session(page)
        start = {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
        await touches.send("Input.dispatchTouchEvent", start)
        await until(lambda: [c for c in commands(site, "touch") if c.linear > 0.05])
        await touches.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        await until(lambda: stands(site))


@pytest.mark.nightly
async def test_button_leaves_the_dock_and_a_robot_that_does_not_move_says_why(browser):
    async with at(browser, "dock") as (page, site):
        await page.keyboard.down("ArrowUp")
        await page.wait_for_selector(
            "#alert[data-word='alert.docked_forward']", timeout=PATIENCE_MS
        )
        await page.keyboard.up("ArrowUp")
        await page.click("#offer-main:has-text('Leave station')")
        await page.wait_for_selector("#offer[data-word='task.undock']")
        await until(lambda: [c for c in commands(site, "mouse") if c.linear < 0.0])
        await until(lambda: not site.simulation.docked)
        await page.wait_for_selector("#offer[hidden]", state="attached", timeout=PATIENCE_MS)
        halt = Stop(action_id="staff", stamp=time.time(), role="staff")
        # The stop must come while the key is held at the robot.
        await hold(page, "ArrowRight", lambda: [c for _, c in site.applied if c.angular < 0.0])
        site.do(lambda: site.kernel.stop(halt, CommandSender("mqtt", "staff"), time.monotonic()))
        await page.wait_for_selector("#alert[data-word='stuck.held']", timeout=PATIENCE_MS)
        await page.keyboard.up("ArrowRight")


@pytest.mark.nightly
async def test_map_zooms_turns_swaps_and_grows_while_the_keys_still_drive(browser):
    async with at(browser, "lounge-centre") as (page, site):
        await page.wait_for_selector("#map[data-marker-x]")
        whole = float(await page.get_attribute("#map", "data-view-scale"))
        await page.hover("#map")
        await page.mouse.wheel(0, -400)
        deadline = time.monotonic() + PATIENCE_MS / 1000
        while float(await page.get_attribute("#map", "data-view-scale")) < 1.5 * whole:
            assert time.monotonic() < deadline, "the map is not enlarged"
            await page.wait_for_timeout(50)
        await page.click("[data-action=map_follow]")
        await page.click("[data-action=map_turn]")
        await page.wait_for_selector("#map[data-view-turn^='0.0']")
        marker = [float(await page.get_attribute("#map", f"data-marker-{axis}")) for axis in "xy"]
        box = await page.locator("#map").bounding_box()
        assert math.dist(marker, (box["width"] / 2, box["height"] / 2)) < 2.0
        await page.click("[data-action=map_swap]")
        boxes = [await page.locator(one).bounding_box() for one in ("#map", "#video")]
        assert boxes[0]["width"] > boxes[1]["width"]
        await page.click("[data-action=map_large]")
        await page.wait_for_selector("#drive-page[data-map=large]")
        assert await page.is_visible("#video")
        await hold(page, "ArrowLeft", lambda: [c for _, c in site.applied if c.angular > 0.1])
        await page.keyboard.up("ArrowLeft")


@pytest.mark.nightly
async def test_turn_around_by_button_and_key_ends_nearly_opposite(browser):
    async with at(browser, "corridor-centre") as (page, site):
        for control in ("button", "key"):
            before = site.simulation.pose.theta
            if control == "button":
                await page.get_by_role("button", name="Turn around").click()
            else:
                await page.keyboard.press("u")
            await until(
                lambda before=before: abs(wrap_angle(site.simulation.pose.theta - before)) > 2.8
            )
            await until(lambda: stands(site))
            assert abs(wrap_angle(site.simulation.pose.theta - before)) < math.pi
        turns = len(site.applied)
        await page.keyboard.press("u")
        await until(lambda: [c for _, c in site.applied[turns:] if abs(c.angular) > 0.1])
        await page.keyboard.press("Space")
        await until(lambda: stands(site))


class RoutingPage(PresentRobotPage):
    """A robot that answers every route request with `points` and `reason`."""

    def __init__(self, **options: Any) -> None:
        able = (*CAPABILITIES, "goto", "dock")
        super().__init__(start="lab-before-door", capabilities=able, **options)
        self.points: tuple[tuple[float, float], ...] = ()
        self.reason = ""
        self.factsheet |= {"previewsRoutes": True}

    def _command(self, suffix: str, message: Any, sender: CommandSender, peer: str) -> None:
        if not isinstance(message, RouteRequest):
            super()._command(suffix, message, sender, peer)
            return
        points = self.points or ((message.x, message.y),)
        here = self.simulation.pose
        answer = {"points": ((here.x, here.y), *points), "reason": self.reason}
        if self.reason == "no_way":
            answer["points"] = ()
        known = {"request_id": message.request_id, "stamp": time.time()}
        self._say("route", RoutePreview(**known, **answer))


@asynccontextmanager
async def routing(browser: Browser) -> AsyncIterator[tuple[Page, RoutingPage]]:
    plan, _ = load_plan("office")
    with RoutingPage(camera=SceneSource(plan, 5.0)) as site:
        async with driven(browser, site, WIDE) as page:
            yield page, site


async def test_place_beside_a_pressed_wall_is_offered_with_its_route_and_driven_to(browser):
    async with routing(browser) as (page, site):
        here = site.simulation.pose
        site.points, site.reason = ((here.x, here.y - 0.8),), "in_wall"
        await page.mouse.move(*await place(page, 0.2, 0.62))  # the wall beside the door
        await page.mouse.down()
        await page.wait_for_selector("#overlay[data-shows=beside]", timeout=PATIENCE_MS)
        assert not await page.is_visible("#point-note-main"), "a button under the finger"
        await page.mouse.up()
        await page.get_by_role("button", name="Drive up to it").click()
        (goto,) = await until(lambda: actions(site, Goto))
        assert math.dist((goto.x, goto.y), site.points[0]) < 0.01
        await page.wait_for_selector("#point-note", state="hidden")


async def test_no_way_around_is_offered_where_the_robot_has_no_route(browser):
    async with routing(browser) as (page, site):
        site.reason = "no_way"
        await page.mouse.click(*await place(page, 0.2, 0.62))
        await page.wait_for_selector("#point-note[data-word='reason.no_way']", timeout=PATIENCE_MS)
        assert not await page.is_visible("#point-note-main")
        assert not actions(site, Goto)


async def test_marker_of_the_station_in_the_video_is_a_button_that_docks(browser):
    async with routing(browser) as (page, site):
        marker = page.get_by_role("button", name="Drive to the charging station and dock")
        # the robot looks for its station, which is marked when it is in sight
        turns = "() => document.getElementById('dock-marker').hidden"
        await page.keyboard.down("ArrowLeft")
        await page.wait_for_function(f"() => !({turns})()", timeout=PATIENCE_MS)
        await page.keyboard.up("ArrowLeft")
        await until(lambda: stands(site))
        await marker.focus()
        await page.keyboard.press("Enter")
        await until(lambda: actions(site, Dock))
