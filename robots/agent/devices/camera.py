"""A camera by device, file or address: a robot_interface.VideoSource."""

from typing import Any

import av
import numpy as np
import numpy.typing as npt
from av.video.reformatter import ColorRange, VideoReformatter

from robots.agent.devices.device_address import DeviceSetting
from robots.agent.devices.latest_value import LatestValue
from robots.agent.devices.reader import DeviceReader
from robots.agent.robot_interface import Frame

LARGEST = (1280, 960)  # pixels: more is scaled down at once, because no stream of ours is larger


class DeviceCamera:
    """See robot_interface.VideoSource. Of unread frames only the newest counts."""

    def __init__(self, words: DeviceSetting) -> None:
        self._reader = DeviceReader("camera", words, "video", self._take)
        self._newest: LatestValue[tuple[Any, float]] = LatestValue()
        self._reformatter = VideoReformatter()

    def start(self) -> None:
        self._newest.put(None)
        self._reader.start()

    def stop(self) -> None:
        self._reader.stop()

    def read(self, timeout: float) -> Frame | None:
        """Block for the next frame, for `timeout` s at most; None without one, or AdapterError."""
        newest = self._newest.take(timeout if not self._reader.failed else 0.0)
        if newest is None:
            self._reader.check()
            return None
        return Frame(picture_of(newest[0], self._reformatter), newest[1], "yuv420p")

    def _take(self, frame: Any, stamp: float) -> None:
        self._newest.put((frame, stamp))


def picture_of(frame: av.VideoFrame, reformatter: VideoReformatter) -> npt.NDArray[np.uint8]:
    """Return a frame as yuv420p for `Frame`: even sides, at most LARGEST, video's range."""
    scale = min(1.0, LARGEST[0] / frame.width, LARGEST[1] / frame.height)
    width, height = (max(2, int(side * scale) // 2 * 2) for side in (frame.width, frame.height))
    same = reformatter.reformat(
        frame, width, height, format="yuv420p", dst_color_range=ColorRange.MPEG, threads=1
    )
    return np.ascontiguousarray(same.to_ndarray(), dtype=np.uint8)
