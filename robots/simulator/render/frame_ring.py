"""Frames in shared memory: a ring of slots, each with a guard, so that a reader detects that the
writer has overtaken it.

The writer makes a slot's guard odd, draws, and makes it 2 x number + 2; a reader copies and checks
that the guard has not changed. Neither waits for the other; pixels never pass through a socket. A
frame is (height * 3 / 2, width): the rows of Y, then U and V at half the size.

The writer owns the memory and unlinks it. When the writer is killed, Python's resource tracker, a
separate process, does. Readers must not register with their tracker: before Python 3.13 it would
unlink the writer's memory (python/cpython issue 82300).
"""

import contextlib
import sys
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import numpy.typing as npt

SLOTS = 4
GUARD = 64  # bytes before each picture, which keeps pictures on cache lines


def _slot_bytes(width: int, height: int) -> int:
    return GUARD + -(-_bytes(width, height) // GUARD) * GUARD


def _bytes(width: int, height: int) -> int:
    return width * height * 3 // 2


class _Ring:
    def __init__(self, memory: SharedMemory, width: int, height: int, slots: int) -> None:
        size = _slot_bytes(width, height)
        whole: npt.NDArray[np.uint8] = np.ndarray((slots, size), dtype=np.uint8, buffer=memory.buf)
        self._memory = memory
        self.guards: npt.NDArray[np.uint64] = whole[:, :8].view(np.uint64)[:, 0]
        self.images = [
            whole[slot, GUARD : GUARD + _bytes(width, height)].reshape(height * 3 // 2, width)
            for slot in range(slots)
        ]
        self.slots = slots
        self.name = memory.name

    def _release(self) -> None:
        self.images = []
        self.guards = np.zeros(0, dtype=np.uint64)
        # a frame is still referenced: the memory is released when the process ends
        with contextlib.suppress(BufferError):
            self._memory.close()


class FrameWriter(_Ring):
    """The camera's side. `begin` returns the frame to draw into, `commit` publishes it."""

    def __init__(self, width: int, height: int, slots: int = SLOTS) -> None:
        """Make the shared memory; raises OSError when there is none left."""
        super().__init__(
            SharedMemory(create=True, size=slots * _slot_bytes(width, height)), width, height, slots
        )
        self.guards[:] = 0
        self.number = 0

    def begin(self) -> npt.NDArray[np.uint8]:
        """Return the frame (height * 3 / 2, width) to draw next, and invalidate it for readers."""
        slot = self.number % self.slots
        self.guards[slot] = 2 * self.number + 1
        return self.images[slot]

    def commit(self) -> int:
        """Publish the frame and return its number."""
        number = self.number
        self.guards[number % self.slots] = 2 * number + 2
        self.number += 1
        return number

    def close(self) -> None:
        """Unlink the memory; readers that still have it mapped can read it."""
        self._release()
        with contextlib.suppress(FileNotFoundError):
            self._memory.unlink()


class FrameReader(_Ring):
    """A viewer's side."""

    def __init__(self, name: str, width: int, height: int, slots: int) -> None:
        """Map the memory that a writer made; raises OSError when it is gone."""
        super().__init__(_attach(name), width, height, slots)

    def copy(self, number: int) -> npt.NDArray[np.uint8] | None:
        """Return frame `number`, or None when the writer has overtaken it."""
        slot = number % self.slots
        if int(self.guards[slot]) != 2 * number + 2:
            return None
        image = self.images[slot].copy()
        return image if int(self.guards[slot]) == 2 * number + 2 else None

    def close(self) -> None:
        """Unmap; the writer's memory stays."""
        self._release()


def _attach(name: str) -> SharedMemory:
    if sys.version_info >= (3, 13):
        return SharedMemory(name=name, track=False)
    memory = SharedMemory(name=name)
    if sys.platform != "win32":
        known_as = memory._name  # type: ignore[attr-defined] # noqa: SLF001 -- until Python 3.13
        resource_tracker.unregister(known_as, "shared_memory")
    return memory
