"""A short task from the station and back, with every part real: session manager, robot, picture,
photo, page.
"""

import json

import pytest
from playwright.sync_api import expect

from tests.support.sessions.site import wait_for
from tests.support.studies.task_study import begin_short_study

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "dock", "--seed", "3")


def page_events(site) -> list[tuple[str, dict]]:
    rows = site.rows(
        "SELECT type, data FROM telepresence_sessions_sessionevent WHERE source = 'page' ORDER BY"
        " received_at"
    )
    return [(kind, json.loads(data)) for kind, data in rows]


def test_a_participant_backs_out_takes_the_photo_docks_and_is_led_on(site, visitor, giraff):
    begin_short_study(site, "ana")
    ana = visitor("ana")
    page = ana.page
    page.goto("/studies/short/step/")
    page.get_by_role("link", name="Go to the robot").click()
    page.get_by_role("button", name="Drive Giraff").click()
    ana.wait_for_picture()
    cue = page.locator("#task-cue")
    expect(cue).to_have_text("Drive backwards out of the charging station.", timeout=20_000)
    # the condition forbids the robot to leave by itself, so nothing leaves for the participant
    expect(page.locator("#offer")).to_have_attribute("data-word", "dock.here_yourself")
    expect(page.get_by_role("button", name="Leave station")).to_be_hidden()
    expect(page.locator("#assist")).to_be_hidden()

    photo = page.get_by_role("region", name="Photo")
    ana.hold("ArrowDown", photo.is_visible, 30, "the checkpoint")
    page.keyboard.up("ArrowDown")
    photo.get_by_role("button", name="Take photo").click()
    picture = photo.get_by_alt_text("The photo you just took")
    expect(picture).to_be_visible(timeout=20_000)
    wait_for(
        lambda: picture.evaluate("image => image.complete && image.naturalWidth") > 100,
        10,
        "the picture itself",
    )
    photo.get_by_role("button", name="Keep").click()
    expect(photo).to_be_hidden(timeout=40_000)
    expect(page.locator("#task-stops [data-status=passed]")).to_have_count(1)

    ana.hold(
        "ArrowUp", lambda: "Release the controls and wait" in cue.inner_text(), 40, "the charger"
    )
    page.keyboard.up("ArrowUp")
    expect(page.get_by_role("heading", name="Well done")).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_text("Thank you for driving!")).to_be_visible(timeout=40_000)

    wanted = {"first_frame", "layout", "map", "photo_answer", "cue_shown", "controller"}
    told = wait_for(
        lambda: wanted <= dict(events := page_events(site)).keys() and events,
        10,
        "the page's record",
    )
    kinds = dict(told)
    assert kinds["photo_answer"]["choice"] == "keep"
    shown = [data["word"] for kind, data in told if kind == "cue_shown"]
    # the picture may be there before the first cue
    assert next(word for word in shown if word != "cue.wait_for_picture") == "cue.leave_station"
