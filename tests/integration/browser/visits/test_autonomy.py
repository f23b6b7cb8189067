"""Visitors and a robot that drives by itself: the dock, a point on the map, assistance, a lost
robot, the return to the station.
"""

import math
import re

import pytest
from playwright.sync_api import expect

from robots.api.geometry import wrap_angle
from robots.simulator.wire import CarryTo
from tests.support.agents.truth import SimulatorOperator
from tests.support.media.photographs import keep_at_all_sizes
from tests.support.patience import patient
from tests.support.sessions.site import wait_for

# robot and page have quicker tests, each by itself
pytestmark = [pytest.mark.browser, pytest.mark.nightly]
TRAIL = """() => {
  const canvas = document.getElementById('map');
  const colour = getComputedStyle(canvas).getPropertyValue('--map-trail');
  const own = colour.match(/\\w\\w/g).map((two) => parseInt(two, 16));
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let n = 0;
  for (let i = 0; i < data.length; i += 4) {
    n += own.every((value, j) => Math.abs(data[i + j] - value) < 8);
  }
  return n;
}"""


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--seed", "5")


@pytest.fixture(scope="module")
def operator(giraff):
    return SimulatorOperator(giraff.port)


def on_the_map(visitor, x, y):
    """Return where a point of the world is on the page, in CSS pixels."""
    view, box = visitor.marker(), visitor.page.locator("#map").bounding_box()
    left = box["width"] / 2 + (x - view["viewX"]) * view["viewScale"]
    top = box["height"] / 2 - (y - view["viewY"]) * view["viewScale"]
    return box["x"] + left, box["y"] + top


def tap(visitor, x, y):
    visitor.page.mouse.click(*on_the_map(visitor, x, y))


def show_place(visitor, truth):
    """Press on the map where the robot is, and drag in the direction of its heading."""
    x, y = on_the_map(visitor, truth.x, truth.y)
    visitor.page.mouse.move(x, y)
    visitor.page.mouse.down()
    visitor.page.mouse.move(x + 60 * math.cos(truth.theta), y - 60 * math.sin(truth.theta), steps=4)
    visitor.page.mouse.up()


def press(visitor, name):
    visitor.page.get_by_role("button", name=name, exact=True).click()


def offer(visitor, word, within=15.0):
    expect(visitor.page.locator("#offer")).to_have_attribute(
        "data-word", word, timeout=patient(within) * 1000
    )


def in_the_room(visitor, giraff):
    """Let a visitor take the robot, and wait until it has left its station."""
    driver = visitor.drive()
    wait_for(lambda: not giraff.truth().docked, 30, "the robot to leave its station")
    expect(driver.page.locator("#offer")).not_to_have_attribute(
        "data-word", "task.undock", timeout=patient(30) * 1000
    )
    return driver


def alert_of(visitor):
    return visitor.page.locator("#alert").get_attribute("data-word") or ""


def newest_state(site):
    return (site.states(site.sessions()[-1][0]) or [{}])[-1]


def test_robot_leaves_its_station_for_a_visitor_but_not_on_a_reload(visitor, giraff):
    zoe = visitor("zoe").drive()
    docked = giraff.truth()
    offer(zoe, "task.undock")
    expect(zoe.page.locator("#offer-progress")).to_be_visible()
    offer(zoe, "task.done.undock", within=30)
    truth = giraff.truth()
    assert not truth.docked
    assert abs(wrap_angle(truth.theta - docked.theta - math.pi)) < 0.2, "it faces the room"
    assert truth.contacts == docked.contacts
    press(zoe, "Go to…")
    press(zoe, "Return to station")
    offer(zoe, "dock.here", within=60)
    zoe.page.reload()
    zoe.wait_for_picture()
    offer(zoe, "dock.here")
    zoe.page.wait_for_timeout(2000)
    offer(zoe, "dock.here")
    assert giraff.truth().docked, "a robot that was driven into the station stays there"


def test_button_leaves_the_dock_and_pressing_forward_there_explains_why(visitor, giraff):
    anna = visitor("anna").drive()
    offer(anna, "task.undock")
    press(anna, "Cancel drive")
    offer(anna, "dock.here")
    keep_at_all_sizes(anna.page, "dock")
    anna.page.keyboard.down("ArrowUp")
    expect(anna.page.locator("#alert")).to_have_attribute("data-word", "alert.docked_forward")
    anna.page.keyboard.up("ArrowUp")
    press(anna, "Leave station")
    offer(anna, "task.undock")
    offer(anna, "task.done.undock", within=25)
    assert not giraff.truth().docked


