"""State that an agent keeps across restarts: a latched e-stop and the newest lease.

Small JSON files, replaced as a whole. An unreadable latch counts as latched until it is released by
hand.
"""

import contextlib
from pathlib import Path

import msgspec
import structlog

from robots.agent.safety.estop_latch import UNREADABLE, EStopLatch
from robots.agent.safety.lease import Remembered
from robots.api.disk_space import MIB, DiskSpace
from robots.api.private_files import draft_of

log = structlog.stdlib.get_logger(__name__)
LOW_MB = 200  # of room for these files, logs and updates, below which the robot says so


class Store:
    """Files of one robot in one directory. Methods block on the disk: call them off the loop."""

    def __init__(self, directory: Path) -> None:
        self._latch = directory / "estop.json"
        self._lease = directory / "lease.json"
        self._space = DiskSpace(directory, LOW_MB)

    def prepare(self) -> None:
        """Make the directory; raises OSError when it cannot be made or written to."""
        self._latch.parent.mkdir(parents=True, exist_ok=True)
        probe = self._latch.parent / ".writable"
        probe.write_text("")
        probe.unlink()

    def shortage(self) -> tuple[str, ...]:
        """Return the error `disk_low` or `disk_full`, a colon, and the free space. Fast."""
        try:
            state = self._space.state() if self._latch.parent.is_dir() else "ok"
        except OSError:  # a dying disk
            state = "full"
        if state == "ok":
            return ()
        return (f"disk_{state}: {self._space.free() // MIB} MB are free on the robot's computer",)

    def latch(self) -> EStopLatch | None:
        """Return the e-stop that was held when the agent ended."""
        try:
            return msgspec.json.decode(self._latch.read_bytes(), type=EStopLatch)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, msgspec.DecodeError) as error:
            log.exception("latch_unreadable", file=self._latch)
            return EStopLatch(UNREADABLE, 0.0, "", str(error))

    def keep_latch(self, latch: EStopLatch | None) -> None:
        """Store an e-stop, or None for none; raises OSError."""
        if latch is None:
            self._latch.unlink(missing_ok=True)
            return
        _replace(self._latch, latch)

    def lease(self) -> Remembered | None:
        """Return the newest grant seen before the agent ended, None if unreadable."""
        with contextlib.suppress(OSError, ValueError, msgspec.DecodeError):
            return msgspec.json.decode(self._lease.read_bytes(), type=Remembered)
        return None

    def keep_lease(self, newest: Remembered) -> None:
        """Store a grant; raises OSError."""
        _replace(self._lease, newest)


def _replace(path: Path, content: EStopLatch | Remembered) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with draft_of(path) as file:
        file.write(msgspec.json.encode(content))
