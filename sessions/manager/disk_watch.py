"""How much room the disk has, asked in a thread that nobody waits for: a disk that dies may never
answer.
"""

import threading

from robots.api.disk_space import DiskSpace, DiskState

POLL_INTERVAL_S = 0.5


class DiskWatch:
    """`state` is what the disk said last. The thread ends with the process if the disk does not
    answer at all.
    """

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
        """Ask no more."""
        self._ending.set()
