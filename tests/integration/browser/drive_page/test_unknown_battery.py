"""The drive page of a robot without a known charge: a text and an icon without a level."""

import pytest
from playwright.async_api import expect

from robots.api.messages import Battery
from tests.support.browsers.drive_page import driving, opened

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module"), pytest.mark.nightly]


async def test_battery_is_unknown_until_and_after_the_robot_reports_it(browser, site):
    site.battery = Battery(charging=None)
    async with opened(browser, site) as page:
        await page.click("text=Drive Giraff")
        await driving(page)
        battery, level = page.locator("#battery"), page.locator("#battery-level")
        for _ in range(2):
            await expect(battery).to_have_text("Battery unknown", use_inner_text=True)
            assert "Battery unknown" in await page.locator(".readings").aria_snapshot()
            await expect(level).to_be_hidden()
            await expect(battery).not_to_have_attribute("data-low", "")
            site.battery = Battery(charge=0.1)
            await expect(page.locator("#battery-text")).to_have_text("10%")
            await expect(level).to_be_visible()
            await expect(battery).to_have_attribute("data-low", "")
            site.battery = Battery(charging=None)