def test_robot_goes_where_the_map_was_tapped(site, visitor, giraff):
    ben = in_the_room(visitor("ben"), giraff)
    goal = (2.6, 4.2)
    tap(ben, *goal)
    keep_at_all_sizes(ben.page, "goal")
    assert giraff.truth().linear == 0.0, "a tap alone moves nothing"
    tap(ben, *goal)
    press(ben, "Go here")
    offer(ben, "task.goto")
    wait_for(lambda: abs(giraff.truth().linear) > 0.1, 15, "a drive")
    keep_at_all_sizes(ben.page, "going")
    offer(ben, "task.done.goto", within=60)
    truth = giraff.truth()
    assert math.hypot(truth.x - goal[0], truth.y - goal[1]) <= 0.3
    assert truth.contacts == 0
    modes = lambda: {state.get("mode") for state in site.states(site.sessions()[-1][0])}
    wait_for(lambda: "goto" in modes(), 5, "the record of it")


def test_key_overrides_a_drive_to_a_place_of_the_menu(visitor, giraff):
    cora = in_the_room(visitor("cora"), giraff)
    press(cora, "Go to…")
    keep_at_all_sizes(cora.page, "menu")
    press(cora, "Laboratory")
    offer(cora, "task.place")
    press(cora, "Go to…")
    press(cora, "Corridor, west end")
    wait_for(lambda: math.hypot(giraff.truth().linear, giraff.truth().angular) > 0.1, 15, "a drive")
    cora.page.keyboard.down("ArrowLeft")
    offer(cora, "task.yours")
    before = giraff.truth().theta
    turned = lambda: math.remainder(giraff.truth().theta - before, math.tau)
    cora.hold("ArrowLeft", lambda: turned() > 0.2, 10, "a turn to the left")
    cora.page.keyboard.up("ArrowLeft")


def test_robot_without_a_path_says_why_and_offers_a_next_step(visitor, giraff):
    dan = in_the_room(visitor("dan"), giraff)
    tap(dan, 6.0, -1.0)  # below the southernmost wall
    press(dan, "Go here")
    offer(dan, "task.failed.goto")
    expect(dan.page.locator("#offer-detail")).to_contain_text("outside the map")
    keep_at_all_sizes(dan.page, "blocked")
    press(dan, "Try again")
    offer(dan, "task.failed.goto")
    press(dan, "Drive yourself")
    expect(dan.page.locator("#offer")).to_be_hidden()
    assert dan.page.evaluate("document.activeElement.id") == "viewport"


def test_chosen_assistance_is_applied_and_explains_itself(site, visitor, giraff):
    eva = in_the_room(visitor("eva"), giraff)
    press(eva, "Steers around them")
    expect(eva.page.locator("[data-action=assist-steer]")).to_have_attribute("aria-pressed", "true")
    level = lambda: newest_state(site).get("assist")
    wait_for(lambda: level() == "steer", 10, "the level in the robot's record")
    contacts = giraff.truth().contacts
    explained = lambda: re.match(r"assist\.(slow|stop|steer)", alert_of(eva))
    eva.hold("ArrowUp", explained, 20, "why it slows down")
    keep_at_all_sizes(eva.page, "assisted")
    eva.page.keyboard.up("ArrowUp")
    assert giraff.truth().contacts == contacts


def test_lost_robot_is_placed_on_the_map(visitor, giraff, operator):
    fay = in_the_room(visitor("fay"), giraff)
    assert operator.wish(CarryTo(8.6, 4.4, 1.57)) == ""
    fay.hold("ArrowLeft", lambda: alert_of(fay) == "alert.lost", 30, "a lost robot")
    press(fay, "Set position")  # at once, before it finds its pose by itself
    fay.page.keyboard.up("ArrowLeft")
    show_place(fay, giraff.truth())
    keep_at_all_sizes(fay.page, "placing")
    press(fay, "Place robot here")
    offer(fay, "task.done.relocalize", within=20)
    expect(fay.page.locator("#alert")).to_be_hidden()


def test_robot_returns_to_its_station_before_the_next_visitor(site, visitor, giraff, operator):
    gil = in_the_room(visitor("gil"), giraff)
    hans, stranger = visitor("hans").open(go=True), visitor()
    assert operator.wish(CarryTo(1.9, 5.2, 0.0)) == ""
    press(gil, "Go to…")
    press(gil, "Set the robot's position")
    show_place(gil, giraff.truth())
    press(gil, "Place robot here")
    offer(gil, "task.done.relocalize", within=20)
    hans.wait_for("phase", "queued")
    site.django("from robots.models import Robot; Robot.objects.update(returns_home=True)")
    stranger.page.goto("/")  # before it starts, as the path is short
    gil.leave()
    expect(hans.page.locator("#card")).to_have_attribute(
        "data-card", "queued.returning", timeout=40_000
    )
    expect(stranger.page.locator("[data-robot=giraff]")).to_contain_text("Returning to its station")
    keep_at_all_sizes(hans.page, "queue")
    hans.wait_for("phase", "turn", within=60)
    assert giraff.truth().docked
    seen = hans.page.evaluate(TRAIL)
    assert seen > 30, "the path was shown while he waited"
    hans.page.locator("#card-main").click()
    hans.wait_for_picture()
    wait_for(lambda: hans.page.evaluate(TRAIL) < seen / 2, 5, "a map without the paths of others")
    offer(hans, "task.undock")
    site.django("from robots.models import Robot; Robot.objects.update(returns_home=False)")
