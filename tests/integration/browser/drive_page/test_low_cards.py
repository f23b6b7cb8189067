"""On a low screen a card's drawing makes room for its text and buttons."""

import pytest

from sessions import protocol
from tests.support.browsers.present_robot_page import PresentRobotPage

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
# Parts that the lower edge of the stage cuts off.
BELOW = """() => [...document.querySelectorAll("#card :is(h1, h2, p, button, img)")]
  .filter((one) => one.checkVisibility() && one.getBoundingClientRect().bottom
    > document.querySelector(".stage").getBoundingClientRect().bottom + 1)
  .map((one) => one.textContent.trim() || one.tagName)"""


async def test_second_page_shows_its_whole_question_on_a_phone_in_landscape(browser):
    with PresentRobotPage() as site:
        context = await browser.new_context(viewport={"width": 844, "height": 390})
        page = await context.new_page()
        await page.goto(f"{site.url}spanish")
        await page.wait_for_selector("#card[data-card=lobby]")
        site.tell("session/refused", protocol.Refused(reason="elsewhere", session="s", since=1e9))
        await page.wait_for_selector("#card[data-card='elsewhere.device']")
        assert await page.evaluate(BELOW) == []
        await page.click("#card-main")
        await page.wait_for_selector("#card[data-card=taking_over]")
        assert await page.evaluate(BELOW) == []
        await context.close()
