"""A whole visit with each adapter: page, drive, map, record; and an architecture that is killed
during the drive.
"""

import asyncio
import contextlib
import json
import math
import time
from http.cookiejar import Cookie
from itertools import pairwise

import pytest
from playwright.sync_api import expect, sync_playwright

from experiments.bots.browser import Browser
from experiments.bots.cockpit import Cockpit
from experiments.bots.driver import STAND, SpeedSetting
from tests.support.architectures.ros2_robot import DISCOVERY
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.patience import patient
from tests.support.sessions.site import LOOPBACK, PRESENCE, running_site, wait_for
from tests.support.sessions.site_robots import ARCHITECTURES, robot_behind

pytestmark = [pytest.mark.broker, pytest.mark.long, pytest.mark.nightly]
AHEAD = SpeedSetting(0.3, 0.0)
LOST = "adapter_lost: "
FAULT = "The robot reports a fault and has stopped."


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv(*DISCOVERY)
        with running_site(tmp_path_factory.mktemp("adapters")) as site:
            yield site


def signed_in(site, name) -> Browser:
    browser = Browser(site.url)
    value = site.sign_in(name)
    unset = dict.fromkeys(("port", "expires", "comment", "comment_url"))
    flags = ("port_specified", "domain_specified", "domain_initial_dot", "secure")
    cookie = {"version": 0, "name": "sessionid", "value": value, "domain": LOOPBACK, "path": "/"}
    cookie |= unset | dict.fromkeys(flags, False)
    browser.jar.set_cookie(Cookie(**cookie, path_specified=True, discard=True, rest={}))
    return browser


def card(browser, robot) -> dict:
    """Return a robot's card in the list of robots."""
    robots = json.loads(browser.open("/robots.json").body)["robots"]
    return next(one for one in robots if one["name"] == robot)


async def until(cockpit, condition, seconds, what) -> None:
    assert await cockpit.until(condition, patient(seconds)), (
        f"{what} did not come within {seconds} s; {cockpit.view}"
    )


async def takes_the_robot(cockpit) -> None:
    """Request the robot, again while the site does not know yet that it is online."""
    view, deadline = cockpit.view, time.monotonic() + patient(20)
    while not view.granted:
        assert time.monotonic() < deadline, f"the robot was not granted: {view.refused}"
        assert view.refused in {"", "offline"}
        view.refused = ""
        cockpit.take()
        await cockpit.until(lambda: view.granted or view.refused, 5.0)
        await asyncio.sleep(0.0 if view.granted else 0.5)


@contextlib.asynccontextmanager
async def whole_visit(cockpit):
    """Take the robot, and leave in any case, so that the next visitor does not wait."""
    view = cockpit.view
    try:
        await takes_the_robot(cockpit)
        seen = lambda: view.granted and view.frames and view.state and view.localized
        await until(cockpit, seen, 30, "a picture and a pose")
        free = lambda: view.state.safety.inhibited is None
        await until(cockpit, free, 10, "a robot that can be driven")
        yield
    finally:
        cockpit.leave()
        await until(cockpit, lambda: view.ended, 20, "the end")


def lost(view) -> str:
    found = [error.removeprefix(LOST) for error in view.state.errors if error.startswith(LOST)]
    return found[0] if found else ""


def off_the_map(view, robot) -> float:
    """Return the metres between the pose on the page and the true one."""
    x, y = robot.place()
    return math.hypot(view.pose.x - x, view.pose.y - y)


def has_gone(robot, metres):
    """Return a condition: the robot has moved this far from its present place."""
    here = robot.place()
    return lambda: math.dist(robot.place(), here) > metres


async def pushes(cockpit, reached, what) -> None:
    """Drive ahead until the condition is true; release the controls while it is inhibited."""
    deadline = time.monotonic() + patient(20)
    while not reached():
        assert time.monotonic() < deadline, f"{what} did not come; {cockpit.view}"
        cockpit.steer(AHEAD)
        await cockpit.until(lambda: reached() or cockpit.view.state.safety.inhibited, 4.0)
        if cockpit.view.state.safety.inhibited:
            cockpit.steer(STAND)
            await cockpit.until(lambda: cockpit.view.state.safety.inhibited is None, 4.0)


async def stands_where_the_map_has_it(cockpit, robot) -> None:
    cockpit.steer(STAND)
    is_there = lambda: robot.speed() == 0.0 and off_the_map(cockpit.view, robot) < 0.15
    await until(cockpit, is_there, 15, "its pose on the map")


async def loses_and_finds_its_architecture(cockpit, robot, browser) -> None:
    view = cockpit.view
    await pushes(cockpit, lambda: robot.speed() > 0.15, "a robot at speed")
    await asyncio.to_thread(robot.kill)
    await until(cockpit, lambda: robot.speed() == 0.0, 5, "a robot at rest despite its driver")
    await until(cockpit, lambda: lost(view), 10, "the reason")
    assert len(lost(view)) > 10
    assert view.state.safety.inhibited == "fault"
    stopped = lambda: (it := card(browser, robot.series))["state"] == "stopped" and it
    shown = await asyncio.to_thread(wait_for, stopped, 10, "a robot that is not available")
    assert (shown["label"], shown["drives"]) == ("Not available", False)
    assert robot.speed() == 0.0
    cockpit.steer(STAND)
    await asyncio.to_thread(robot.revive)
    is_back = lambda: not lost(view) and view.state.safety.inhibited is None
    await until(cockpit, is_back, 30, "the robot after the release of the controls")
    await pushes(cockpit, has_gone(robot, 0.1), "a robot that moves again")
    cockpit.steer(STAND)
    busy = lambda: card(browser, robot.series)["state"] == "busy"
    await asyncio.to_thread(wait_for, busy, 10, "a robot that is in use")


