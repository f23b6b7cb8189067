"""A study's task on the drive page, in a real Chromium: what a participant sees, can press, and
what is written down of it.
"""

import io
import re

import pytest
from PIL import Image
from playwright.async_api import Page, expect

from robots.api.messages import Photo
from sessions import protocol
from tests.support.agents.told_task import guide, tell
from tests.support.browsers.drive_page import LOW, UPRIGHT, WIDE, hold, opened
from tests.support.browsers.drive_page import until as until_within
from tests.support.browsers.fake_robot_page import FakeRobotPage

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
PATIENCE = 60_000  # ms: the page's own seconds are slow on a busy computer


@pytest.fixture
def site():
    with FakeRobotPage(study=guide()) as fake:
        yield fake


async def until(condition):
    return await until_within(condition, PATIENCE / 1000)


async def driving(page: Page) -> None:
    await page.wait_for_selector("#drive-page[data-playing][data-link=live]", timeout=PATIENCE)


def written(site: FakeRobotPage, kind: str) -> list[dict]:
    return [event.data for event in site.said("page/event") if event.type == kind]


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
async def test_the_task_is_led_from_cue_to_cue_and_lies_over_neither_stop_nor_the_way_ahead(
    browser, site, size
):
    async with opened(browser, site, size, query="?go=1") as page:
        await driving(page)
        await until(lambda: written(site, "first_frame"))
        tell(site, "go_to_checkpoint", number=2, x=8.4, y=1.0, passed=(1,))
        clock = page.locator("#task-time" if size != WIDE else "#dial-time")
        await expect(clock).to_contain_text(re.compile(r"\d:\d\d"), timeout=PATIENCE)
        await expect(clock).to_be_visible()
        tell(site, "go_to_checkpoint", number=2, x=8.4, y=1.0, passed=(1,), remaining=119.0)
        await expect(page.get_by_text("Go to checkpoint 2.", exact=True).first).to_be_visible(
            timeout=PATIENCE
        )
        await expect(page.locator("#task-time")).to_contain_text("left", timeout=PATIENCE)
        if size != WIDE:
            await expect(page.locator("#task-more")).to_be_hidden(timeout=PATIENCE)
            await page.locator("#task-line").click()
        await expect(
            page.get_by_text("Corridor, towards the living room", exact=True)
        ).to_be_visible(timeout=PATIENCE)
        said = await page.locator("#task-stops").inner_text()
        assert said.split() == [
            "✓",
            "Checkpoint",
            "1:",
            "passed",
            "2",
            "Checkpoint",
            "2:",
            "next",
            "3",
            "Checkpoint",
            "3:",
            "later",
            "4",
            "Checkpoint",
            "4:",
            "later",
            "ϟ",
            "Charging",
            "station:",
            "at",
            "the",
            "end",
        ]
        stop, stage = await box(page, "#stop"), await box(page, "#viewport")
        for selector in ("#task", "#pointer"):
            part = await box(page, selector)
            apart = (
                part["x"] + part["width"] <= stop["x"]
                or part["y"] + part["height"] <= stop["y"]
                or stop["x"] + stop["width"] <= part["x"]
            )
            assert apart, f"{selector} lies over the stop button"
            outside = (
                part["y"] + part["height"] <= stage["y"] or part["x"] >= stage["x"] + stage["width"]
            )
            assert outside or part["y"] + part["height"] <= stage["y"] + stage["height"] / 2, (
                f"{selector} lies over the way ahead"
            )
        assert await page.evaluate(
            "document.documentElement.scrollWidth <= innerWidth &&"
            " document.documentElement.scrollHeight <= innerHeight"
        )

        # What flickers by is not written down: the sentence has to have stood for a while
        # (LEAST_SHOWN in records.js).
        await page.wait_for_timeout(500)
        tell(site, "return_home", number=0, x=0.5, y=6.3, passed=(1, 2, 3, 4))
        shown = await until(
            lambda: [
                data
                for data in written(site, "cue_shown")
                if data["word"] == "cue.go_to_checkpoint"
            ]
        )
        assert [data["number"] for data in shown] == [2]


