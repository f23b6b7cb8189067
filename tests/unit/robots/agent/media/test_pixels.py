"""Pictures of both formats as frames of a video."""

import numpy as np
import pytest

from robots.agent.media.photos import encode_jpeg
from robots.agent.media.pixels import video_frame
from robots.agent.robot_interface import Frame
from tests.support.media.synthetic_camera import SyntheticCamera


def test_both_formats_become_the_same_picture() -> None:
    source = SyntheticCamera(fps=1e6)._frame(100.0)
    planes = video_frame(source).reformat(format="yuv420p").to_ndarray()
    back = video_frame(Frame(planes, 1.0, "yuv420p")).to_ndarray(format="rgb24")
    assert np.abs(back.astype(float) - source.image).mean() < 6


def test_a_photo_is_taken_of_both_formats() -> None:
    source = SyntheticCamera(fps=1e6)._frame(100.0)
    planes = video_frame(source).reformat(format="yuv420p").to_ndarray()
    for frame in (source, Frame(planes, 1.0, "yuv420p")):
        photo = encode_jpeg(frame)
        assert photo is not None
        assert photo.jpeg.startswith(b"\xff\xd8")


@pytest.mark.parametrize(
    "frame",
    [
        Frame(np.zeros((720, 640), np.uint8), 1.0),
        Frame(np.zeros((480, 640, 3), np.uint8), 1.0, "yuv420p"),
        Frame(np.zeros((720, 640), np.float32), 1.0, "yuv420p"),
        Frame(np.zeros((0, 640), np.uint8), 1.0, "yuv420p"),
        Frame(np.zeros((719, 640), np.uint8), 1.0, "yuv420p"),
    ],
)
def test_image_that_does_not_match_its_format_is_refused(frame: Frame) -> None:
    with pytest.raises(ValueError):
        video_frame(frame)
