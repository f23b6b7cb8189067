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
def feed_of(url: str):
    """Yield a watched feed, its pictures and its states."""
    pictures, states = [], []
    feed = CameraFeed(
        DeviceCamera(device_address.read(url, "camera")), RtpClock(0), pictures.append
    )
    set_state = feed._set_state

    def record(status, reason=""):
        states.append(CaptureState(status, reason))
        set_state(status, reason)

    feed._set_state = record
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


def reason_for(url: str) -> str:
    with feed_of(url) as (feed, _pictures, _states):
        assert eventually(lambda: feed.state.reason != "", 30.0)
        return feed.state.reason


@pytest.mark.nightly
def test_camera_with_a_key_frame_every_4_s_is_shown_from_the_next_one_twice_in_a_row(server):
    for _ in range(2):
        began = time.monotonic()
        with feed_of(server.url) as (feed, pictures, states):
            assert eventually(lambda: len(pictures) > 5, 30.0)
            assert feed.state == CaptureState("live")
        before = states[: states.index(CaptureState("live"))]
        assert {state.status for state in before} == {"starting"}
        assert time.monotonic() - began < 15.0


@pytest.mark.nightly
def test_second_viewer_gets_pictures_at_once(server):
    with feed_of(server.url) as (feed, pictures, states):
        assert eventually(lambda: len(pictures) > 2, 30.0)
        feed.watch(1)
        seen = len(pictures)
        assert eventually(lambda: len(pictures) > seen + 5)
        feed.watch(-1)
        assert [state.status for state in states].count("starting") == 1


@pytest.mark.nightly
def test_photo_waits_for_a_camera_that_starts(server):
    camera = DeviceCamera(device_address.read(server.url, "camera"))
    feed = CameraFeed(camera, RtpClock(0), lambda _picture: None)
    feed.start()
    with contextlib.closing(feed):
        assert feed.snapshot() is not None


def test_camera_with_a_password_is_shown(protected):
    with feed_of(protected.url_for("ana", SECRET)) as (feed, pictures, _states):
        assert eventually(lambda: len(pictures) > 2, 30.0)
        assert feed.state.status == "live"


@pytest.mark.parametrize("password", ["wrong", "none"])
def test_wrong_password_is_reported_and_not_logged(protected, password, caplog):
    caplog.set_level(logging.DEBUG)
    wrong = protected.url_for("ana", f"not-{SECRET}")
    reason = reason_for(protected.url if password == "none" else wrong)
    address = f"rtsp://127.0.0.1:{protected.port}"
    assert reason == f"the camera {address} cannot be read: wrong user name or password (401)"
    assert SECRET not in caplog.text


def test_missing_camera_is_reported(server):
    for url, port, reason in (
        (server.url.replace("/stream", "/stream2"), server.port, "it has no such stream (404)"),
        ("rtsp://127.0.0.1:1/stream", 1, "connection refused"),
    ):
        expected = f"the camera rtsp://127.0.0.1:{port} cannot be read: {reason}"
        assert reason_for(url) == expected


@pytest.mark.nightly
def test_silent_camera_and_one_without_key_frames_have_different_errors(server):
    limits = ReaderLimits(opening=1.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"rtsp://127.0.0.1:{silent.getsockname()[1]}/stream"
        assert opening_fails(url, limits).endswith(" does not answer within 1.5 s")
    # The next key frame is 4 s away when the reader starts.
    with feed_of(server.url) as (_feed, pictures, _states):
        assert eventually(lambda: bool(pictures), 30.0)
    assert opening_fails(server.url, limits).endswith(" has sent no key frame within 1.5 s")


def opening_fails(url: str, limits: ReaderLimits) -> str:
    seen, place = [], device_address.read(url, "camera")
    take = lambda frame, _stamp: seen.append(frame)
    reader = DeviceReader("camera", place, "video", take, limits)
    reader.start()
    try:
        deadline = time.monotonic() + 10.0
        while not seen and time.monotonic() < deadline:
            try:
                reader.check()
            except AdapterError as error:
                return str(error)
            time.sleep(0.02)
        return "opened" if seen else "no error"
    finally:
        reader.stop()


@pytest.mark.nightly
@pytest.mark.parametrize("way", ["pulled", "frozen"])
def test_lost_camera_is_reported_and_shown_again_when_it_is_back(way):
    with rtsp_server(key_interval=1.0) as server, feed_of(server.url) as (feed, pictures, _states):
        for _ in range(2):
            assert eventually(lambda: feed.state.status == "live" and len(pictures) > 2, 30.0)
            (server.pull if way == "pulled" else server.freeze)()
            assert eventually(lambda: feed.state.reason != "", 30.0)
            (server.plug if way == "pulled" else server.thaw)()
            assert eventually(lambda: feed.state == CaptureState("live"), 30.0)
            pictures.clear()
