"""A camera and a microphone without hardware: a moving picture that carries its own capture stamp
as a bar code.

The code is one row of cells along the top: two fixed cells (white, black), then the stamp in tenths
of a millisecond modulo 2^24, most significant bit first, then its parity. Cells are large enough to
survive VP8 at any rate used here.
"""

import threading
import time

import numpy as np
import numpy.typing as npt

from robots.agent.robot_interface import AdapterError, Frame

WIDTH, HEIGHT = 640, 480
CELL = 20  # pixels
BITS = 24
TICKS_PER_SECOND = 10_000
MODULO = 1 << BITS


def code_of(stamp: float) -> int:
    """Return the number that the picture of `stamp`, Unix time in seconds, contains."""
    return int(stamp * TICKS_PER_SECOND) % MODULO


def apart(code: int, other: int) -> int:
    """Return the ticks between two such numbers, which wrap every half an hour."""
    return min((code - other) % MODULO, (other - code) % MODULO)


def draw_code(image: npt.NDArray[np.uint8], code: int) -> None:
    """Draw a number into the top of an image (height, width, 3)."""
    bits = [code >> shift & 1 for shift in reversed(range(BITS))]
    for cell, bit in enumerate([1, 0, *bits, sum(bits) % 2]):
        image[:CELL, cell * CELL : (cell + 1) * CELL] = 255 * bit


def read_code(image: npt.NDArray[np.uint8]) -> int | None:
    """Return the number in a picture (height, width, 3), or None when it cannot be read."""
    centres = [int(image[CELL // 2, cell * CELL + CELL // 2].mean()) for cell in range(BITS + 3)]
    bits = [int(value > 127) for value in centres]
    if bits[:2] != [1, 0] or sum(bits[2:-1]) % 2 != bits[-1]:
        return None
    return int("".join(map(str, bits[2:-1])), 2)


class SyntheticCamera:
    """A VideoSource of 640 x 480 RGB at `fps`, seeded; tests can make it fail or fall silent."""

    def __init__(self, fps: float = 30.0, seed: int = 1) -> None:
        self.fps = fps
        self.starts = 0
        self.stops = 0
        self.running = False
        self._background = _texture(np.random.default_rng(seed))
        self._number = 0
        self._due = 0.0
        self._failure: str | None = None
        self._silent = threading.Event()

    def start(self) -> None:
        if self._failure is not None:
            raise AdapterError(self._failure)
        self.starts += 1
        self.running = True
        self._due = time.monotonic()

    def stop(self) -> None:
        self.stops += self.running
        self.running = False

    def read(self, timeout: float) -> Frame | None:
        if self._failure is not None:
            raise AdapterError(self._failure)
        if self._silent.is_set():
            time.sleep(min(timeout, 0.05))
            return None
        self._due = max(self._due + 1 / self.fps, time.monotonic() - 1 / self.fps)
        time.sleep(max(0.0, self._due - time.monotonic()))
        return self._frame(time.time())

    def fail(self, reason: str) -> None:
        """Make every call raise AdapterError until `recover`."""
        self._failure = reason

    def fall_silent(self) -> None:
        """Give no frames, as a camera does whose cable is loose, until `recover`."""
        self._silent.set()

    def recover(self) -> None:
        """Work again."""
        self._failure = None
        self._silent.clear()

    def _frame(self, stamp: float) -> Frame:
        self._number += 1
        shift = 2 * self._number % WIDTH
        image = np.ascontiguousarray(self._background[:, shift : shift + WIDTH])
        draw_code(image, code_of(stamp))
        return Frame(image=image, stamp=stamp)


class SyntheticMicrophone:
    """An AudioSource of 20 ms blocks: a tone of `frequency` Hz, or silence when it is 0."""

    def __init__(self, frequency: float = 440.0) -> None:
        self.frequency = frequency
        self.starts = 0
        self.running = False
        self._block = 0
        self._due = 0.0

    def start(self) -> None:
        self.starts += 1
        self.running = True
        self._due = time.monotonic()

    def stop(self) -> None:
        self.running = False

    def read(self, timeout: float) -> npt.NDArray[np.int16] | None:
        self._due = max(self._due + 0.02, time.monotonic() - 0.02)
        time.sleep(max(0.0, self._due - time.monotonic()))
        samples = np.arange(960) + 960 * self._block
        self._block += 1
        return np.asarray(
            8000 * np.sin(2 * np.pi * self.frequency * samples / 48_000), dtype=np.int16
        )


def _texture(generator: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return a background (480, 1280, 3) that repeats after 640 columns: soft patches with edges,
    about as hard to encode as a room.
    """
    patches = np.kron(generator.integers(40, 215, (12, 16, 3)), np.ones((40, 40, 1)))
    shade = np.linspace(0.7, 1.0, HEIGHT)[:, None, None]
    grain = generator.normal(0.0, 3.0, (HEIGHT, WIDTH, 1))
    tile = np.clip(patches * shade + grain, 0, 255).astype(np.uint8)
    return np.concatenate([tile, tile], axis=1)
