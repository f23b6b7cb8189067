"""A camera whose images the RCA publishes as JPEG or PNG: see robot_interface.VideoSource."""

import time
from typing import Any

import av
from av.video.reformatter import VideoReformatter

from robots.agent.devices.camera import picture_of
from robots.agent.devices.latest_value import LatestValue
from robots.agent.robot_interface import AdapterError, Frame

OPENING = 20.0  # s until the first picture: a publisher may be started by its first subscriber
CODECS = {b"\xff\xd8": "mjpeg", b"\x89P": "png"}


class TopicCamera:
    """The adapter's loop calls `take`, the media side's thread `read`, for the newest image."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._newest: LatestValue[tuple[bytes, float]] = LatestValue()
        self._reformatter = VideoReformatter()
        self._decoders: dict[str, Any] = {}
        self._awaited_since: float | None = None  # monotonic s, None once something came
        self.wanted = False

    def start(self) -> None:
        self._newest.put(None)
        self._awaited_since = time.monotonic()
        self.wanted = True

    def stop(self) -> None:
        self.wanted = False

    def take(self, data: bytes, stamp: float) -> None:
        """Take an image that was captured at `stamp`, Unix time."""
        self._newest.put((data, stamp))

    def read(self, timeout: float) -> Frame | None:
        """Block for the next image, at most `timeout` seconds; None without one. Raises
        AdapterError when images are malformed, or none is published.
        """
        newest = self._newest.take(timeout)
        if newest is None:
            if self._awaited_since is not None and time.monotonic() - self._awaited_since > OPENING:
                raise AdapterError(
                    f"no image on {self._topic} within {OPENING:g} s: check that "
                    "something publishes there"
                )
            return None
        self._awaited_since = None
        data, stamp = newest
        try:
            return Frame(picture_of(self._decoded(data), self._reformatter), stamp, "yuv420p")
        except (av.FFmpegError, ValueError) as error:
            raise AdapterError(f"an image on {self._topic} cannot be read: {error}") from error

    def _decoded(self, data: bytes) -> av.VideoFrame:
        name = CODECS.get(data[:2])
        if name is None:
            raise ValueError("it is neither JPEG nor PNG")
        if name not in self._decoders:
            decoder: Any = av.CodecContext.create(name, "r")
            decoder.thread_count = 1  # more would keep a picture back until the next one comes
            self._decoders[name] = decoder
        frames: list[av.VideoFrame] = self._decoders[name].decode(av.Packet(data))
        if not frames:
            raise ValueError("it is incomplete")
        return frames[0]
