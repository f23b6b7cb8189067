"""How fast time goes for a system that was started for it (experiments/bots/fast_time), and who
slows it down when the computer is late.

A computer that has too much to do delivers late, and at ten times the pace ten times as late:
commands would be refused as stale that are not. So the pace is governed by what drivers notice, the
round trip to the robot: never faster than asked for, slower than real time where the computer has
no time for more, and every drive under way sees the delays that it would see on a quiet computer.
"""

import mmap
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from experiments.bots.fast_time.sitecustomize import SIZE, SLOT, SLOTS, VARIABLE, Clocks

FOLDER = Path(__file__).resolve().parent / "fast_time"
# Seconds of a round trip above which time goes slower, and below which faster. The way to the robot
# is half of it; from half the age limit on (125 ms) the safety kernel lowers the speed, so up to
# here no drive notices.
LATE = 0.16
PROMPT = 0.10
SLOWER, FASTER = 0.8, 1.03
SLOWEST = 0.2  # a study that is played beside other work takes longer, and is played no worse


class Pace:
    """Who writes a file of the pace; one process at a time.

    Args:
        path: the file; it is made, at real time, unless there is one.
        real: the computer's own monotonic clock, whatever time.monotonic is in this process.
        unix: its Unix clock, for a file that is made.
    """

    def __init__(
        self,
        path: Path,
        real: Callable[[], float] = time.monotonic,
        unix: Callable[[], float] = time.time,
    ) -> None:
        self.path, self.real = path, real
        is_new = not path.exists()
        if is_new:
            path.write_bytes(bytes(SIZE))
        with path.open("r+b") as file:
            self._bytes = mmap.mmap(file.fileno(), SIZE)
        if is_new:
            now = real()
            self._write(0, (now, now, unix(), 1.0))

    @property
    def rate(self) -> float:
        """How many times faster than real time it goes now."""
        rate: float = SLOT.unpack_from(self._bytes, SLOTS[self._bytes[0]])[3]
        return rate

    def set(self, rate: float) -> None:
        """Go so many times faster from now on; no clock jumps."""
        real, monotonic, unix, before = SLOT.unpack_from(self._bytes, SLOTS[self._bytes[0]])
        now = self.real()
        gone = (now - real) * before
        self._write(1 - self._bytes[0], (now, monotonic + gone, unix + gone, rate))

    def _write(self, slot: int, values: tuple[float, float, float, float]) -> None:
        SLOT.pack_into(self._bytes, SLOTS[slot], *values)
        self._bytes[0] = slot

    def environment(self, given: dict[str, str]) -> dict[str, str]:
        """Return the environment of a process that keeps this pace."""
        paths = [
            str(FOLDER),
            *(part for part in given.get("PYTHONPATH", "").split(os.pathsep) if part),
        ]
        return {**given, VARIABLE: str(self.path), "PYTHONPATH": os.pathsep.join(paths)}


def own_pace() -> Pace | None:
    """Return the pace that this process keeps itself; None at real time."""
    clocks: Clocks | None = getattr(sys.modules.get("sitecustomize"), "clocks", None)
    return Pace(Path(os.environ[VARIABLE]), real=clocks.real) if clocks is not None else None


@dataclass
class Governor:
    """Decides the pace. `most` is what was asked for."""

    most: float
    rate: float = 1.0

    def decide(self, trips: Iterable[float], lag: float = 0.0) -> float:
        """Return the pace for the next while.

        Args:
            trips: the latest round trips of those who drive, in seconds of the quick clock. Without
                any there is no evidence that more than
                real time would do no harm: so whoever drives next begins at what was good for the
                    last one.
            lag: how late one was oneself.
        """
        seen = list(trips)
        if max([*seen, lag]) > LATE:
            self.rate = max(SLOWEST, self.rate * SLOWER)
        elif max([*seen, lag]) < PROMPT:
            self.rate = max(self.rate, min(self.most if seen else 1.0, self.rate * FASTER))
        return self.rate
