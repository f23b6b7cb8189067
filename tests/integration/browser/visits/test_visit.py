"""A whole visit with real parts: sign-up, page, video, drive, map, record; then the queue, and an
observer.
"""

import math
import re

import pytest
from PIL import Image, ImageColor
from playwright.sync_api import expect

from tests.support.media.photographs import keep_at_all_sizes
from tests.support.patience import PRESSED
from tests.support.sessions.site import wait_for

pytestmark = pytest.mark.browser
DOOR_Y = 2.075  # the laboratory's door, as the office's plan has it
TRAIL_COLOUR = (
    "getComputedStyle(document.getElementById('map')).getPropertyValue('--map-trail').trim()"
)
CENTROID = """() => {
  const canvas = document.getElementById('map');
  const colour = getComputedStyle(canvas).getPropertyValue('--map-robot');
  const [r, g, b] = colour.match(/\\w\\w/g).map((two) => parseInt(two, 16));
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let n = 0, x = 0, y = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b) < 24) {
      n += 1; x += (i / 4) % canvas.width + 0.5; y += Math.floor(i / 4 / canvas.width) + 0.5;
    }
  }
  const density = canvas.width / canvas.clientWidth;
  const { clientWidth: width, clientHeight: height } = canvas;
  return { n, x: x / n / density, y: y / n / density, width, height, ...canvas.dataset };
}"""


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "lab-before-door", "--seed", "3")


def marker_on_the_map(visitor) -> tuple[float, float, float]:
    """Return (x, y, stamp) of the arrow: the centre of its pixels, through the map's transform."""
    seen = visitor.page.evaluate(CENTROID)
    assert seen["n"] > 30, "no arrow was drawn"
    scale = float(seen["viewScale"])
    x = float(seen["viewX"]) + (seen["x"] - seen["width"] / 2) / scale
    y = float(seen["viewY"]) - (seen["y"] - seen["height"] / 2) / scale
    return x, y, float(seen["markerStamp"])


def keeps_a_picture_of_the_drive(page) -> None:
    """The downloaded picture shows the driven path in the colour of the page's map."""
    with page.expect_download() as download:
        page.get_by_role("button", name="Save a picture of your drive").click()
    assert download.value.suggested_filename == "giraff.png"
    with Image.open(download.value.path()) as picture:
        assert picture.width == 1200
        assert picture.height > 900
        trail = ImageColor.getrgb(page.evaluate(TRAIL_COLOUR))
        assert sum(pixel == trail for pixel in picture.convert("RGB").getdata()) > 100


def test_newcomer_signs_up_drives_through_a_door_and_leaves(site, visitor, giraff):
    anna = visitor()
    page = anna.page
    page.goto("/")
    page.locator(".hero").get_by_role("link", name="Sign up and drive").click()
    page.get_by_label(re.compile("^user ?name", re.IGNORECASE)).fill("anna")
    page.get_by_label(re.compile("^password", re.IGNORECASE)).fill("correct horse battery")
    page.get_by_role("button", name=re.compile("sign up|create", re.IGNORECASE)).click()
    expect(page).to_have_url(re.compile("/robots/giraff/"))
    # the third click, the form's included; six would be bearable
    page.get_by_role("button", name=re.compile("drive", re.IGNORECASE)).click()
    anna.wait_for_picture()
    before = anna.frames()
    assert anna.spread() > 8
    wait_for(lambda: anna.frames() > before + 15, 5, "a moving picture")

    anna.wait_for("link", "live")
    anna.hold("ArrowUp", lambda: giraff.truth().y < DOOR_Y - 0.8, 25, "the other side of the door")
    x, y, stamp = marker_on_the_map(anna)
    page.keyboard.up("ArrowUp")
    truth = giraff.at(stamp)
    assert math.hypot(x - truth.x, y - truth.y) <= 0.15
    assert giraff.truth().contacts == 0
    wait_for(lambda: abs(giraff.truth().linear) < 0.01, 5, "a robot at rest")

    page.get_by_role("button", name="Leave").click()
    page.locator("#card-main").click()
    anna.wait_for("phase", "ended")
    ended = lambda: [tuple(row[1:]) for row in site.sessions()]
    wait_for(lambda: ended() == [("anna", "ended", "completed")], 10, "the outcome")
    for _ in range(2):
        keeps_a_picture_of_the_drive(page)
    session = site.sessions()[0][0]
    states = wait_for(
        lambda: (found := site.states(session)) and len(found) > 20 and found, 10, "the record"
    )
    numbers = [state["seq"] for state in states]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    applied = [command for state in states for command in state.get("applied", [])]
    assert {command["method"] for command in applied} == {"keyboard"}
    # A page that was delayed by half a second used the other transport for a while.
    transports = [command["way"] for command in applied]
    assert transports.count("datachannel") > len(transports) / 2


@pytest.mark.nightly
def test_second_visitor_waits_in_the_queue_and_then_gets_the_robot(site, visitor, giraff):
    carl = visitor("carl").drive()
    dora = visitor("dora", viewport={"width": 390, "height": 844}).open(go=True)
    dora.wait_for("phase", "queued")
    expect(dora.page.locator("#card")).to_contain_text(re.compile(r"\d"))
    expect(carl.page.locator("#waiting")).to_be_visible()
    dora.page.wait_for_timeout(1000 * PRESSED)
    carl.leave()
    dora.wait_for("phase", "turn")
    dora.page.locator("#card-main").click()
    dora.wait_for_picture()
    dora.wait_for("role", "driver")
    dora.wait_for("link", "live")  # a page whose link is replaced releases all keys
    before = giraff.truth()
    dora.hold("ArrowLeft", lambda: abs(giraff.truth().theta - before.theta) > 0.1, 10, "a turn")
    dora.page.keyboard.up("ArrowLeft")
    dora.leave()


def test_second_page_of_a_driver_asks_before_it_ends_the_first_drive(visitor, giraff):
    here, there = visitor("fay").drive(), visitor("fay")
    tab = here.new_page()
    tab.goto("/robots/giraff/?go=1")
    title = "You are already driving in another tab of this browser"
    expect(tab.locator("#card-title")).to_have_text(title)
    tab.close()
    there.open(go=True)
    title = "You are already driving on another device or in another browser"
    expect(there.page.locator("#card-title")).to_have_text(title)
    expect(there.page.locator("#card-text")).to_have_text(re.compile(r"^Since \d\d:\d\d"))
    keep_at_all_sizes(there.page, "drives-elsewhere")
    for answer in ("Not now", "Drive here instead"):
        there.page.get_by_role("button", name="Drive here instead").click()
        expect(there.page.locator("#card-title")).to_have_text("End the drive there?")
        keep_at_all_sizes(there.page, "drives-elsewhere-asked")
        here.wait_for("phase", "driving")
        there.page.get_by_role("button", name=answer).click()
    there.wait_for("phase", "driving")
    here.wait_for("phase", "ended")
    expect(here.page.locator("#card-title")).to_have_text("You are driving on another page now")
    there.leave()
