"""The visitor's voice and video, from the driver's page to the robot's outputs and its screen."""

from collections.abc import AsyncIterator

import numpy as np
import pytest

from robots.agent.media.rtp import JoinedTicks
from robots.api.codec import encode_frame
from robots.api.messages import CallState, CommandHeartbeat
from robots.simulator.outputs import MeasuringDisplay, MeasuringSpeaker
from tests.support.browsers.visitor_tracks import SpeakingPage
from tests.support.media.loopback_peer import LoopbackPage, MediaRig, is_near, until
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone

HERTZ, RED = 700.0, (200, 30, 30)


class Robot(MediaRig):
    """A robot with a loudspeaker and a display."""

    def __init__(self) -> None:
        self.speaker, self.display = MeasuringSpeaker(), MeasuringDisplay()
        outputs = (self.speaker, self.display)
        super().__init__(video=SyntheticCamera(), audio=SyntheticMicrophone(), outputs=outputs)

    async def visitor(self, peer: str, *, drives: bool = True) -> SpeakingPage:
        page = self.page(peer, SpeakingPage)
        if drives:
            self.media.lease_changed(peer)
        page.send(hertz=HERTZ, colour=RED)
        await page.connect("driver")
        return page

    async def screen(self) -> LoopbackPage:
        page = self.page("screen")
        await page.connect("screen")
        return page

    def refused(self, reason: str) -> int:
        """Return how many packets and pictures of pages were dropped for this reason."""
        return self.media.visitor.counts.get(reason, 0)


@pytest.fixture
async def robot() -> AsyncIterator[Robot]:
    async with Robot() as robot:
        yield robot


async def test_drivers_tone_and_colour_reach_loudspeaker_and_display(robot) -> None:
    await robot.visitor("p1")
    robot.media.let_through(audio=True, video=True)
    await until(lambda: robot.speaker.played > 24_000 and is_near(robot.display.colour, RED))
    # A sine at half of full scale, mixed down; late sound is replaced by silence.
    await until(
        lambda: abs(robot.speaker.tone - HERTZ) < 5 and 0.15 < robot.speaker.level < 0.45,
        what="the tone at its level",
    )


async def test_visitor_is_sent_to_the_screen_while_the_loudspeaker_is_silent(robot) -> None:
    screen = await robot.screen()
    page = await robot.visitor("p1")
    robot.media.let_through(audio=True, video=True)
    await until(lambda: screen.shows(RED) and screen.sounds > 10)
    assert robot.media.screens == 1
    assert robot.speaker.played == 0
    assert page.images, "the visitor lost the robot's video"
    assert robot.media.connected == 1, "the screen counts as a viewer"


def confirmed(robot: Robot, status: str = "accepted") -> tuple[bool | None, bool | None]:
    call = robot.media.confirm(CallState(status=status, audio=True, video=True))
    return (call.shown, call.audible)


async def test_visitor_is_seen_and_heard_by_the_robots_own_devices(robot) -> None:
    assert confirmed(robot) == (True, True)
    assert confirmed(robot, "ringing") == (False, False)
    call = CallState(status="accepted", audio=True, video=False)
    assert robot.media.confirm(call).shown is False
    assert robot.media.confirm(None) is None


async def test_visitor_is_seen_and_heard_at_a_screen_only_as_it_reports(robot) -> None:
    screen = await robot.screen()
    assert confirmed(robot) == (False, False), "its own devices are silent now"
    for shows, plays in ((True, False), (True, True), (False, True)):
        beat = CommandHeartbeat(n=1, stamp=1.0, shows=shows, plays=plays)
        screen.channel.send(encode_frame("command/heartbeat", beat))
        await until(lambda shows=shows, plays=plays: confirmed(robot) == (shows, plays))
    await screen.close()
    await until(lambda: robot.media.screens == 0)
    assert confirmed(robot) == (True, True), "its own devices take over"


async def test_nobody_sees_or_hears_the_visitor_at_a_robot_without_devices() -> None:
    async with MediaRig(video=SyntheticCamera()) as bare:
        assert confirmed(bare) == (False, False)


async def test_visitor_media_pass_only_during_the_call(robot) -> None:
    await robot.visitor("p1")
    await until(lambda: robot.refused("not_let_through") > 20)
    assert (robot.speaker.played, robot.display.shown) == (0, 0)
    robot.media.let_through(audio=True, video=False)
    await until(lambda: robot.speaker.played > 0)
    robot.media.let_through(audio=False, video=False)
    for _ in range(2):  # until media in transit have arrived
        refused = robot.refused("not_let_through")
        await until(lambda refused=refused: robot.refused("not_let_through") > refused + 20)
    played, refused = robot.speaker.played, robot.refused("not_let_through")
    await until(lambda: robot.refused("not_let_through") > refused + 20)
    assert robot.speaker.played == played
    assert robot.display.shown == 0


async def test_observers_media_are_counted_and_dropped(robot) -> None:
    robot.media.let_through(audio=True, video=True)
    await robot.visitor("p1", drives=False)
    await until(lambda: robot.refused("not_driver") > 20)
    assert (robot.speaker.played, robot.display.shown) == (0, 0)


async def test_voice_of_an_earlier_driver_is_dropped(robot) -> None:
    robot.media.let_through(audio=True, video=True)
    await robot.visitor("p1")
    await until(lambda: robot.speaker.played > 0)
    robot.media.lease_changed("p2")
    await until(lambda: robot.refused("not_driver") > 20)


async def test_late_screen_starts_with_a_key_frame(robot) -> None:
    await robot.visitor("p1")
    robot.media.let_through(audio=True, video=True)
    await until(lambda: robot.display.shown > 5)
    screen = await robot.screen()
    await until(lambda: screen.pictures)
    assert screen.pictures[0][1], "a key frame"


async def test_volume_set_by_the_visitor_is_that_of_the_loudspeaker(robot) -> None:
    await robot.visitor("p1")
    robot.media.let_through(audio=True, video=False, volume=0.25)
    await until(lambda: robot.speaker.played > 48_000)
    assert 0.03 < robot.speaker.level < 0.13


def test_ticks_of_several_sources_are_joined_to_one_count() -> None:
    clock = JoinedTicks(960)
    counted = [
        clock.tick("a", 0),
        clock.tick("a", 960),
        clock.tick("b", 5_000_000),
        clock.tick("b", 5_000_960),
        clock.tick("a", 0),
    ]
    assert counted == [960, 1920, 2880, 3840, 4800]


def test_loudspeaker_measures_no_tone_in_silence() -> None:
    speaker = MeasuringSpeaker()
    assert (speaker.level, speaker.tone) == (0.0, 0.0)
    speaker.play(np.zeros(960, dtype=np.int16))
    assert (speaker.level, speaker.tone, speaker.played) == (0.0, 0.0, 960)
