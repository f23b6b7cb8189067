"""A simulated network for the driver's video and sound alone, over real WebRTC on loopback and
through the server.
"""

import statistics
import time

import pytest

from robots.api import picture
from robots.api.messages import NetworkLab, PictureRequest
from tests.support import words
from tests.support.media.loopback_peer import MediaRig, until


def arrivals(page) -> dict[int, float]:
    """Note when each picture of a page arrives, by its RTP timestamp; call it before the page
    connects.
    """
    found: dict[int, float] = {}
    noted = page.video.receiver._handle_rtp_packet

    async def note(packet, arrival_time_ms: int) -> None:
        found.setdefault(packet.timestamp, time.monotonic())
        await noted(packet, arrival_time_ms)

    page.video.receiver._handle_rtp_packet = note
    return found


async def losing(media) -> None:
    """Wait until packets are lost, and until earlier ones have been read."""
    await until(lambda: media.network is not None and media.network.lost > 5, what="lost packets")
    for _ in range(2):
        lost = media.network.lost
        await until(lambda lost=lost: media.network.lost > lost + 10, what="more of them")


@pytest.fixture
async def watched(media, new_page):
    """A driver and an observer who see the camera, and the arrival times of their pictures."""
    driver, observer = new_page("p1"), new_page("p2")
    times = arrivals(driver), arrivals(observer)
    media.lease_changed("p1")
    await driver.connect("driver")
    await observer.connect()
    await until(
        lambda: len(driver.pictures) > 3 and len(observer.pictures) > 3, what="pictures at both"
    )
    return driver, observer, times


async def test_lab_delay_affects_only_the_drivers_video(media, watched) -> None:
    driver, _, (late, clean) = watched
    media.impair(NetworkLab(delay=0.4, seed=1))
    report = await until(
        lambda: media.network is not None and media.network.waiting > 5 and media.network,
        what="packets on their way",
    )
    assert report.lab.delay == 0.4
    since, before = time.monotonic(), len(driver.pictures)
    await until(lambda: len(driver.pictures) > before + 15, what="late pictures")
    both = [rtp for rtp, at in clean.items() if at > since and rtp in late]
    assert statistics.median(late[rtp] - clean[rtp] for rtp in both) > 0.3
    assert media.network.held >= 0.39
    assert media.network.lost == media.network.overflowed == 0


async def test_lab_loss_keeps_connection_data_channel_and_observers_video(media, watched) -> None:
    driver, observer, _ = watched
    media.impair(NetworkLab(loss=1.0))
    await losing(media)
    reports = media._pages._viewers["p1"]._pictures.last_report
    seen, others = len(driver.pictures), len(observer.pictures)
    await until(lambda: len(observer.pictures) > others + 15, what="the observer's pictures")
    await driver.lose_a_picture()
    await until(
        lambda: media._pages._viewers["p1"]._pictures.last_report > reports,
        what="RTCP of the driver's page",
    )
    assert len(driver.pictures) == seen
    media.telemetry("pose", words.pose())
    await until(lambda: any(suffix == "pose" for suffix, _ in driver.messages), what="telemetry")
    assert media.connected == 2
    await driver.video.receiver._send_rtcp_nack(driver.ssrc, [1, 2, 3])
    media.impair(None)
    await until(lambda: len(driver.pictures) > seen + 5, what="pictures again")
    assert media.network is None


async def test_only_the_current_drivers_video_is_impaired(media, watched) -> None:
    driver, observer, _ = watched
    media.impair(NetworkLab(loss=1.0))
    await until(lambda: media.network is not None and media.network.lost > 5, what="lost packets")
    before = len(driver.pictures)
    media.lease_changed("p2")
    await until(lambda: len(driver.pictures) > before + 5, what="pictures of the former driver")
    await losing(media)
    seen, former = len(observer.pictures), len(driver.pictures)
    await until(lambda: len(driver.pictures) > former + 10)
    assert len(observer.pictures) == seen
    media.lease_changed(None)
    await until(lambda: len(observer.pictures) > seen + 5, what="pictures without a driver")


async def test_driver_who_reconnects_has_the_same_network(media, connected) -> None:
    media.lease_changed("p1")
    media.impair(NetworkLab(loss=1.0))
    page = await connected("p1", "driver")
    await until(lambda: media.network is not None and media.network.lost > 20, what="lost packets")
    assert page.pictures == []


@pytest.fixture
async def slow(camera):
    """A media side whose pictures are sent through the server, as (peer, capture stamp, time)."""
    sent: list[tuple[str | None, float, float]] = []

    def take(payload, peer) -> None:
        sent.append((peer, picture.unpack(payload)[0], time.time()))

    async with MediaRig(video=camera, on_picture=take) as rig:
        rig.media.lease_changed("p1")
        yield rig.media, sent


async def test_fallback_pictures_are_delayed_only_for_the_driver(slow) -> None:
    side, sent = slow
    side.impair(NetworkLab(delay=0.5))
    await until(lambda: side.network is not None)
    side.picture_wanted(PictureRequest(stamp=1.0, peer="p2"))
    side.picture_wanted(PictureRequest(stamp=1.0, peer="p1"))
    await until(lambda: {peer for peer, _, _ in sent} == {"p1", "p2"}, what="a picture for each")
    assert min(at - stamp for peer, stamp, at in sent if peer == "p1") > 0.49
    assert side.network.taken == 1
    await until(lambda: side.network.held >= 0.49, what="the time for which it was held")


async def test_without_a_lab_one_picture_is_sent_for_all_pages(slow) -> None:
    side, sent = slow
    side.picture_wanted(PictureRequest(stamp=1.0, peer="p1"))
    await until(lambda: sent)
    assert [peer for peer, _, _ in sent] == [None]


async def test_picture_that_the_drivers_network_loses_is_not_sent(slow) -> None:
    side, sent = slow
    side.impair(NetworkLab(loss=1.0))
    await until(lambda: side.network is not None)
    side.picture_wanted(PictureRequest(stamp=1.0, peer="p1"))
    await until(lambda: side.network.lost == 1, what="a lost picture")
    side.picture_wanted(PictureRequest(stamp=1.0, peer="p2"))
    await until(lambda: sent, what="the observer's picture")
    assert {peer for peer, _, _ in sent} == {"p2"}