@pytest.mark.nightly
async def test_the_photo_is_taken_judged_and_taken_again_while_the_keys_still_drive(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        tell(site, "photo_turn_left", number=4, x=8.1, y=2.2, passed=(1, 2, 3, 4), window="open")
        photo = page.get_by_role("region", name="Photo")
        await expect(photo.get_by_text("You cannot see yourself yet: turn left.")).to_be_visible(
            timeout=PATIENCE
        )
        await hold(
            page,
            "ArrowLeft",
            lambda: any(command.angular > 0.0 for _, command in site.applied),
            PATIENCE / 1000,
        )
        await page.keyboard.up("ArrowLeft")
        await photo.get_by_role("button", name="Take photo").click()
        taken = await until(
            lambda: [action for action in site.said("command/action") if isinstance(action, Photo)]
        )
        action = taken[0].action_id
        await expect(photo.get_by_text("Taking the photo")).to_be_visible(timeout=PATIENCE)

        tell(site, "photo_review", number=4, passed=(1, 2, 3, 4), window="review", photo=action)
        await expect(photo.get_by_text("Loading the photo")).to_be_visible(timeout=PATIENCE)
        site.photos[action] = jpeg()
        await expect(photo.get_by_alt_text("The photo you just took")).to_be_visible(
            timeout=PATIENCE
        )
        await photo.get_by_role("button", name="Retake").click()
        answers = await until(lambda: written(site, "photo_answer"))
        assert (answers[0]["choice"], answers[0]["photo"]) == ("again", action)
        # Nobody has understood it: it is said again, as the same answer.
        again = await until(lambda: written(site, "photo_answer")[1:])
        assert again[0] == answers[0]

        tell(site, "photo_ready", number=4, x=8.1, y=2.2, passed=(1, 2, 3, 4), window="open")
        await expect(photo.get_by_text("Do you see the robot in the mirror?")).to_be_visible(
            timeout=PATIENCE
        )
        await page.keyboard.press("Tab")
        await expect(photo.get_by_role("button", name="Take photo")).to_be_focused(timeout=PATIENCE)
        await page.keyboard.press("Enter")
        await until(
            lambda: (
                len(
                    {
                        action.action_id
                        for action in site.said("command/action")
                        if isinstance(action, Photo)
                    }
                )
                == 2
            )
        )
        tell(site, "return_home", number=0, x=0.5, y=6.3, passed=(1, 2, 3, 4))
        await expect(photo).to_be_hidden(timeout=PATIENCE)


async def test_leaving_asks_first_and_the_end_leads_on_with_one_button(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        tell(site, "go_to_checkpoint", number=1, x=2.0, y=1.0)
        await page.get_by_role("button", name="Leave").click()
        await expect(page.get_by_role("heading", name="Leave the task?")).to_be_visible(
            timeout=PATIENCE
        )
        await page.get_by_role("button", name="Keep driving").click()
        await expect(page.get_by_role("heading", name="Leave the task?")).to_be_hidden(
            timeout=PATIENCE
        )
        tell(site, "timed_out", outcome="timed_out")
        site.end("timed_out")
        await expect(page.get_by_role("heading", name="Time is up")).to_be_visible(timeout=PATIENCE)
        await page.get_by_role("button", name="Continue").click()
        await expect(page.get_by_role("heading", name="The next step")).to_be_visible(
            timeout=PATIENCE
        )


@pytest.mark.nightly
async def test_after_ten_seconds_the_study_goes_on_by_itself(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        tell(site, "completed", passed=(1, 2, 3, 4), outcome="completed")
        await expect(
            page.get_by_text("Done. The robot is back in its charging station.").first
        ).to_be_visible(timeout=PATIENCE)
        site.end("completed")
        await expect(page.get_by_role("heading", name="Well done")).to_be_visible(timeout=PATIENCE)
        await expect(page.get_by_role("heading", name="The next step")).to_be_visible(
            timeout=PATIENCE
        )


async def test_what_the_study_fixes_is_off_and_says_so_and_the_space_bar_still_stops(browser, site):
    site.terms = protocol.GrantedTerms(
        controllers=("stick",), actions=("stop", "photo"), assist="off"
    )
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        await expect(page.locator("#assist")).to_be_hidden(timeout=PATIENCE)
        await expect(page.locator("#stick")).to_be_visible(timeout=PATIENCE)
        await page.keyboard.press("ArrowUp")
        await expect(page.locator("#alert")).to_have_text(
            "The keyboard is off for this drive. Use the on-screen stick.", timeout=PATIENCE
        )
        await page.keyboard.press("Space")
        await until(
            lambda: [
                action for action in site.said("command/action") if type(action).__name__ == "Stop"
            ]
        )
        assert not any(command.linear > 0.0 for _, command in site.applied)


async def test_the_record_has_the_layout_the_map_the_controller_and_a_hidden_tab(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        layout = (await until(lambda: written(site, "layout")))[0]
        assert (layout["layout"], layout["width"], layout["height"]) == ("wide", 1280, 800)
        assert {
            data["name"]
            for data in await until(
                lambda: len(written(site, "permission")) == 2 and written(site, "permission")
            )
        } == {
            "camera",
            "microphone",
        }
        await hold(
            page,
            "ArrowUp",
            lambda: written(site, "controller") == [{"method": "keyboard"}],
            PATIENCE / 1000,
        )
        await page.keyboard.up("ArrowUp")
        await page.set_viewport_size({"width": 844, "height": 390})
        await until(lambda: [data["layout"] for data in written(site, "layout")] == ["wide", "low"])
        await page.locator("#map-toggle").click()
        await until(lambda: [data["open"] for data in written(site, "map")] == [True, False])


@pytest.mark.nightly
async def test_the_first_picture_is_told_until_the_task_has_begun(browser, site):
    async with opened(browser, site, query="?go=1") as page:
        await driving(page)
        tell(site, "wait_for_picture")
        await until(lambda: len(written(site, "first_frame")) >= 2)
        tell(site, "leave_station", number=1, x=2.0, y=1.0)
        await expect(
            page.get_by_text("Drive backwards out of the charging station.").first
        ).to_be_visible(timeout=PATIENCE)
        seconds = len(site.said("page/network"))
        # what it said before that has arrived
        await until(lambda: len(site.said("page/network")) > seconds)
        count, seconds = len(written(site, "first_frame")), len(site.said("page/network"))
        # one a second: longer than the page waits before it says it again
        await until(lambda: len(site.said("page/network")) >= seconds + 3)
        assert len(written(site, "first_frame")) == count
