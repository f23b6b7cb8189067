"""What an agent must keep across restarts: a latched e-stop, and the newest lease it has seen.

Small JSON files, replaced whole. A latch that cannot be read counts as latched, until
it is released by hand.
"""

import contextlib
import json
import os
from dataclasses import asdict
from pathlib import Path

import structlog

from robots.agent.safety.estop_latch import UNREADABLE, EStopLatch
from robots.agent.safety.lease import Remembered
from robots.api.disk_space import MIB, DiskSpace

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
        """Return the error `disk_low` or `disk_full`, a colon, and what is left. Quick."""
        try:
            state = self._space.state() if self._latch.parent.is_dir() else "ok"
        except OSError:  # a disk that is dying
            state = "full"
        return (
            ()
            if state == "ok"
            else (f"disk_{state}: {self._space.free() // MIB} MB are free on the robot's computer",)
        )

    def latch(self) -> EStopLatch | None:
        """Return the e-stop that was held when the agent ended."""
        try:
            content = json.loads(self._latch.read_text(encoding="utf-8"))
            return EStopLatch(
                str(content["source"]),
                float(content["stamp"]),
                str(content["user"]),
                str(content["detail"]),
            )
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            log.exception("latch_unreadable", file=self._latch)
            return EStopLatch(UNREADABLE, 0.0, "", str(error))

    def keep_latch(self, latch: EStopLatch | None) -> None:
        """Store an e-stop, or None for none; raises OSError."""
        if latch is None:
            self._latch.unlink(missing_ok=True)
            return
        _replace(self._latch, asdict(latch))

    def lease(self) -> Remembered | None:
        """Return the newest grant seen before the agent ended; one that cannot be read is none."""
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            content = json.loads(self._lease.read_text(encoding="utf-8"))
            return Remembered(
                str(content["session"]),
                int(content["epoch"]),
                int(content["renewal"]),
                float(content["stamp"]),
            )
        return None

    def keep_lease(self, newest: Remembered) -> None:
        """Store a grant; raises OSError."""
        _replace(self._lease, asdict(newest))


def _replace(path: Path, content: dict[str, object]) -> None:
    """Write a file so that it is either the old one or the new one, whenever the power fails."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".new")
    with unfinished.open("w", encoding="utf-8") as file:
        json.dump(content, file)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
