"""The video encoder, and when it makes key frames."""

from fractions import Fraction

import av
import numpy as np
import pytest

from robots.agent.media.codecs.encoder import (
    TIER_480P,
    Picture,
    PictureEncoder,
    Tier,
    fitted,
    is_due,
)
from robots.agent.media.codecs.key_frames import KeyFrames
from robots.agent.media.pixels import video_frame
from robots.agent.media.rtp import RtpClock
from robots.agent.robot_interface import Frame
from tests.support.media.synthetic_camera import SyntheticCamera, code_of, read_code


class _Encoder(PictureEncoder):
    """An encoder with the RTP clock of its camera."""

    def __init__(self, tier: Tier = TIER_480P) -> None:
        super().__init__(tier)
        self.clock = RtpClock(origin=1)

    def of(self, frame: Frame, *, key: bool) -> Picture | None:
        ticks = self.clock.tick(frame.stamp)
        return self.encode(frame, ticks, self.clock.timestamp(ticks), key=key)


def _decoded(pictures: list[Picture]) -> list[av.VideoFrame]:
    codec = av.CodecContext.create("libvpx", "r")
    frames = []
    for number, picture in enumerate(pictures):
        packet = av.Packet(b"".join(payload[1:] for payload in picture.payloads))
        packet.pts, packet.time_base = number, Fraction(1, 30)
        frames += codec.decode(packet)
    return frames


def test_decoded_pictures_are_like_the_camera_frames() -> None:
    camera, encoder = SyntheticCamera(fps=1e6), _Encoder()
    frames = [camera._frame(100.0 + n / 30) for n in range(20)]
    decoded = [
        f.to_ndarray(format="rgb24")
        for f in _decoded([encoder.of(frame, key=False) for frame in frames])
    ]
    assert [read_code(image) for image in decoded] == [code_of(frame.stamp) for frame in frames]
    error = np.mean((decoded[-1].astype(float) - frames[-1].image) ** 2)
    assert 10 * np.log10(255**2 / error) > 28, "decibels of signal to noise"


def test_only_first_and_requested_pictures_are_key_frames() -> None:
    camera, encoder = SyntheticCamera(fps=1e6), _Encoder()
    pictures = [encoder.of(camera._frame(100.0 + n / 30), key=n == 5) for n in range(10)]
    assert [p.key for p in pictures] == [n in (0, 5) for n in range(10)]
    encoder.restart()
    assert encoder.of(camera._frame(101.0), key=False).key


def test_bitrate_stays_near_that_of_the_tier() -> None:
    camera, encoder = SyntheticCamera(fps=1e6), _Encoder()
    size = sum(encoder.of(camera._frame(100.0 + n / 30), key=False).size for n in range(150))
    assert size * 8 / 5.0 < 1.2 * TIER_480P.bitrate


def test_larger_frames_are_scaled_into_the_tier_in_proportion() -> None:
    assert fitted(TIER_480P, 1280, 720) == (640, 360)
    assert fitted(TIER_480P, 320, 240) == (320, 240)
    assert fitted(TIER_480P, 1080, 1920) == (270, 480)
    for wide in (
        Frame(np.full((720, 1280, 3), 90, dtype=np.uint8), 1.0),
        Frame(np.full((1080, 1280), 128, dtype=np.uint8), 1.0, "yuv420p"),
    ):
        frame = _decoded([_Encoder().of(wide, key=True)])[0]
        assert (frame.width, frame.height) == (640, 360)


def test_camera_that_changes_its_size_restarts_with_a_key_frame() -> None:
    encoder = _Encoder()
    small, large = np.zeros((240, 320, 3), np.uint8), np.zeros((480, 640, 3), np.uint8)
    pictures = [
        encoder.of(Frame(image, 1.0 + n / 30), key=False)
        for n, image in enumerate([small, small, large, large])
    ]
    assert [p.key for p in pictures] == [True, False, True, False]


def test_yuv_frame_is_encoded_like_the_rgb_frame() -> None:
    source = SyntheticCamera(fps=1e6)._frame(100.0)
    planes = video_frame(source).reformat(format="yuv420p").to_ndarray()
    frame = Frame(planes, source.stamp, "yuv420p")
    assert (frame.width, frame.height) == (640, 480) == (source.width, source.height)
    decoded = _decoded([_Encoder().of(frame, key=True)])[0].to_ndarray(format="rgb24")
    assert read_code(decoded) == code_of(source.stamp)
    assert np.abs(decoded.astype(float) - source.image).mean() < 8


@pytest.mark.parametrize(
    "frame",
    [
        Frame(np.zeros((480, 640), np.uint8), 1.0),
        Frame(np.zeros((480, 640, 3), np.float32), 1.0),
        Frame(np.zeros((480, 640, 4), np.uint8), 1.0),
        Frame(np.zeros((480, 640, 3), np.uint8), 1.0, "yuv420p"),
        Frame(np.zeros((721, 640), np.uint8), 1.0, "yuv420p"),
        Frame(np.zeros((720, 641), np.uint8), 1.0, "yuv420p"),
    ],
)
def test_invalid_image_is_refused(frame: Frame) -> None:
    with pytest.raises(ValueError):
        _Encoder().of(frame, key=False)


def test_excess_frames_of_a_faster_camera_are_skipped() -> None:
    last, kept = None, 0
    for n in range(120):
        if is_due(n / 60, last, 30):
            last, kept = n / 60, kept + 1
    assert kept == 60
    assert is_due(5.0, 9.0, 30), "the clock was set back"


def test_new_viewer_gets_a_key_frame_at_once_and_losses_wait() -> None:
    keys = KeyFrames()
    assert not keys.is_due(0.0)
    keys.ask("lost")
    assert keys.is_due(0.0)
    keys.made(0.0)
    keys.ask("lost")
    assert not keys.is_due(0.1)
    assert keys.is_due(0.3), "a delayed request was lost"
    keys.ask("joined")
    assert keys.is_due(0.1)
    keys.made(0.1)
    keys.ask("behind")
    assert not keys.is_due(1.0)
    assert keys.is_due(2.2)
