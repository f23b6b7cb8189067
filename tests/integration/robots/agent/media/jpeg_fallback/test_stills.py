"""Pictures through the server are made on request; without requests the camera is stopped."""

import threading
import time

import av
import numpy as np
import pytest

from robots.agent.media.jpeg_fallback.stills import LIMIT, JpegFallback
from robots.agent.robot_interface import Frame
from robots.api import picture
from robots.api.messages import PictureRequest
from tests.support.media.loopback_peer import MediaRig, until


class Viewer:
    """A page that requests pictures, and a camera that counts its snapshots."""

    def __init__(self, frames):
        self.arrived, self.frames, self.taken = [], frames, 0
        self.news = threading.Condition()
        self.pictures = JpegFallback(self.snapshot, self.take, lambda peer: peer == "driver")

    def snapshot(self):
        self.taken += 1
        return self.frames()

    def take(self, payload, _peers):
        with self.news:
            self.arrived.append(picture.unpack(payload))
            self.news.notify_all()

    def ask(self, peer="driver", seen=None):
        self.pictures.ask(peer, PictureRequest(stamp=time.time(), seen=seen, round_trip=0.0))

    def wait(self, number):
        with self.news:
            assert self.news.wait_for(lambda: len(self.arrived) >= number, timeout=20.0)
        return self.arrived[number - 1]


@pytest.fixture
def viewer():
    rng = np.random.default_rng(3)
    made = Viewer(lambda: Frame(rng.integers(0, 255, (480, 640, 3), dtype=np.uint8), time.time()))
    yield made
    made.pictures.close()


def size(jpeg):
    frame = av.CodecContext.create("mjpeg", "r").decode(av.Packet(jpeg))[0]
    return frame.width, frame.height


def test_each_request_gets_one_picture_with_its_time(viewer):
    before = time.time()
    viewer.ask()
    stamp, jpeg = viewer.wait(1)
    assert before <= stamp <= time.time()
    assert size(jpeg)[0] <= 480
    assert size(jpeg)[0] * 3 == size(jpeg)[1] * 4
    viewer.ask("other")
    assert viewer.pictures.watching() == {"driver", "other"}
    assert viewer.taken == 1


def test_repeated_requests_get_new_pictures(viewer):
    viewer.ask()
    for number in range(1, 6):
        viewer.ask(seen=viewer.wait(number)[0])
    assert viewer.wait(6)[0] > viewer.wait(1)[0]


def test_picture_of_pure_noise_fits_into_its_message(viewer):
    viewer.ask()
    for number in range(1, 15):
        viewer.ask(seen=viewer.wait(number)[0])
    assert max(len(picture.pack(stamp, jpeg)) for stamp, jpeg in viewer.arrived) <= LIMIT


def test_failed_and_malformed_frames_are_skipped():
    frames = iter(
        [
            None,
            Frame(np.zeros((4, 4), dtype=np.uint8), 1.0),
            Frame(np.zeros((480, 640, 3), dtype=np.uint8), 2.0),
        ]
    )
    viewer = Viewer(lambda: next(frames))
    viewer.ask()
    assert viewer.wait(1)[0] == 2.0
    viewer.pictures.close()


async def test_fallback_viewers_are_counted_and_the_camera_stops_after_them(camera):
    pictures = []
    take = lambda payload, _peer: pictures.append(payload)
    async with MediaRig(video=camera, on_picture=take) as rig:
        rig.media.picture_wanted(PictureRequest(stamp=1.0, peer="p1"))
        await until(lambda: pictures)
        assert rig.media.connected == 1
        assert abs(picture.unpack(pictures[0])[0] - time.time()) < 5.0
        await until(lambda: not camera.running)
        await until(lambda: rig.media.connected == 0)


async def test_robot_without_a_camera_sends_no_pictures():
    async with MediaRig(on_picture=lambda *_: pytest.fail("a picture")) as rig:
        rig.media.picture_wanted(PictureRequest(stamp=1.0, peer="p1"))
        assert rig.media.connected == 0
