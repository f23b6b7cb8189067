"""Driving by pressing on the video, and with other controllers, in a real Chromium, with the scene
as the robot's camera sees it.
"""

import math
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from playwright.async_api import Browser, Page

from robots.agent.safety.permissions import CommandSender
from robots.api.geometry import wrap_angle
from robots.api.messages import Goto, Stop, VelocityCommand
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
        await page.wait_for_selector("#alert[data-word='point.sky']")
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


async def test_reason_for_a_refused_press_stays_readable_while_driving_on(browser):
    async with at(browser, "lab-before-door") as (page, site):
        await page.mouse.click(*await place(page, 0.5, 0.85))
        await until(lambda: [c for _, c in site.applied if c.linear > 0.05])
        await page.mouse.click(*await place(page, 0.2, 0.62))  # the wall beside the door
        await page.wait_for_selector("#alert[data-word^='point.']")
        shown, drawn = time.monotonic(), 0.0
        while await page.is_visible("#alert[data-word^='point.']"):
            if await page.get_attribute("#overlay", "data-shows") == "blocked":
                drawn = time.monotonic()
            assert time.monotonic() - shown < PATIENCE_MS / 1000
            await page.wait_for_timeout(200)
        assert time.monotonic() - shown > 7.0
        assert drawn - shown > 6.0


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


@pytest.mark.nightly
async def test_blocked_press_is_shown_and_the_robot_offers_to_drive_around(browser):
    plan, _ = load_plan("office")
    scene = SceneSource(plan, 5.0)
    able = (*CAPABILITIES, "goto")
    with PresentRobotPage(camera=scene, start="lab-before-door", capabilities=able) as site:
        async with driven(browser, site, WIDE) as page:
            # a wall of the laboratory, beside its door
            await page.mouse.click(*await place(page, 0.2, 0.62))
            await page.wait_for_selector("#overlay[data-shows=blocked]", timeout=PATIENCE_MS)
            await page.get_by_role("button", name="Drive around it").click()
            (goto,) = await until(lambda: actions(site, Goto))
            assert None not in (goto.x, goto.y)
            assert await page.get_by_role("button", name="Drive around it").count() == 0
