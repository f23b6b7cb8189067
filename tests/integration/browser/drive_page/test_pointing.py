"""Driving by pressing on the picture, and the other ways of the hand, in a real Chromium: the
robot's scene is drawn as its camera sees it.
"""

import math
import time

import pytest
from playwright.async_api import Page

from robots.agent.safety.permissions import CommandSender
from robots.api.geometry import wrap_angle
from robots.api.messages import Goto, Stop
from robots.world.sites import load_plan
from tests.support.browsers.drive_page import UPRIGHT, WIDE, hold, opened, stands, stops
from tests.support.browsers.drive_page import until as until_within
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.browsers.present_robot_page import CAPABILITIES, PresentRobotPage
from tests.support.browsers.scripted_visitor import PAD
from tests.support.media.scene_source import SceneSource
from tests.support.patience import patient

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
PATIENCE = 40.0  # s: the page's own seconds are slow on a busy computer


def site_at(start: str) -> FakeRobotPage:
    plan, _ = load_plan("office")
    return FakeRobotPage(SceneSource(plan, 5.0), start=start)


async def until(condition):
    return await until_within(condition, PATIENCE)


async def driving(page: Page) -> None:
    await page.wait_for_selector(
        "#drive-page[data-playing][data-link=live]", timeout=1000 * PATIENCE
    )


async def place(page: Page, across: float, down: float) -> tuple[float, float]:
    """Return a place in the picture, in CSS pixels of the page, from shares of its width and
    height.
    """
    box = await page.locator("#video").bounding_box()
    assert box is not None
    return box["x"] + across * box["width"], box["y"] + down * box["height"]


async def goal(page: Page) -> tuple[float, float]:
    await page.wait_for_selector("#overlay[data-shows=goal]", timeout=1000 * PATIENCE)
    x, y = (await page.get_attribute("#overlay", "data-goal")).split()
    return float(x), float(y)


async def test_a_press_shows_the_way_its_release_drives_or_turns_and_what_cannot_be_done_is_said(
    browser,
):
    with site_at("corridor-centre") as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            await page.mouse.click(*await place(page, 0.5, 0.04))
            await page.wait_for_selector("#alert[data-word='point.sky']")
            assert not site.applied
            await page.mouse.move(*await place(page, 0.5, 0.8))
            await page.mouse.down()
            x, y = await goal(page)
            await page.mouse.up()
            await until(
                lambda: [c for _, c in site.applied if c.method == "mouse" and c.linear > 0.05]
            )
            await until(lambda: stands(site))
            assert math.hypot(site.simulation.pose.x - x, site.simulation.pose.y - y) < 0.35
            before = site.simulation.pose.theta
            await page.mouse.click(*await place(page, 0.02, 0.6))
            await until(lambda: wrap_angle(site.simulation.pose.theta - before) > 0.4)
            await until(lambda: stands(site))
            assert {c.method for _, c in site.applied} == {"mouse"}
            assert not stops(site)


async def test_why_a_press_is_refused_stays_until_it_can_be_read_although_the_page_drives_on(
    browser,
):
    with site_at("lab-before-door") as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            await page.mouse.click(*await place(page, 0.5, 0.85))
            await until(lambda: [c for _, c in site.applied if c.linear > 0.05])
            await page.mouse.click(*await place(page, 0.2, 0.62))  # the wall beside the door
            await page.wait_for_selector("#alert[data-word^='point.']")
            shown, drawn = time.monotonic(), 0.0
            while await page.is_visible("#alert[data-word^='point.']"):
                if await page.get_attribute("#overlay", "data-shows") == "blocked":
                    drawn = time.monotonic()
                assert time.monotonic() - shown < PATIENCE
                await page.wait_for_timeout(200)
            assert time.monotonic() - shown > 7.0
            assert drawn - shown > 6.0


async def test_a_key_takes_over_from_the_mouse_and_a_gamepad_from_the_key_and_pulling_it_out_stops(
    browser,
):
    with site_at("corridor-centre") as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            await page.mouse.click(*await place(page, 0.5, 0.75))
            await until(
                lambda: [c for _, c in site.applied if c.method == "mouse" and c.linear > 0.0]
            )
            await hold(
                page,
                "ArrowLeft",
                lambda: [c for _, c in site.applied if c.method == "keyboard" and c.angular > 0.1],
                PATIENCE,
            )
            await page.evaluate(PAD)
            await page.wait_for_selector("#alert[data-word='pad.left']")
            await page.evaluate("() => { stub.axes = [1, 0, 0, 0]; }")
            await until(
                lambda: (
                    site.applied[-1][1].method == "gamepad" and site.applied[-1][1].angular < -0.1
                )
            )
            await page.evaluate(
                "() => window.dispatchEvent(Object.assign(new Event('gamepaddisconnected'), {"
                " gamepad: stub }))"
            )
            await until(
                lambda: [
                    action for action in site.said("command/action") if isinstance(action, Stop)
                ]
            )
            await page.wait_for_selector("#alert[data-word='pad.gone']")
            await page.keyboard.up("ArrowLeft")
            await until(
                lambda: (
                    [
                        event.data["there"]
                        for event in site.said("page/event")
                        if event.type == "gamepad"
                    ]
                    == [True, False]
                )
            )


