"""The drive page shows what the pictures of README and documentation show. After a change of what a
visitor sees while driving, `make pictures` takes them again.
"""

import asyncio
import time

import pytest

from tests.support.browsers.drive_page import UPRIGHT, WIDE, driven
from tests.support.browsers.present_robot_page import ABLE, PresentRobotPage
from tests.support.browsers.shown import PROBE, controls, differences, records
from tests.support.patience import patient

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


@pytest.mark.parametrize(
    ("page_name", "size"), [("drive page", WIDE), ("drive page on a phone", UPRIGHT)]
)
async def test_drive_page_shows_what_its_pictures_show(browser, page_name, size):
    recorded = records()["pages"][page_name]
    with PresentRobotPage(capabilities=ABLE) as site:
        async with driven(browser, site, size) as page:
            deadline = time.monotonic() + patient(10)
            while changed := differences(recorded, controls(await page.evaluate(PROBE))):
                assert time.monotonic() < deadline, ("run `make pictures`", *changed)
                await asyncio.sleep(0.2)
