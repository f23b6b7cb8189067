"""Tells whether the previous session manager is dead, by a lock that ends with its process.

A late heartbeat cannot tell a dead process from a slow one, so that its successor must wait for
seconds; the operating system knows at once. The holder of a slot therefore locks a file in VAR_DIR
and writes its name there; the system releases the lock when the process ends, however it ends. A
process that gets the lock and reads the name of the slot's holder succeeds a dead process.

In all other cases the heartbeat decides: on another computer, for a stopped process, on a system
without such locks, and for a file that was removed or copied. To detect copies, the name is stored
with the computer and the inode of its file.
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
MAX_BYTES = 500
BOOT = Path("/proc/sys/kernel/random/boot_id")  # changes with every start of the computer (Linux)


class LockFile:
    """The file of a slot. Never raises: without the file, a takeover only takes longer."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None
        self._signed = ""

    def predecessor(self) -> str:
        """Lock the file and return the name in it; empty while another process has the lock."""
        try:
            self._hold()
            if self._file is None:
                return ""
            holder, _, place = (
                os.pread(self._file, MAX_BYTES, 0).decode("utf-8", "replace").partition("\n")
            )
            return holder if place == _place_of(self._file) else ""
        except BlockingIOError:
            return ""
        except OSError as error:
            logger.info("lock_file_unavailable", path=self._path, reason=str(error))
            return ""

    def sign(self, holder: str) -> None:
        """Write our name, if the lock is ours."""
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
        """Release the lock."""
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
    """Return a name that no other file and no other computer has."""
    found = os.fstat(file)
    computer = BOOT.read_text().strip() if BOOT.exists() else socket.gethostname()
    return f"{computer} {found.st_dev}:{found.st_ino}"
