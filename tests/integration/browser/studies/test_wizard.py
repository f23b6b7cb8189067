"""A hidden operator in a real browser drives and speaks for a simulated robot, in which another
browser is the participant.
"""

import json

import pytest
from playwright.sync_api import expect

from tests.support.media.photographs import keep
from tests.support.sessions.site import wait_for
from tests.support.studies.task_study import HIDDEN, begin_wizard_study

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "dock", "--seed", "3")


def recorded(site) -> list[tuple[str, dict]]:
    rows = site.rows(
        "SELECT type, data FROM telepresence_sessions_sessionevent WHERE type LIKE 'wizard%' ORDER"
        " BY received_at"
    )
    return [(kind, json.loads(data)) for kind, data in rows]


def test_operator_speaks_and_drives_by_script_and_by_hand(site, visitor, giraff):
    begin_wizard_study(site, "ana", "olga")
    ana, olga = visitor("ana"), visitor("olga", viewport={"width": 1366, "height": 768})
    ana.page.goto(f"/studies/{HIDDEN}/step/")
    ana.page.get_by_role("link", name="Go to the robot").click()
    ana.page.get_by_role("button", name="Drive Giraff").click()
    ana.wait_for_picture()
    # the participant cannot drive
    ana.page.keyboard.down("ArrowDown")

    page = olga.page
    page.goto(f"/studies/{HIDDEN}/wizard/")
    page.get_by_role("button", name="Operate the robot").click()
    wizard = page.locator("#wizard")
    expect(wizard).to_have_attribute("data-state", "operating", timeout=20_000)
    wait_for(lambda: olga.frames() > 3, 20, "the operator's picture")

    page.keyboard.press("1")
    expect(page.locator("[data-step=hello]")).to_have_attribute("data-state", "done", timeout=9000)
    page.keyboard.press("3")
    expect(page.locator("#notice")).to_have_text("Recorded as a deviation: out of order.")
    reached = lambda: [kind for kind, _ in recorded(site)].count("wizard_reached")
    wait_for(lambda: reached() == 2, 20, "the robot to have both steps")
    olga.hold("ArrowDown", lambda: has_left(site), 30, "the way out of the station")
    page.keyboard.up("ArrowDown")
    for width, height in ((1366, 768), (820, 1180), (390, 844), (844, 390)):
        page.set_viewport_size({"width": width, "height": height})
        expect(page.get_by_role("button", name="Stop Space")).to_be_in_viewport()
        page.locator("#wizard").evaluate("element => element.scrollIntoView()")
        keep(page, f"wizard-{width}x{height}")
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0, f"{width}x{height} scrolls sideways"
    page.keyboard.press("Space")
    page.close()
    wait_for(lambda: "wizard_lost" in dict(recorded(site)), 20, "the loss of the operator")
    events = recorded(site)
    assert ("wizard_by_hand", "keyboard") in [(kind, data.get("method")) for kind, data in events]
    steps = [(data["step"], data["deviation"]) for kind, data in events if kind == "wizard_step"]
    assert steps == [("hello", ""), ("leave", "out_of_order")]
    latencies = sorted(data["latency"] for kind, data in events if kind == "wizard_reached")
    print("from click or key to robot, s:", latencies)
    assert "operator" not in ana.page.locator("body").inner_text().lower()


def has_left(site) -> bool:
    return bool(site.rows("SELECT 1 FROM experiments_taskevent WHERE type = 'left_station'"))