async def test_a_finger_that_is_held_on_the_picture_drives_and_lifting_it_stops(browser):
    with site_at("corridor-centre") as site:
        async with opened(browser, site, UPRIGHT, query="?go=1") as page:
            await driving(page)
            x, y = await place(page, 0.5, 0.7)
            touches = await page.context.new_cdp_session(page)
            await touches.send(
                "Input.dispatchTouchEvent",
                {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]},
            )
            await until(
                lambda: [c for _, c in site.applied if c.method == "touch" and c.linear > 0.05]
            )
            await touches.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
            await until(lambda: stands(site))


@pytest.mark.nightly
async def test_at_the_dock_the_large_button_drives_out_and_a_robot_that_does_not_move_says_why(
    browser,
):
    with site_at("dock") as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            await page.keyboard.down("ArrowUp")
            await page.wait_for_selector(
                "#alert[data-word='alert.docked_forward']", timeout=1000 * PATIENCE
            )
            await page.keyboard.up("ArrowUp")
            await page.click("#offer-main:has-text('Leave station')")
            await page.wait_for_selector("#offer[data-word='task.undock']")
            await until(
                lambda: [c for _, c in site.applied if c.linear < 0.0 and c.method == "mouse"]
            )
            await until(lambda: not site.simulation.docked)
            await page.wait_for_selector(
                "#offer[hidden]", state="attached", timeout=1000 * PATIENCE
            )
            halt = Stop(action_id="staff", stamp=time.time(), role="staff")
            # A stop that comes a second before the key is felt at the robot finds nobody who holds
            # one.
            await hold(page, "ArrowRight", lambda: [c for _, c in site.applied if c.angular < 0.0])
            site.do(
                lambda: site.kernel.stop(halt, CommandSender("mqtt", "staff"), time.monotonic())
            )
            await page.wait_for_selector("#alert[data-word='stuck.held']", timeout=1000 * PATIENCE)
            await page.keyboard.up("ArrowRight")


@pytest.mark.nightly
async def test_the_map_is_looked_around_on_swapped_and_made_large_and_the_keys_still_drive(browser):
    with site_at("lounge-centre") as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            await page.wait_for_selector("#map[data-marker-x]")
            whole = float(await page.get_attribute("#map", "data-view-scale"))
            await page.hover("#map")
            await page.mouse.wheel(0, -400)
            deadline = time.monotonic() + patient(PATIENCE)
            while float(await page.get_attribute("#map", "data-view-scale")) < 1.5 * whole:
                assert time.monotonic() < deadline, "the map is not made larger"
                await page.wait_for_timeout(50)
            await page.click("[data-action=map_follow]")
            await page.click("[data-action=map_turn]")
            await page.wait_for_selector("#map[data-view-turn^='0.0']")
            marker = [
                float(await page.get_attribute("#map", f"data-marker-{axis}")) for axis in "xy"
            ]
            box = await page.locator("#map").bounding_box()
            assert math.dist(marker, (box["width"] / 2, box["height"] / 2)) < 2.0
            await page.click("[data-action=map_swap]")
            assert (await page.locator("#map").bounding_box())["width"] > (
                await page.locator("#video").bounding_box()
            )["width"]
            await page.click("[data-action=map_large]")
            await page.wait_for_selector("#drive-page[data-map=large]")
            assert await page.is_visible("#video")
            await hold(
                page, "ArrowLeft", lambda: [c for _, c in site.applied if c.angular > 0.1], PATIENCE
            )
            await page.keyboard.up("ArrowLeft")


@pytest.mark.nightly
async def test_turn_around_by_button_and_by_key_ends_nearly_opposite_and_a_key_ends_it(browser):
    with site_at("corridor-centre") as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            for way in ("button", "key"):
                before = site.simulation.pose.theta
                if way == "button":
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
async def test_what_blocks_a_pressed_point_is_shown_and_the_robot_offers_to_drive_around_it(
    browser,
):
    plan, _ = load_plan("office")
    scene = SceneSource(plan, 5.0)
    able = (*CAPABILITIES, "goto")
    with PresentRobotPage(camera=scene, start="lab-before-door", capabilities=able) as site:
        async with opened(browser, site, WIDE, query="?go=1") as page:
            await driving(page)
            # a wall of the laboratory, beside its door
            await page.mouse.click(*await place(page, 0.2, 0.62))
            await page.wait_for_selector("#overlay[data-shows=blocked]", timeout=1000 * PATIENCE)
            await page.get_by_role("button", name="Drive around it").click()
            asked = await until(
                lambda: [a for a in site.said("command/action") if isinstance(a, Goto)]
            )
            assert asked[0].x is not None
            assert asked[0].y is not None
            assert await page.get_by_role("button", name="Drive around it").count() == 0
