"""A real Chromium watches the robot."""

import statistics

import pytest

from robots.api.messages import Heartbeat
from tests.support.browsers.browser_page import BrowserPage, chromium
from tests.support.media.loopback_peer import until

pytestmark = pytest.mark.browser


@pytest.mark.nightly
async def test_chromium_shows_the_picture_with_its_capture_time(media, exchange) -> None:
    async with chromium() as (browser, address):
        page = await BrowserPage.open(browser, address, media, exchange, "p1")
        await page.watch()
        report = await page.report_when("report.decoded > 60 && report.stampErrors.length > 40")
        assert await page.page.evaluate("spread()") > 10, "a uniform picture"
        assert statistics.median(map(abs, report["stampErrors"])) < 0.001
        late = [abs(error) > 0.002 for error in report["stampErrors"]]
        assert sum(late) <= 0.05 * len(late)
        assert await page.page.evaluate("heard()") > 20


async def test_chromium_gets_playout_delay_and_vp8_and_sends_no_media_unasked(
    media, exchange
) -> None:
    async with chromium() as (browser, address):
        page = await BrowserPage.open(browser, address, media, exchange, "p1", role="driver")
        await page.watch()
        await page.report_when("report.decoded > 5")
        answer = exchange.answers("p1")[0]
        assert "playout-delay" in answer
        assert "VP8" in answer
        directions = await page.page.evaluate(
            "peer.getTransceivers().map(line => line.currentDirection)"
        )
        # the page needs its own lines for replaceTrack
        assert directions == ["recvonly", "recvonly", "sendonly", "sendonly"]


async def test_data_channel_works_in_both_directions_in_chromium(media, exchange) -> None:
    async with chromium() as (browser, address):
        media.lease_changed("p1")
        page = await BrowserPage.open(browser, address, media, exchange, "p1", role="driver")
        await page.watch()
        await page.page.wait_for_function("() => channel.readyState === 'open'")
        await page.page.evaluate("channel.send('command/heartbeat\\n{}')")
        await until(lambda: exchange.heard)
        assert exchange.heard[0][:2] == ("p1", "driver")
        media.telemetry("heartbeat", Heartbeat(n=7, stamp=1.5))
        report = await page.report_when(
            "report.messages.some(([suffix]) => suffix === 'heartbeat')"
        )
        assert ["heartbeat", {"n": 7, "stamp": 1.5}] in report["messages"]


async def test_chromium_shows_the_picture_again_after_an_outage_of_the_camera(
    camera, media, exchange
) -> None:
    async with chromium() as (browser, address):
        page = await BrowserPage.open(browser, address, media, exchange, "p1")
        await page.watch()
        await page.report_when("report.decoded > 20")
        camera.fail("unplugged")
        await until(lambda: media.camera.status == "failed")
        camera.recover()
        seen = (await page.report())["decoded"]
        report = await page.report_when(f"report.decoded > {seen + 20}")
        assert report["state"] == "connected"
        assert statistics.median(map(abs, report["stampErrors"][-10:])) < 0.002
