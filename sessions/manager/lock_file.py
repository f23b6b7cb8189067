"""Whether the session manager before this one is dead: a sign of life that ends with its process,
however that ends.

A beat that is late does not tell a dead process from one that is held up, so that its successor has
to wait; the operating system knows at once. So the one that has the row holds a lock on a file in
VAR_DIR, which the system takes back when the process is gone, and writes its name there. Whoever
gets the lock and reads the name that stands in the row succeeds somebody who is dead for certain.
Any other case says nothing, and the beat decides as before: another computer, a process that is
only stopped, a system without such locks, a file that somebody removed, or copied, for beside the
name stands which file it was written into, and on which computer.
"""

import contextlib
import os
import socket
from pathlib import Path

import structlog

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

logger = structlog.stdlib.get_logger(__name__)

MODE = 0o600
LONGEST = 500
BOOT = Path("/proc/sys/kernel/random/boot_id")  # of this start of the computer (Linux)


class LockFile:
    """One process's side of it. Nothing here raises: without the file everything takes longer, and
    that is all.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None
        self._signed = ""

    def predecessor(self) -> str:
        """Hold the file if nobody does, and return the name in it; empty while somebody else holds
        it.
        """
        try:
            self._hold()
            if self._file is None:
                return ""
            holder, _, place = (
                os.pread(self._file, LONGEST, 0).decode("utf-8", "replace").partition("\n")
            )
            return holder if place == _place_of(self._file) else ""
        except BlockingIOError:
            return ""
        except OSError as error:
            logger.info("lock_file_unavailable", path=self._path, reason=str(error))
            return ""

    def sign(self, holder: str) -> None:
        """Write our name, if the file is ours."""
        if self._file is None or self._signed == holder:
            return
        try:
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, f"{holder}\n{_place_of(self._file)}".encode(), 0)
            self._signed = holder
        except OSError as error:
            logger.info("lock_file_unavailable", path=self._path, reason=str(error))
            self.release()

    def release(self) -> None:
        """Let somebody else hold it."""
        if self._file is not None:
            os.close(self._file)
            self._file, self._signed = None, ""

    def _hold(self) -> None:
        if self._file is not None or fcntl is None:
            return
        with contextlib.ExitStack() as unless_held:
            file = os.open(self._path, os.O_RDWR | os.O_CREAT, MODE)
            unless_held.callback(os.close, file)
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            unless_held.pop_all()
        self._file = file


def _place_of(file: int) -> str:
    """Return what only this file on this computer is called."""
    found = os.fstat(file)
    computer = BOOT.read_text().strip() if BOOT.exists() else socket.gethostname()
    return f"{computer} {found.st_dev}:{found.st_ino}"
