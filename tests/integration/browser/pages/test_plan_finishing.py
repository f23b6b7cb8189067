"""A plan is finished on the map in a real browser: with the mouse, a finger, and keys."""

import json

import numpy as np
import pytest
from playwright.sync_api import expect

from robots.world.grid import write_grid
from tests.support.agents.mapped_building import building, mapped
from tests.support.browsers.first_time_user import drag_with_finger
from tests.support.media.photographs import SETTLED, keep
from tests.support.programs.server import web_alone
from tests.support.sessions.site import wait_for

pytestmark = pytest.mark.browser
SIZES = {"desktop": (1366, 768), "tablet": (820, 1180), "phone": (390, 844)}
SETUP = """
from pathlib import Path
from accounts.models import User
from robots.plans.drafts import propose, read_map, store_site
User.objects.filter(username={name!r}).update(is_staff=True, is_superuser=True)
grid = read_map(Path({map!r}), occupied=None, free=None)
print(store_site(propose(grid, 'hall', 'Hall'), grid)[0].pk)
"""
STORED = """
import json
from robots.models import FloorPlan
print(json.dumps(FloorPlan.objects.get(name='hall').plan))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with web_alone(tmp_path_factory.mktemp("site")) as site:
        yield site


@pytest.fixture
def plan(site, visitor, tmp_path):
    """Open the page of a new proposal."""
    write_grid(mapped(building(furnished=True), np.random.default_rng(2)), tmp_path)

    def open_it(name: str, **context):
        site.sign_in(name)
        code = SETUP.format(name=name, map=str(tmp_path / "map.yaml"))
        row = site.django(code).strip()
        page = visitor(name, **context).page
        page.goto(f"/admin/robots/floorplan/{row}/finish/")
        expect(page.locator("#plan-map .course__handle").first).to_be_visible()
        return page

    return open_it


def stored(site) -> dict:
    return json.loads(site.django(STORED))


def value(page, name: str) -> float:
    return float(page.locator(f'[name="{name}"]').input_value())


def middle(page, label: str) -> tuple[float, float]:
    handle = page.get_by_role("button", name=label).first
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@pytest.mark.nightly
def test_mouse_and_keys_finish_a_plan(plan, site):
    page = plan("pia", viewport={"width": 1366, "height": 768})
    box = page.locator("#plan-map").bounding_box()
    assert box["width"] > 850  # more than two thirds of the content
    assert box["y"] + box["height"] <= 768
    expect(page.get_by_role("button", name="Save the plan")).to_be_in_viewport()
    expect(page.locator(".plan__parts input[inputmode=decimal]:visible")).to_have_count(0)
    page.locator('[name="rooms.0.title"]').fill("Laboratory")
    expect(page.locator("#plan-map .course__name").first).to_have_text("Laboratory")
    before = value(page, "places.0.x"), value(page, "places.0.y")
    title = page.locator('[name="places.0.title"]').input_value()
    x, y = middle(page, f"{title}: ")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 10, y, steps=2)
    page.mouse.move(x + 25, y - 15, steps=3)
    page.mouse.up()
    assert value(page, "places.0.x") > before[0]
    assert value(page, "places.0.y") > before[1]
    dragged = value(page, "places.0.x")
    page.get_by_role("button", name=f"{title}: ").focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Shift+ArrowRight")
    assert value(page, "places.0.x") == pytest.approx(dragged - 0.08)
    places = page.locator("details", has=page.locator('[data-part="places.0"]'))
    expect(places).to_have_attribute("open", "")  # its fields are shown since it was pressed
    expect(page.locator("#plan-map .plan__name", has_text=title)).to_be_visible()
    page.get_by_label("Add a place", exact=True).check()
    box = page.locator("#plan-map").bounding_box()
    page.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.75)
    expect(page.locator('[data-kind="place"]')).to_have_count(4)
    expect(page.get_by_text("Not saved yet.")).to_be_visible()
    page.get_by_role("button", name="Save the plan").click()
    expect(page.get_by_text("Saved. To simulate a robot here")).to_be_visible()
    assert stored(site)["rooms"][0]["title"] == "Laboratory"
    assert len(stored(site)["places"]) == 4
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(SETTLED)
        keep(page, f"finish-plan-{size}")
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"the page is wider than {size}"


def test_finger_moves_an_opening_on_a_phone(plan):
    page = plan("pau", viewport={"width": 390, "height": 844}, has_touch=True)
    before = value(page, "openings.0.x")
    title = page.locator('[name="openings.0.title"]').input_value()
    x, y = middle(page, f"{title}: ")
    drag_with_finger(page, x, y, -20)
    wait_for(lambda: value(page, "openings.0.x") < before - 0.2, 5, "an end that was moved")
