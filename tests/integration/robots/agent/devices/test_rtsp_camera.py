"""Network cameras on a real RTSP server: sparse key frames, passwords, reconnection."""

import contextlib
import logging
import socket
import time

import pytest

from robots.agent.devices import device_address
from robots.agent.devices.camera import DeviceCamera
from robots.agent.devices.reader import DeviceReader, ReaderLimits
from robots.agent.media.capture.camera import CameraFeed
from robots.agent.media.capture.capture import CaptureState
from robots.agent.media.rtp import RtpClock
from robots.agent.robot_interface import AdapterError
from tests.support.agents.simulators import eventually
from tests.support.programs.rtsp_server import rtsp_server

SECRET = "hunter2"


@contextlib.contextmanager
def feed_of(said: str):
    """A watched feed, its images and its states."""
    pictures, states = [], []
    feed = CameraFeed(
        DeviceCamera(device_address.read(said, "camera")), RtpClock(0), pictures.append
    )
    tell = feed._set_state

    def told(status, reason=""):
        states.append(CaptureState(status, reason))
        tell(status, reason)

    feed._set_state = told
    feed.start()
    feed.watch(1)
    try:
        yield feed, pictures, states
    finally:
        feed.watch(-1)
        feed.close()


@pytest.fixture(scope="module")
def server():
    with rtsp_server(key_interval=4.0) as running:
        yield running


@pytest.fixture(scope="module")
def protected():
    with rtsp_server(key_interval=1.0, credentials=("ana", SECRET)) as running:
        yield running


def reason_for(said: str) -> str:
    with feed_of(said) as (feed, _pictures, _states):
        assert eventually(lambda: feed.state.reason != "", 30.0)
        return feed.state.reason


@pytest.mark.nightly
def test_a_camera_with_four_seconds_between_whole_pictures_is_shown_at_the_next_one_twice_in_a_row(
    server,
):
    for _ in range(2):
        began = time.monotonic()
        with feed_of(server.url) as (feed, pictures, states):
            assert eventually(lambda: len(pictures) > 5, 30.0)
            assert feed.state == CaptureState("live")
        assert {state.status for state in states[: states.index(CaptureState("live"))]} == {
            "starting"
        }, "nothing was given up on the way"
        assert time.monotonic() - began < 15.0


@pytest.mark.nightly
def test_the_second_who_watches_waits_for_nothing(server):
    with feed_of(server.url) as (feed, pictures, states):
        assert eventually(lambda: len(pictures) > 2, 30.0)
        feed.watch(1)
        seen = len(pictures)
        assert eventually(lambda: len(pictures) > seen + 5)
        feed.watch(-1)
        assert [state.status for state in states].count("starting") == 1


@pytest.mark.nightly
def test_a_photo_waits_for_a_camera_that_starts(server):
    feed = CameraFeed(
        DeviceCamera(device_address.read(server.url, "camera")), RtpClock(0), lambda _picture: None
    )
    feed.start()
    try:
        assert feed.snapshot() is not None
    finally:
        feed.close()


def test_a_camera_with_a_password_is_shown(protected):
    with feed_of(protected.url_for("ana", SECRET)) as (feed, pictures, _states):
        assert eventually(lambda: len(pictures) > 2, 30.0)
        assert feed.state.status == "live"


@pytest.mark.parametrize("way", ["wrong", "none"])
def test_a_wrong_password_is_said_and_no_password_is_told(protected, way, caplog):
    caplog.set_level(logging.DEBUG)
    reason = reason_for(
        protected.url if way == "none" else protected.url_for("ana", f"not-{SECRET}")
    )
    assert (
        reason == f"the camera rtsp://127.0.0.1:{protected.port} cannot be read: wrong user name or"
        " password (401)"
    )
    assert SECRET not in caplog.text


def test_missing_camera_is_reported(server):
    there = f"the camera rtsp://127.0.0.1:{server.port} cannot be read: "
    assert (
        reason_for(server.url.replace("/stream", "/stream2"))
        == f"{there}it has no such stream (404)"
    )
    assert (
        reason_for("rtsp://127.0.0.1:1/stream")
        == "the camera rtsp://127.0.0.1:1 cannot be read: connection refused"
    )


@pytest.mark.nightly
def test_a_camera_that_says_nothing_and_one_without_whole_pictures_are_told_apart(server):
    limits = ReaderLimits(opening=1.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"rtsp://127.0.0.1:{silent.getsockname()[1]}/stream"
        assert opening_fails(url, limits).endswith(" does not answer within 1.5 s")
    # The last whole picture has just gone by when this one begins.
    with feed_of(server.url) as (_feed, pictures, _states):
        assert eventually(lambda: bool(pictures), 30.0)
    assert opening_fails(server.url, limits).endswith(" has sent no key frame within 1.5 s")


def opening_fails(url: str, limits: ReaderLimits) -> str:
    seen = []
    reader = DeviceReader(
        "camera",
        device_address.read(url, "camera"),
        "video",
        lambda frame, _stamp: seen.append(frame),
        limits,
    )
    reader.start()
    try:
        deadline = time.monotonic() + 10.0
        while not seen and time.monotonic() < deadline:
            try:
                reader.check()
            except AdapterError as error:
                return str(error)
            time.sleep(0.02)
        return "opened" if seen else "nothing was said"
    finally:
        reader.stop()


@pytest.mark.nightly
@pytest.mark.parametrize("way", ["pulled", "frozen"])
def test_a_camera_that_goes_is_said_and_shown_again_when_it_is_back(way):
    with rtsp_server(key_interval=1.0) as server, feed_of(server.url) as (feed, pictures, _states):
        for _ in range(2):
            assert eventually(lambda: feed.state.status == "live" and len(pictures) > 2, 30.0)
            (server.pull if way == "pulled" else server.freeze)()
            assert eventually(lambda: feed.state.reason != "", 30.0)
            (server.plug if way == "pulled" else server.thaw)()
            assert eventually(lambda: feed.state == CaptureState("live"), 30.0)
            pictures.clear()
