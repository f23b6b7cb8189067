"""The simulated microphone: a quiet room, and its own motors, louder and higher the faster the
wheels turn.
"""

import numpy as np
import numpy.typing as npt

RATE = 48_000
BLOCK = 960  # samples, 20 ms
ROOM_SECONDS = 8
ROOM_LEVEL = 90.0  # of 32767
HUM_LEVEL = 700.0
HUM_LOWEST, HUM_HIGHEST = 55.0, 190.0  # Hz
HARMONICS = ((1.0, 1.0), (2.0, 0.55), (3.0, 0.3), (5.02, 0.12))
SMOOTHING = 0.2  # share of a new speed that a block takes over
INAUDIBLE = 1e-6  # an effort below this is no effort


def room_tone(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Return some seconds of looping brownish noise: a quiet room's spectrum falls."""
    count = RATE * ROOM_SECONDS
    frequencies = np.fft.rfftfreq(count, 1.0 / RATE)
    strength = 1.0 / np.maximum(frequencies, 60.0)
    strength[frequencies < 30.0] = 0.0
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    tone = np.fft.irfft(strength * np.exp(1j * phases), count)
    scaled: npt.NDArray[np.float32] = (tone * (ROOM_LEVEL / tone.std())).astype(np.float32)
    return scaled


class Microphone:
    """Makes sound block by block, without a seam between blocks."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._room = room_tone(rng)
        self._at = 0
        self._phase = 0.0
        self._effort = 0.0

    def block(self, effort: float) -> npt.NDArray[np.int16]:
        """Return the next 20 ms, (960,) int16; `effort` from 0, standing, to 1, full speed."""
        before = self._effort
        self._effort += SMOOTHING * (min(max(effort, 0.0), 1.0) - self._effort)
        room = np.take(self._room, np.arange(self._at, self._at + BLOCK), mode="wrap")
        self._at = (self._at + BLOCK) % len(self._room)
        if max(before, self._effort) < INAUDIBLE:
            return room.astype(np.int16)
        ramp = np.linspace(before, self._effort, BLOCK, endpoint=False)
        phase = self._phase + np.cumsum(
            2.0 * np.pi * (HUM_LOWEST + (HUM_HIGHEST - HUM_LOWEST) * ramp) / RATE
        )
        # 50 turns: a whole number for every harmonic above
        self._phase = float(phase[-1] % (2.0 * np.pi * 50.0))
        # float32 is a quarter of the work, and exact to -80 dB.
        hum = sum(
            np.float32(share) * np.sin((multiple * phase).astype(np.float32))
            for multiple, share in HARMONICS
        )
        return np.clip(room + HUM_LEVEL * np.sqrt(ramp) * hum, -32768, 32767).astype(np.int16)
