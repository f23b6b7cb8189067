"""A study's task on the drive page in a real Chromium: what a participant sees and can press, and
what is recorded.
"""

import io
import re

import pytest
from PIL import Image
from playwright.async_api import Page, expect

from robots.api.messages import Photo
from sessions import protocol
from tests.support.agents.told_task import guide, tell
from tests.support.browsers.drive_page import LOW, UPRIGHT, WIDE, actions, driven, hold, stops
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.patience import until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


@pytest.fixture
def site():
    with FakeRobotPage(study=guide()) as fake:
        yield fake


def recorded(site: FakeRobotPage, kind: str) -> list[dict]:
    return [event.data for event in site.received("page/event") if event.type == kind]


def jpeg() -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (64, 48), "#8899aa").save(file, "JPEG")
    return file.getvalue()


async def box(page: Page, selector: str) -> dict[str, float]:
    found = await page.locator(selector).bounding_box()
    assert found is not None, f"{selector} is not to be seen"
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("size", [WIDE, UPRIGHT, LOW], ids=["wide", "upright", "low"])
async def test_task_shows_cue_after_cue_and_covers_neither_stop_nor_floor(browser, site, size):
    async with driven(browser, site, size) as page:
        await until(lambda: recorded(site, "first_frame"))
        tell(site, "go_to_checkpoint", number=2, x=8.4, y=1.0, passed=(1,))
        clock = page.locator("#task-time" if size != WIDE else "#dial-time")
        await expect(clock).to_contain_text(re.compile(r"\d:\d\d"))
        await expect(clock).to_be_visible()
        tell(site, "go_to_checkpoint", number=2, x=8.4, y=1.0, passed=(1,), remaining=119.0)
        await expect(page.get_by_text("Go to checkpoint 2.", exact=True).first).to_be_visible()
        await expect(page.locator("#task-time")).to_contain_text("left")
        if size != WIDE:
            await expect(page.locator("#task-more")).to_be_hidden()
            await page.locator("#task-line").click()
        await expect(
            page.get_by_text("Corridor, towards the living room", exact=True)
        ).to_be_visible()
        said = await page.locator("#task-stops").inner_text()
        assert " ".join(said.split()) == (
            "✓ Checkpoint 1: passed 2 Checkpoint 2: next 3 Checkpoint 3: later"
            " 4 Checkpoint 4: later ϟ Charging station: at the end"
        )
        stop, stage = await box(page, "#stop"), await box(page, "#viewport")
        for selector in ("#task", "#pointer"):
            part = await box(page, selector)
            apart = (
                part["x"] + part["width"] <= stop["x"]
                or part["y"] + part["height"] <= stop["y"]
                or stop["x"] + stop["width"] <= part["x"]
            )
            assert apart, f"{selector} covers the stop button"
            outside = (
                part["y"] + part["height"] <= stage["y"] or part["x"] >= stage["x"] + stage["width"]
            )
            assert outside or part["y"] + part["height"] <= stage["y"] + stage["height"] / 2, (
                f"{selector} covers the floor ahead"
            )
        assert await page.evaluate(
            "document.documentElement.scrollWidth <= innerWidth &&"
            " document.documentElement.scrollHeight <= innerHeight"
        )

        # Only a cue that was shown for a while is recorded (LEAST_SHOWN in page_events.js).
        await page.wait_for_timeout(500)
        tell(site, "return_home", number=0, x=0.5, y=6.3, passed=(1, 2, 3, 4))
        go = "cue.go_to_checkpoint"
        shown = await until(lambda: [d for d in recorded(site, "cue_shown") if d["word"] == go])
        assert [data["number"] for data in shown] == [2]


