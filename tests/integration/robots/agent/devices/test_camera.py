"""Cameras by device, file and address."""

import contextlib
import time
from collections.abc import Iterator
from itertools import pairwise

import av
import numpy as np
import pytest

from robots.agent.devices import device_address
from robots.agent.devices.camera import LARGEST, DeviceCamera
from robots.agent.media.capture.camera import CameraFeed
from robots.agent.media.codecs.encoder import TIER_480P, PictureEncoder
from robots.agent.media.rtp import RtpClock
from robots.agent.robot_interface import AdapterError
from tests.support.agents.simulators import eventually
from tests.support.media.picture_server import PictureServer


def camera(setting: str) -> DeviceCamera:
    return DeviceCamera(device_address.read(setting, "camera"))


@contextlib.contextmanager
def started(setting: str) -> Iterator[DeviceCamera]:
    source = camera(setting)
    source.start()
    yield source
    source.stop()


def next_picture(source: DeviceCamera):
    return next(frame for frame in (source.read(1.0) for _ in range(60)) if frame is not None)


@pytest.fixture
def film(tmp_path):
    """Half a second of frames that become brighter, of an odd size."""
    path = tmp_path / "film.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=20)
        stream.width, stream.height, stream.pix_fmt = 161, 121, "yuv444p"
        for n in range(10):
            frame = av.VideoFrame.from_ndarray(
                np.full((121, 161, 3), 20 * n, np.uint8), format="rgb24"
            )
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def test_generated_frame_has_video_range_and_a_current_stamp():
    with started("lavfi:color=white:size=320x240:rate=15") as source:
        frame = next_picture(source)
    assert (frame.width, frame.height, frame.format) == (320, 240, "yuv420p")
    assert frame.image[:240].mean() == pytest.approx(235.0, abs=1.0)
    assert 0.0 <= time.time() - frame.stamp < 30.0


def test_film_of_odd_size_is_played_at_its_rate_and_restarts(film):
    with started(str(film)) as source:
        began = time.monotonic()
        seen = [next_picture(source) for _ in range(24)]
        lasted = time.monotonic() - began
    assert {(frame.width, frame.height) for frame in seen} == {(160, 120)}
    assert all(after.stamp > before.stamp for before, after in pairwise(seen))
    brightness = [frame.image[:120].mean() for frame in seen]
    assert any(after < before - 100 for before, after in pairwise(brightness)), "it did not restart"
    assert lasted > 0.8, "too fast for 24 frames at 20 Hz"


def test_too_large_frame_is_scaled_down():
    with started("lavfi:color=black:size=2560x1440:rate=5") as source:
        frame = next_picture(source)
    assert (frame.width, frame.height) == (LARGEST[0], 720)


def test_missing_file_is_reported(tmp_path):
    error = r"the camera .*nothing\.mp4 cannot be read: No such file or directory"
    with (
        started(str(tmp_path / "nothing.mp4")) as source,
        pytest.raises(AdapterError, match=error),
    ):
        next_picture(source)


def test_file_without_video_is_reported(tmp_path):
    path = tmp_path / "sound.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        frame = av.AudioFrame.from_ndarray(
            np.zeros((1, 800), np.int16), format="s16", layout="mono"
        )
        frame.sample_rate = 8000
        for packet in stream.encode(frame):
            container.mux(packet)
    with started(str(path)) as source, pytest.raises(AdapterError, match="it contains no video"):
        next_picture(source)


def test_unplugged_network_camera_is_reported_and_shown_when_it_is_back():
    server, pictures = PictureServer(), []
    feed = CameraFeed(camera(server.words), RtpClock(0), pictures.append)
    feed.start()
    feed.watch(1)
    try:
        assert eventually(lambda: feed.state.status == "live" and len(pictures) > 3)
        server.plugged.clear()
        assert eventually(lambda: feed.state.status == "failed")
        assert feed.state.reason.startswith(f"the camera {server.words.removesuffix('/')} ")
        server.plugged.set()
        seen = len(pictures)
        assert eventually(lambda: feed.state.status == "live" and len(pictures) > seen + 3)
    finally:
        feed.watch(-1)
        feed.close()
        server.close()


def test_newest_frame_replaces_unread_ones():
    with contextlib.closing(PictureServer()) as server, started(server.words) as source:
        first = next_picture(source)
        newest = source._newest
        assert eventually(lambda: newest._thing and newest._thing[1] > first.stamp + 0.5)
        assert next_picture(source).stamp > first.stamp + 0.5


def test_full_range_is_converted_to_video_range():
    with contextlib.closing(PictureServer()) as server, started(server.words) as source:
        seen = [next_picture(source).image[:120].mean() for _ in range(12)]
    assert min(seen) == pytest.approx(16.0, abs=2.0)
    assert max(seen) == pytest.approx(235.0, abs=2.0)


def test_encoder_accepts_camera_frames():
    with started("lavfi:testsrc=size=322x242:rate=15") as source:
        frame = next_picture(source)
    picture = PictureEncoder(TIER_480P).encode(frame, 0, 0, key=True)
    assert picture.key
    assert picture.size > 500
