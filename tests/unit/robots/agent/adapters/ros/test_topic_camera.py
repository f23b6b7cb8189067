"""A camera whose pictures are published."""

import numpy as np
import pytest

from robots.agent.adapters.ros import messages, topic_camera
from robots.agent.adapters.ros.topic_camera import TopicCamera
from robots.agent.robot_interface import AdapterError
from robots.world.grid import encode_png
from tests.support.media.picture_server import jpeg_of


def png_of(grey: int) -> bytes:
    return encode_png(np.full((48, 64), grey, np.uint8))


def test_the_newest_picture_counts_in_any_format():
    camera = TopicCamera("/camera")
    camera.start()
    for stamp, picture in ((1.0, jpeg_of(0)), (2.0, jpeg_of(255)), (3.0, png_of(255))):
        camera.take(picture, stamp)
    frame = camera.read(0.0)
    assert (frame.width, frame.height, frame.stamp) == (64, 48, 3.0)
    assert frame.image[:48].mean() == pytest.approx(235.0, abs=1.0)
    assert camera.read(0.0) is None
    camera.take(jpeg_of(0), 4.0)
    assert camera.read(0.0).image[:120].mean() == pytest.approx(16.0, abs=1.0)


@pytest.mark.parametrize(
    "rubbish",
    [b"", b"no picture", jpeg_of(0)[:40], png_of(0)[:30]],
    ids=["nothing", "words", "half a JPEG", "half a PNG"],
)
def test_a_malformed_image_is_an_error_and_the_next_one_is_shown(rubbish):
    camera = TopicCamera("/camera")
    camera.start()
    camera.take(rubbish, 1.0)
    with pytest.raises(AdapterError, match="an image on /camera cannot be read: "):
        camera.read(0.0)
    camera.take(jpeg_of(255), 2.0)
    assert camera.read(0.0).stamp == 2.0


@pytest.mark.parametrize("data", ["not base64!", [1, 2, 300], {"a": 1}, 3.5])
def test_a_message_without_bytes_is_refused(data):
    with pytest.raises(messages.RosError, match="invalid image"):
        messages.picture_in({"data": data})


def test_a_topic_without_images_is_an_error_until_the_first_one(monkeypatch):
    monkeypatch.setattr(topic_camera, "OPENING", 0.05)
    camera = TopicCamera("/camera")
    for _ in range(2):
        camera.start()
        with pytest.raises(AdapterError, match=r"no image on /camera within 0\.05 s: check"):
            [camera.read(0.03) for _ in range(60)]
        camera.take(jpeg_of(255), 1.0)
        assert camera.read(0.0).stamp == 1.0
        assert camera.read(0.1) is None
        camera.stop()
