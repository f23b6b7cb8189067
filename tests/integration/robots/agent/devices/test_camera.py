"""Cameras by device, file and address."""

import io
import time
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


def camera(said: str) -> DeviceCamera:
    return DeviceCamera(device_address.read(said, "camera"))


def next_picture(source: DeviceCamera):
    return next(frame for frame in (source.read(1.0) for _ in range(60)) if frame is not None)


@pytest.fixture
def film(tmp_path):
    """Half a second of pictures that become brighter, of an odd size."""
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


def test_a_generated_picture_has_videos_range_and_its_time(monkeypatch):
    source = camera("lavfi:color=white:size=320x240:rate=15")
    source.start()
    frame = next_picture(source)
    source.stop()
    assert (frame.width, frame.height, frame.format) == (320, 240, "yuv420p")
    assert frame.image[:240].mean() == pytest.approx(235.0, abs=1.0)
    assert 0.0 <= time.time() - frame.stamp < 30.0


def test_a_film_of_odd_size_is_played_at_its_pace_and_begins_again(film):
    source = camera(str(film))
    source.start()
    began = time.monotonic()
    seen = [next_picture(source) for _ in range(24)]
    lasted = time.monotonic() - began
    source.stop()
    assert {(frame.width, frame.height) for frame in seen} == {(160, 120)}
    assert all(after.stamp > before.stamp for before, after in pairwise(seen))
    brightness = [frame.image[:120].mean() for frame in seen]
    assert any(after < before - 100 for before, after in pairwise(brightness)), "it began again"
    assert lasted > 0.8, "24 pictures of 20 a second"


def test_a_picture_that_is_too_large_is_scaled_down():
    source = camera("lavfi:color=black:size=2560x1440:rate=5")
    source.start()
    frame = next_picture(source)
    source.stop()
    assert (frame.width, frame.height) == (LARGEST[0], 720)


def test_a_camera_that_is_not_there_is_said_in_a_sentence(tmp_path):
    source = camera(str(tmp_path / "nothing.mp4"))
    source.start()
    with pytest.raises(
        AdapterError, match=r"the camera .*nothing\.mp4 cannot be read: No such file or directory"
    ):
        [source.read(0.5) for _ in range(60)]
    source.stop()


def test_a_file_without_pictures_is_said_in_a_sentence(tmp_path):
    path = tmp_path / "sound.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        frame = av.AudioFrame.from_ndarray(
            np.zeros((1, 800), np.int16), format="s16", layout="mono"
        )
        frame.sample_rate = 8000
        for packet in stream.encode(frame):
            container.mux(packet)
    source = camera(str(path))
    source.start()
    with pytest.raises(AdapterError, match="it contains no video"):
        [source.read(0.5) for _ in range(60)]
    source.stop()


def test_a_camera_of_the_network_that_is_unplugged_says_so_and_goes_on_when_it_is_back():
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
    server = PictureServer()
    source = camera(server.words)
    source.start()
    first = next_picture(source)
    waits = source._newest
    assert eventually(lambda: waits._thing is not None and waits._thing[1] > first.stamp + 0.5), (
        "nothing of half a second ago is kept"
    )
    second = next_picture(source)
    source.stop()
    server.close()
    assert second.stamp > first.stamp + 0.5


def test_pictures_in_full_range_become_videos_range():
    server = PictureServer()
    source = camera(server.words)
    source.start()
    seen = [next_picture(source).image[:120].mean() for _ in range(12)]
    source.stop()
    server.close()
    assert min(seen) == pytest.approx(16.0, abs=2.0)
    assert max(seen) == pytest.approx(235.0, abs=2.0)


def test_the_encoder_takes_what_a_camera_gives():
    source = camera("lavfi:testsrc=size=322x242:rate=15")
    source.start()
    frame = next_picture(source)
    source.stop()
    picture = PictureEncoder(TIER_480P).encode(frame, 0, 0, key=True)
    assert picture.key
    assert picture.size > 500
    assert io.BytesIO(picture.payloads[0]).read(1)
