"""A short task from the station and back: real session manager, robot, video, photo and page."""

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


def test_participant_leaves_takes_the_photo_docks_and_continues(site, visitor, giraff):
    begin_short_study(site, "ana")
    ana = visitor("ana")
    page = ana.page
    page.goto("/studies/short/step/")
    page.get_by_role("link", name="Go to the robot").click()
    page.get_by_role("button", name="Drive Giraff").click()
    ana.wait_for_picture()
    cue = page.locator("#task-cue")
    expect(cue).to_have_text("Drive backwards out of the charging station.", timeout=20_000)
    # the condition forbids the robot to leave by itself
    expect(page.locator("#offer")).to_have_attribute("data-word", "dock.here_yourself")
    expect(page.get_by_role("button", name="Leave station")).to_be_hidden()
    expect(page.locator("#assist")).to_be_hidden()

    photo = page.get_by_role("region", name="Photo")
    ana.hold("ArrowDown", photo.is_visible, 30, "the checkpoint")
    page.keyboard.up("ArrowDown")
    photo.get_by_role("button", name="Take photo").click()
    picture = photo.get_by_alt_text("The photo you just took")
    expect(picture).to_be_visible(timeout=20_000)
    width = "image => image.complete && image.naturalWidth"
    wait_for(lambda: picture.evaluate(width) > 100, 10, "the photo itself")
    photo.get_by_role("button", name="Keep").click()
    expect(photo).to_be_hidden(timeout=40_000)
    expect(page.locator("#task-stops [data-status=passed]")).to_have_count(1)

    waits = "Release the controls and wait"
    ana.hold("ArrowUp", lambda: waits in cue.inner_text(), 40, "the charger")
    page.keyboard.up("ArrowUp")
    expect(page.get_by_role("heading", name="Well done")).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_text("Thank you for driving!")).to_be_visible(timeout=40_000)

    wanted = {"first_frame", "layout", "map", "photo_answer", "cue_shown", "controller"}
    recorded = lambda: wanted <= dict(events := page_events(site)).keys() and events
    events = wait_for(recorded, 10, "the page's record")
    kinds = dict(events)
    assert kinds["photo_answer"]["choice"] == "keep"
    shown = [data["word"] for kind, data in events if kind == "cue_shown"]
    # the video may start before the first cue
    assert next(word for word in shown if word != "cue.wait_for_picture") == "cue.leave_station"
