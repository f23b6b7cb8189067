"""The pace of time in a system that was started for it (experiments/bots/fast_time), and the
governor that slows it down when the computer is late.

A computer that is overloaded delivers late, and at ten times the pace ten times as late: commands
would be refused as stale that are not. So the pace follows what drivers notice, the round trip to
the robot and the age of images: never faster than requested, slower than real time where the
computer cannot do more.
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
# Seconds of a round trip above which time goes slower, and below which faster. Half of it is spent
# towards the robot; from half the age limit on (125 ms) the safety kernel lowers the speed, so up
# to here no drive notices.
LATE = 0.16
PROMPT = 0.10
# Seconds that an image may get old before time goes slower, but not slower than real time: half
# of the age limit, from which on the kernel lowers the speed. A quiet computer's get 0.36 s old.
OLD = 0.5
SLOWER, FASTER = 0.8, 1.03
SLOWEST = 0.2  # beside other work, a study takes longer


class Pace:
    """Writes the file of the pace, which is created at real time unless it exists; only one process
    may write. `real` is the computer's own monotonic clock, whatever time.monotonic is in this
    process; `unix` its Unix clock, for a new file.
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

    def set(self, rate: float) -> None:
        """Change the pace from now on; no clock jumps."""
        real, monotonic, unix, before = SLOT.unpack_from(self._bytes, SLOTS[self._bytes[0]])
        now = self.real()
        passed = (now - real) * before
        self._write(1 - self._bytes[0], (now, monotonic + passed, unix + passed, rate))

    def _write(self, slot: int, values: tuple[float, float, float, float]) -> None:
        SLOT.pack_into(self._bytes, SLOTS[slot], *values)
        self._bytes[0] = slot

    def environment(self, given: dict[str, str]) -> dict[str, str]:
        """Return the environment of a process that keeps this pace."""
        paths = filter(None, (str(FOLDER), given.get("PYTHONPATH", "")))
        return {**given, VARIABLE: str(self.path), "PYTHONPATH": os.pathsep.join(paths)}


def own_pace() -> Pace | None:
    """Return the pace that this process keeps itself; None at real time."""
    clocks: Clocks | None = getattr(sys.modules.get("sitecustomize"), "clocks", None)
    return Pace(Path(os.environ[VARIABLE]), real=clocks.real) if clocks is not None else None


@dataclass
class Governor:
    """Decides the pace; `most` is the requested one."""

    most: float
    rate: float = 1.0

    def decide(self, trips: Iterable[float], lag: float = 0.0, ages: Iterable[float] = ()) -> float:
        """Return the pace for the next interval, from the latest round trips of the drives and how
        old their images get (seconds of the quick clock), and how late this process was itself (s).
        Without round trips, nothing shows that more than real time would do no harm, so the next
        drive begins at the pace that was good for the last one.
        """
        seen = list(trips)
        latest = max([*seen, lag])
        if latest > LATE:
            self.rate = max(SLOWEST, self.rate * SLOWER)
        elif self.rate >= 1.0 and max(ages, default=0.0) > OLD:
            self.rate = max(1.0, self.rate * SLOWER)
        elif latest < PROMPT:
            self.rate = max(self.rate, min(self.most if seen else 1.0, self.rate * FASTER))
        return self.rate
