"""A microphone by device, file or address that FFmpeg reads; for Linux's own see alsa.py."""

import threading
from collections import deque
from typing import Any

import av
import numpy as np
import numpy.typing as npt

from robots.agent.devices.device_address import DeviceSetting
from robots.agent.devices.reader import DeviceReader

RATE, BLOCK = 48_000, 960  # samples a second, and in 20 ms
WAITING = 10  # unread blocks: 0.2 s, then the oldest are dropped


class DeviceMicrophone:
    """See robot_interface.AudioSource."""

    def __init__(self, words: DeviceSetting) -> None:
        self._reader = DeviceReader("microphone", words, "audio", self._take)
        self._news = threading.Condition()
        self._blocks: deque[npt.NDArray[np.int16]] = deque(maxlen=WAITING)
        self._resampler = _resampler()

    def start(self) -> None:
        self._blocks.clear()
        self._resampler = _resampler()
        self._reader.start()

    def stop(self) -> None:
        self._reader.stop()

    def read(self, timeout: float) -> npt.NDArray[np.int16] | None:
        """Block for 20 ms, (960,), for `timeout` s at most; None without data, or AdapterError."""
        with self._news:
            self._news.wait_for(lambda: self._blocks, timeout if not self._reader.failed else 0.0)
            block = self._blocks.popleft() if self._blocks else None
        if block is None:
            self._reader.check()
        return block

    def _take(self, frame: Any, _stamp: float) -> None:
        # a device that restarts, or a file, has times of its own; only the order counts
        frame.pts = None
        blocks = [block.to_ndarray()[0] for block in self._resampler.resample(frame)]
        with self._news:
            self._blocks.extend(blocks)
            self._news.notify_all()


def _resampler() -> av.AudioResampler:
    return av.AudioResampler(format="s16", layout="mono", rate=RATE, frame_size=BLOCK)