def is_recorded_whole(site, session) -> None:
    key = session.replace("-", "")
    closed = "SELECT 1 FROM telepresence_sessions_session WHERE id = ? AND closed_at IS NOT NULL"
    kinds = "SELECT type FROM telepresence_sessions_sessionevent WHERE session_id = ?"

    def complete():
        return site.rows(closed, key) and site.states(session)

    states = wait_for(complete, 20, "the record")
    assert all(b["seq"] == a["seq"] + 1 for a, b in pairwise(states))
    applied = [command for state in states for command in state.get("applied", ())]
    assert {(command["method"], command["way"]) for command in applied} == {("keyboard", "mqtt")}
    places = [(state["pose"]["x"], state["pose"]["y"]) for state in states]
    assert max(math.dist(place, places[0]) for place in places) > 0.3
    assert any(error.startswith(LOST) for state in states for error in state.get("errors", ()))
    assert {("adapter_lost",), ("adapter_back",)} <= set(site.rows(kinds, key))


@pytest.mark.parametrize("adapter", ARCHITECTURES)
async def test_recorded_drive_by_page_and_map_survives_a_loss_of_the_architecture(
    adapter, site, tmp_path
):
    browser = await asyncio.to_thread(signed_in, site, f"visitor-of-{adapter}")
    with robot_behind(adapter, site, tmp_path) as robot:
        page = await asyncio.to_thread(browser.open, f"/robots/{robot.series}/")
        config = page.page.json["config"]
        plan = json.loads((await asyncio.to_thread(browser.open, config["floorplan"])).body)
        async with Cockpit(browser, config["socket"], "keyboard") as cockpit, whole_visit(cockpit):
            view = cockpit.view
            await pushes(cockpit, has_gone(robot, 0.4), "a robot that moves")
            await stands_where_the_map_has_it(cockpit, robot)
            assert 0.0 < view.pose.x - plan["origin"][0] < plan["width"] * plan["resolution"]
            assert 0.0 < view.pose.y - plan["origin"][1] < plan["height"] * plan["resolution"]
            await loses_and_finds_its_architecture(cockpit, robot, browser)
        assert view.ended.outcome == "completed"
        is_recorded_whole(site, view.session)


MARKER = """() => {
  const map = document.getElementById("map");
  return { ...map.dataset, width: map.clientWidth, height: map.clientHeight };
}"""


def marker(page) -> tuple[float, float]:
    """Return where the map draws the robot, in metres."""
    seen = page.evaluate(MARKER)
    scale = float(seen["viewScale"])
    x = float(seen["viewX"]) + (float(seen["markerX"]) - seen["width"] / 2) / scale
    return x, float(seen["viewY"]) - (float(seen["markerY"]) - seen["height"] / 2) / scale


def is_free(site, robot) -> bool:
    """Tell whether the robot can be driven, by its last report."""
    ((report,),) = site.rows(f"SELECT report {PRESENCE} WHERE name = ?", robot.series)
    return json.loads(report)["safety"].get("inhibited") is None


def holds_the_key(page, site, robot, reached, what) -> None:
    """Hold the key until the condition is true; as `pushes`, with a keyboard."""
    deadline = time.monotonic() + patient(20)
    while not reached():
        assert time.monotonic() < deadline, f"{what} did not come"
        page.keyboard.up("ArrowUp")
        wait_for(lambda: is_free(site, robot), 10, "a robot that can be driven")
        page.keyboard.down("ArrowUp")
        waited = time.monotonic() + 4.0
        while not reached() and time.monotonic() < waited:
            page.wait_for_timeout(50)


@pytest.mark.soak
def test_drive_in_a_real_browser(site, tmp_path):
    with (
        robot_behind("moos", site, tmp_path) as robot,
        sync_playwright() as playwright,
        chromium(playwright) as browser,
    ):
        visitor = Visitor(browser, site, "visitor-in-chromium").drive(robot.series)
        page, alert = visitor.page, visitor.page.locator("#alert")
        visitor.wait_for("link", "live")
        holds_the_key(page, site, robot, has_gone(robot, 0.4), "a robot that moves")
        page.keyboard.up("ArrowUp")
        is_there = lambda: math.dist(marker(page), robot.place()) < 0.15
        wait_for(lambda: robot.speed() == 0.0 and is_there(), 10, "its pose on the map")
        holds_the_key(page, site, robot, lambda: robot.speed() > 0.15, "a robot at speed")
        robot.kill()
        wait_for(lambda: robot.speed() == 0.0, 5, "a robot at rest despite its driver")
        expect(alert).to_have_text(FAULT, timeout=patient(10) * 1000)
        page.keyboard.up("ArrowUp")
        robot.revive()
        expect(alert).not_to_have_text(FAULT, timeout=patient(20) * 1000)
        holds_the_key(page, site, robot, has_gone(robot, 0.1), "a robot that moves again")
        visitor.leave()
        assert visitor.problems == []