@pytest.mark.nightly
async def test_photo_is_taken_reviewed_and_retaken_while_the_keys_still_drive(site, page):
    tell(site, "photo_turn_left", number=4, x=8.1, y=2.2, passed=(1, 2, 3, 4), window="open")
    photo = page.get_by_role("region", name="Photo")
    await expect(photo.get_by_text("You cannot see yourself yet: turn left.")).to_be_visible()
    await hold(page, "ArrowLeft", lambda: any(c.angular > 0.0 for _, c in site.applied))
    await page.keyboard.up("ArrowLeft")
    await photo.get_by_role("button", name="Take photo").click()
    action = (await until(lambda: actions(site, Photo)))[0].action_id
    await expect(photo.get_by_text("Taking the photo")).to_be_visible()

    tell(site, "photo_review", number=4, passed=(1, 2, 3, 4), window="review", photo=action)
    await expect(photo.get_by_text("Loading the photo")).to_be_visible()
    site.photos[action] = jpeg()
    await expect(photo.get_by_alt_text("The photo you just took")).to_be_visible()
    await photo.get_by_role("button", name="Retake").click()
    answers = await until(lambda: recorded(site, "photo_answer"))
    assert (answers[0]["choice"], answers[0]["photo"]) == ("again", action)
    # Without a reply the same answer is sent again.
    again = await until(lambda: recorded(site, "photo_answer")[1:])
    assert again[0] == answers[0]

    tell(site, "photo_ready", number=4, x=8.1, y=2.2, passed=(1, 2, 3, 4), window="open")
    await expect(photo.get_by_text("Do you see the robot in the mirror?")).to_be_visible()
    await page.keyboard.press("Tab")
    await expect(photo.get_by_role("button", name="Take photo")).to_be_focused()
    await page.keyboard.press("Enter")
    await until(lambda: len({one.action_id for one in actions(site, Photo)}) == 2)
    tell(site, "return_home", number=0, x=0.5, y=6.3, passed=(1, 2, 3, 4))
    await expect(photo).to_be_hidden()


async def test_leaving_asks_first_and_one_button_continues_after_the_end(site, page):
    tell(site, "go_to_checkpoint", number=1, x=2.0, y=1.0)
    await page.get_by_role("button", name="Leave").click()
    await expect(page.get_by_role("heading", name="Leave the task?")).to_be_visible()
    await page.get_by_role("button", name="Keep driving").click()
    await expect(page.get_by_role("heading", name="Leave the task?")).to_be_hidden()
    tell(site, "timed_out", outcome="timed_out")
    site.end("timed_out")
    await expect(page.get_by_role("heading", name="Time is up")).to_be_visible()
    await page.get_by_role("button", name="Continue").click()
    await expect(page.get_by_role("heading", name="The next step")).to_be_visible()


@pytest.mark.nightly
async def test_study_continues_by_itself_after_ten_seconds(site, page):
    tell(site, "completed", passed=(1, 2, 3, 4), outcome="completed")
    await expect(
        page.get_by_text("Done. The robot is back in its charging station.").first
    ).to_be_visible()
    site.end("completed")
    await expect(page.get_by_role("heading", name="Well done")).to_be_visible()
    await expect(page.get_by_role("heading", name="The next step")).to_be_visible()


async def test_controllers_that_the_study_forbids_are_off_but_space_stops(browser, site):
    site.terms = protocol.GrantedTerms(
        controllers=("stick",), actions=("stop", "photo"), assist="off"
    )
    async with driven(browser, site) as page:
        await expect(page.locator("#assist")).to_be_hidden()
        await expect(page.locator("#stick")).to_be_visible()
        await page.keyboard.press("ArrowUp")
        await expect(page.locator("#alert")).to_have_text(
            "The keyboard is off for this drive. Use the on-screen stick."
        )
        await page.keyboard.press("Space")
        await until(lambda: stops(site))
        assert not any(command.linear > 0.0 for _, command in site.applied)


async def test_record_has_layout_map_controller_and_permissions(site, page):
    layout = (await until(lambda: recorded(site, "layout")))[0]
    assert (layout["layout"], layout["width"], layout["height"]) == ("wide", 1280, 800)
    permissions = lambda: sorted(data["name"] for data in recorded(site, "permission"))
    await until(lambda: permissions() == ["camera", "microphone"])
    keyboard = [{"method": "keyboard"}]
    await hold(page, "ArrowUp", lambda: recorded(site, "controller") == keyboard)
    await page.keyboard.up("ArrowUp")
    await page.set_viewport_size({"width": 844, "height": 390})
    layouts = lambda: [data["layout"] for data in recorded(site, "layout")]
    await until(lambda: layouts() == ["wide", "low"])
    await page.locator("#map-toggle").click()
    await until(lambda: [data["open"] for data in recorded(site, "map")] == [True, False])


@pytest.mark.nightly
async def test_first_frame_is_reported_until_the_task_has_begun(site, page):
    tell(site, "wait_for_picture")
    await until(lambda: len(recorded(site, "first_frame")) >= 2)
    tell(site, "leave_station", number=1, x=2.0, y=1.0)
    await expect(
        page.get_by_text("Drive backwards out of the charging station.").first
    ).to_be_visible()
    seconds = len(site.received("page/network"))
    # what it sent before has arrived
    await until(lambda: len(site.received("page/network")) > seconds)
    count, seconds = len(recorded(site, "first_frame")), len(site.received("page/network"))
    # one a second: longer than the page waits before it repeats a message
    await until(lambda: len(site.received("page/network")) >= seconds + 3)
    assert len(recorded(site, "first_frame")) == count
