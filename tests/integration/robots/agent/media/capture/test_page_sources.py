"""A robot whose screen page provides its video and sound."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from robots.agent.media.capture.page_sources import MISSING_VIDEO
from robots.agent.media.pixels import video_frame
from robots.agent.robot_interface import FROM_PAGE
from tests.support.browsers.visitor_tracks import SpeakingPage
from tests.support.media.loopback_peer import LoopbackPage, MediaRig, is_near, until

GREEN, BLUE = (30, 160, 40), (20, 40, 180)


class Robot(MediaRig):
    """A robot without camera and microphone, and its pages."""

    def __init__(self, **sources: str | None) -> None:
        super().__init__(**{"video": FROM_PAGE, "audio": FROM_PAGE} | sources)

    async def screen(self, peer: str, colour: tuple[int, int, int]) -> SpeakingPage:
        page = self.page(peer, SpeakingPage)
        page.send(hertz=440.0, colour=colour)
        await page.connect("screen")
        return page

    async def viewer(self, peer: str = "p1") -> LoopbackPage:
        page = self.page(peer)
        await page.connect()
        return page


@pytest.fixture
async def robot() -> AsyncIterator[Robot]:
    async with Robot() as robot:
        yield robot


@pytest.mark.nightly
async def test_media_of_the_robots_page_reach_viewers_before_and_after(robot) -> None:
    before = await robot.viewer("before")
    assert robot.media.camera.status == "starting"
    await until(
        lambda: robot.media.camera.reason == MISSING_VIDEO and MISSING_VIDEO in robot.media.errors,
        what="the reason",
    )
    await robot.screen("screen", GREEN)
    after = await robot.viewer("after")
    await until(lambda: before.shows(GREEN) and after.shows(GREEN), what="its picture")
    await until(lambda: before.sounds > 10 and after.sounds > 10, what="its sound")
    assert robot.media.camera.status == robot.media.microphone.status == "live"
    clock = await until(lambda: after.clocks() and after.clocks()[-1], what="a media clock")
    assert clock.rate == 90_000


async def test_newer_of_two_screen_pages_provides_the_video(robot) -> None:
    viewer = await robot.viewer()
    await robot.screen("screen", GREEN)
    await until(lambda: viewer.shows(GREEN))
    await robot.screen("screen-2", BLUE)
    await until(lambda: viewer.shows(BLUE), what="the newer page's picture")


@pytest.mark.nightly
async def test_closed_page_is_reported_and_the_next_page_shows_video(robot) -> None:
    viewer = await robot.viewer()
    screen = await robot.screen("screen", GREEN)
    await until(lambda: viewer.shows(GREEN))
    await screen.connection.close()
    await until(lambda: robot.media.camera.status == "failed", 15.0, "its end")
    await robot.screen("screen", BLUE)
    await until(
        lambda: viewer.shows(BLUE) and robot.media.camera.status == "live",
        15.0,
        "the next page's picture",
    )


async def test_photo_is_taken_from_the_page(robot) -> None:
    assert await asyncio.to_thread(robot.media.snapshot) is None
    await robot.screen("screen", BLUE)
    await until(lambda: robot.media.camera.status == "live")
    frame = await asyncio.to_thread(robot.media.snapshot)
    assert (frame.width, frame.height) == (320, 240)
    seen = video_frame(frame).to_ndarray(format="rgb24").reshape(-1, 3).mean(axis=0)
    assert is_near(seen, BLUE)


async def test_drivers_video_is_never_used_as_the_robots(robot) -> None:
    viewer = await robot.viewer()
    page = robot.page("driver", SpeakingPage)
    robot.media.lease_changed("driver")
    page.send(hertz=300.0, colour=GREEN)
    await page.connect("driver")
    await robot.screen("screen", BLUE)
    await until(lambda: viewer.shows(BLUE))
    assert not any(
        abs(image.reshape(-1, 3).mean(axis=0)[1] - GREEN[1]) < 20 for image in viewer.images
    )


@pytest.mark.parametrize(
    ("sources", "directions"),
    [
        ({}, ["recvonly", "sendrecv", "sendonly"]),
        ({"video": None, "audio": None}, ["recvonly", "recvonly", "inactive"]),
    ],
    ids=["used", "not used"],
)
async def test_answer_requests_media_of_the_page_only_if_they_are_used(sources, directions) -> None:
    async with Robot(**sources) as robot:
        page = await robot.screen("screen", GREEN)
        assert [line.currentDirection for line in page.connection.getTransceivers()] == directions
