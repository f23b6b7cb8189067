"""The free space of the disk, polled in a thread of its own: a disk that fails may never answer."""

import threading

from robots.api.disk_space import DiskSpace, DiskState

POLL_INTERVAL_S = 0.5


class DiskWatch:
    """`state` is the newest answer. A thread whose disk never answers ends with the process."""

    def __init__(self, disk: DiskSpace) -> None:
        self.state: DiskState = "ok"
        self._disk = disk
        self._ending = threading.Event()
        threading.Thread(target=self._run, name="disk", daemon=True).start()

    def _run(self) -> None:
        while not self._ending.is_set():
            self.state = self._disk.state()
            self._ending.wait(POLL_INTERVAL_S)

    def close(self) -> None:
        """Stop polling."""
        self._ending.set()
