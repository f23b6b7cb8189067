"""One encoder a layer of quality: frames in, VP8 cut into RTP payloads out, shared by all viewers.

VP8 because every browser speaks it (Firefox has no H.264 of its own). libvpx in real-time mode, one
pass, no lag, constant bit rate. Its denoiser is off: it takes half of the encoder's time and a
rendered or well-lit picture gains nothing from it.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import av
from av.video.frame import PictureType
from av.video.reformatter import Interpolation, VideoReformatter

from robots.agent.media.pixels import YUV, video_frame
from robots.agent.media.rtp import VIDEO_RATE, vp8_payloads
from robots.agent.robot_interface import Frame


@dataclass(frozen=True)
class Tier:
    """A layer's size in pixels, frames a second and bit/s."""

    width: int
    height: int
    fps: int
    bitrate: int


TIER_480P = Tier(width=640, height=480, fps=30, bitrate=1_200_000)
# The best first. With sound and messages, the fourth fits through 400 kbit/s, the last through 200.
LAYERS = (
    TIER_480P,
    Tier(width=640, height=480, fps=30, bitrate=700_000),
    Tier(width=640, height=480, fps=15, bitrate=380_000),
    # larger pictures take twice as much where the whole image moves, however coarse they are
    Tier(width=480, height=360, fps=15, bitrate=200_000),
    Tier(width=320, height=240, fps=12, bitrate=110_000),
    Tier(width=320, height=240, fps=10, bitrate=80_000),
    Tier(width=320, height=240, fps=10, bitrate=50_000),
)


@dataclass(frozen=True)
class Picture:
    """An encoded frame: RTP payloads and time, key or not, capture stamp (Unix s), layer."""

    payloads: tuple[bytes, ...]
    key: bool
    rtp: int
    stamp: float
    layer: int = 0

    @property
    def size(self) -> int:
        """Return the bytes that one viewer is sent, without RTP headers."""
        return sum(map(len, self.payloads))


def fitted(tier: Tier, width: int, height: int) -> tuple[int, int]:
    """Return the even (width, height) inside the tier: same shape, never enlarged."""
    scale = min(1.0, tier.width / width, tier.height / height)
    return max(16, round(width * scale / 2) * 2), max(16, round(height * scale / 2) * 2)


def is_due(stamp: float, last: float | None, fps: int) -> bool:
    """Tell whether a stream of `fps` takes a frame; some of a faster camera are left out."""
    return last is None or not 0.0 <= stamp - last < 0.75 / fps


class PictureEncoder:
    """A VP8 encoder of one layer; belongs to its camera's thread."""

    def __init__(self, tier: Tier, layer: int = 0) -> None:
        self.tier, self.layer = tier, layer
        self._reformatter = VideoReformatter()
        self._codec: Any = None

    def encode(self, frame: Frame, ticks: int, rtp: int, *, key: bool) -> Picture | None:
        """Encode one frame, given its time by the camera's RTP clock; None when the encoder chose
        to drop it.

        Raises:
            ValueError: the image is not what its format says (see pixels.py).
            av.FFmpegError: the encoder failed.
        """
        picture = self._yuv(frame)
        codec = self._codec_for(picture.width, picture.height)
        picture.pts, picture.time_base = ticks, Fraction(1, VIDEO_RATE)
        picture.pict_type = PictureType.I if key else PictureType.NONE
        packets = codec.encode(picture)
        if not packets:
            return None
        payloads = vp8_payloads(b"".join(bytes(packet) for packet in packets))
        return Picture(payloads, any(p.is_keyframe for p in packets), rtp, frame.stamp, self.layer)

    def restart(self) -> None:
        """Start again with a key frame."""
        self._codec = None

    def _yuv(self, frame: Frame) -> av.VideoFrame:
        image, fit = video_frame(frame), fitted(self.tier, frame.width, frame.height)
        same = fit == (frame.width, frame.height)
        if same and frame.format == YUV:
            return image
        # POINT is the fastest for colours alone; one thread: a pool costs more than it saves
        interpolation = Interpolation.POINT if same else Interpolation.BILINEAR
        return self._reformatter.reformat(
            image, *fit, format="yuv420p", interpolation=interpolation, threads=1
        )

    def _codec_for(self, width: int, height: int) -> Any:
        if self._codec is None or (self._codec.width, self._codec.height) != (width, height):
            self._codec = open_vp8(self.tier, width, height)
        return self._codec


def open_vp8(tier: Tier, width: int, height: int) -> Any:
    """Return an open libvpx encoder; its rate cannot change later, only by opening another."""
    codec: Any = av.CodecContext.create("libvpx", "w")
    codec.width, codec.height, codec.pix_fmt = width, height, "yuv420p"
    codec.time_base, codec.framerate = Fraction(1, VIDEO_RATE), Fraction(tier.fps)
    codec.bit_rate, codec.gop_size = tier.bitrate, 3000
    codec.qmin, codec.qmax, codec.thread_count = 2, 56, 1
    rate = str(tier.bitrate)
    codec.options = {
        "deadline": "realtime",
        "cpu-used": "-12",
        "lag-in-frames": "0",
        "minrate": rate,  # min = max = rate is constant bit rate
        "maxrate": rate,
        "bufsize": rate,  # one second
        # % of a frame's share: a key frame must not fill a slow network for long
        "max-intra-rate": str(30 * tier.fps),
        "overshoot-pct": "15",
        "undershoot-pct": "100",
        "noise-sensitivity": "0",
        "static-thresh": "800",  # static areas cost half, moving ones look the same
    }
    return codec
