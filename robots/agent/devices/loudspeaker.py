"""A loudspeaker of the robot's computer, as the contract wants one: see adapters/contract.Speaker."""

from typing import Any

import av
import numpy as np
import numpy.typing as npt

from robots.agent.adapters.contract import AdapterError
from robots.agent.devices.words import DeviceWords

RATE = 48_000
SIDES = 2  # a device rarely takes one channel alone
FAILURES = (av.FFmpegError, OSError, ValueError)


class DeviceLoudspeaker:
    """See contract.Speaker. Belongs to one thread."""

    def __init__(self, words: DeviceWords) -> None:
        self._words = words
        self._container: Any = None
        self._stream: Any = None

    def start(self) -> None:
        """Open the device; idempotent.

        Raises:
            AdapterError: it cannot be opened.
        """
        if self._container is not None:
            return
        try:
            container: Any = av.open(self._words.address, "w", format=self._words.format, options=self._words.options)
            self._stream = container.add_stream("pcm_s16le", rate=RATE, layout="stereo")
            self._play(container, np.zeros(RATE // 100, np.int16))  # the device is opened by the first sound: now is known whether it is there
        except FAILURES as error:
            raise self._gone(error) from error
        self._container = container

    def stop(self) -> None:
        """Let go of the device; idempotent."""
        container, self._container = self._container, None
        if container is not None:
            try:
                container.close()
            except FAILURES as error:
                raise self._gone(error) from error

    def play(self, samples: npt.NDArray[np.int16]) -> None:
        """Play samples, (n,): mono, 48 kHz. Waits while the device has enough.

        Raises:
            AdapterError: it is gone.
        """
        if self._container is None:
            raise AdapterError(f"the loudspeaker {self._words.address} is not open")
        try:
            self._play(self._container, samples)
        except FAILURES as error:
            raise self._gone(error) from error

    def _play(self, container: Any, samples: npt.NDArray[np.int16]) -> None:
        frame = av.AudioFrame.from_ndarray(np.repeat(samples, SIDES)[np.newaxis], format="s16", layout="stereo")
        frame.sample_rate = RATE
        for packet in self._stream.encode(frame):
            container.mux(packet)

    def _gone(self, error: Exception) -> AdapterError:
        return AdapterError(f"the loudspeaker {self._words.address} cannot be used: {getattr(error, 'strerror', '') or error}")
