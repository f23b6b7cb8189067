"""The simulated robot's loudspeaker and display: they measure what they are given."""

import threading
from collections import deque

import numpy as np
import numpy.typing as npt

RATE = 48_000
KEPT = 0.5  # s of sound that are measured
FULL_SCALE = 32_768.0


class MeasuringSpeaker:
    """See robot_interface.Speaker. Keeps the last half second; may be asked from any thread."""

    def __init__(self) -> None:
        self.running = False
        self.played = 0  # samples since the beginning
        self._lock = threading.Lock()
        self._samples: deque[int] = deque(maxlen=int(KEPT * RATE))

    def start(self) -> None:
        self.running = True

    def stop(self) -> None:
        self.running = False

    def play(self, samples: npt.NDArray[np.int16]) -> None:
        with self._lock:
            self.played += samples.size
            self._samples.extend(samples.tolist())

    @property
    def level(self) -> float:
        """The root mean square of the last half second, of full scale; 0 without sound."""
        samples = self._last()
        return float(np.sqrt(np.mean(samples**2))) if samples.size else 0.0

    @property
    def tone(self) -> float:
        """The strongest frequency of the last half second in Hz; 0 for silence."""
        samples = self._last()
        if not samples.any():
            return 0.0
        spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.size)))
        return float(np.argmax(spectrum) * RATE / samples.size)

    def _last(self) -> npt.NDArray[np.float64]:
        with self._lock:
            return np.array(self._samples, dtype=np.float64) / FULL_SCALE


class MeasuringDisplay:
    """See robot_interface.Display. Keeps the last picture."""

    def __init__(self) -> None:
        self.running = False
        self.shown = 0  # pictures since the beginning
        self._image: npt.NDArray[np.uint8] | None = None

    def start(self) -> None:
        self.running = True

    def stop(self) -> None:
        self.running = False
        self._image = None

    def show(self, image: npt.NDArray[np.uint8]) -> None:
        self.shown += 1
        self._image = image

    @property
    def colour(self) -> tuple[float, float, float] | None:
        """The mean red, green and blue of the last picture, 0 to 255; None when there is none."""
        image = self._image
        if image is None:
            return None
        red, green, blue = image.reshape(-1, 3).mean(axis=0)
        return float(red), float(green), float(blue)
