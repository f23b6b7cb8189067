"""The free space on the disk of a server or a robot."""

import shutil
from pathlib import Path
from typing import Literal

MIB = 1024 * 1024
FULL_MB = 2  # below, a database cannot be sure to write what it was asked to
DiskState = Literal["ok", "low", "full"]


class DiskSpace:
    """The file system of a folder.

    Args:
        folder: any folder on it.
        low_mb: free megabytes (MiB) below which the state is `low`.
    """

    def __init__(self, folder: Path, low_mb: float) -> None:
        self._folder, self._low = folder, low_mb * MIB

    def free(self) -> int:
        """Return the bytes that this process can still write; 0 for a disk that is unavailable."""
        try:
            return shutil.disk_usage(self._folder).free
        except OSError:
            return 0

    def state(self) -> DiskState:
        return self.word(self.free())

    def word(self, free: int) -> DiskState:
        """Return the state of a disk with `free` bytes left."""
        return "full" if free < FULL_MB * MIB else "low" if free < self._low else "ok"
