"""A frame as a JPEG that fits into one message."""

import hashlib
from dataclasses import dataclass
from fractions import Fraction

import av
from av.video.codeccontext import VideoCodecContext

from robots.agent.media.pixels import video_frame
from robots.agent.robot_interface import Frame

LARGEST = 512 * 1024
# JPEG's quantizer scale in libavcodec: 2 is the best, 31 the smallest.
QUANTIZERS = (2, 4, 7, 12, 20, 31)


@dataclass(frozen=True)
class JpegPhoto:
    """An encoded picture, its hash, and when the camera sampled it."""

    jpeg: bytes
    sha256: str
    stamp: float


def encode_jpeg(frame: Frame, largest: int = LARGEST) -> JpegPhoto | None:
    """Return the best JPEG of at most `largest` bytes, None if none fits; takes milliseconds."""
    picture = video_frame(frame).reformat(format="yuvj420p")
    for quantizer in QUANTIZERS:
        jpeg = _encode(picture, quantizer)
        if len(jpeg) <= largest:
            return JpegPhoto(jpeg, hashlib.sha256(jpeg).hexdigest(), frame.stamp)
    return None


def reduced(frame: Frame, width: int, height: int, quantizer: int) -> bytes:
    """Return a JPEG of (width, height), both even; quantizer 2 (best) to 31 (smallest)."""
    picture = video_frame(frame).reformat(width=width, height=height, format="yuvj420p")
    return _encode(picture, quantizer)


def _encode(picture: av.VideoFrame, quantizer: int) -> bytes:
    codec = VideoCodecContext.create("mjpeg", "w")
    assert isinstance(codec, VideoCodecContext)
    codec.width = picture.width
    codec.height = picture.height
    codec.pix_fmt = "yuvj420p"
    codec.time_base = Fraction(1, 1)
    codec.options = {"qmin": str(quantizer), "qmax": str(quantizer), "flags": "+qscale"}
    return b"".join(bytes(packet) for packet in (*codec.encode(picture), *codec.encode(None)))
