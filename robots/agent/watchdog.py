"""Detects a hanging control thread and ends the process, so that its supervisor restarts it.

The base's own watchdog has stopped the robot long before. A thread cannot be ended from outside,
and a second control loop could move the robot as well; so the process ends at once, with the
thread's stack in the log. systemd does the same to a process in which no thread runs: it expects a
datagram from `Systemd` every WatchdogSec (sd_notify(3)).
"""

import contextlib
import os
import socket
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from typing import NoReturn

import structlog

from robots.agent.timing import Cadence
from robots.process import logs

log = structlog.stdlib.get_logger(__name__)

HANG_S = 10.0
EXIT_HUNG = 70  # EX_SOFTWARE of sysexits.h
NOTIFY_PERIOD_S = 1.0


class HangDetector:
    """Compares the ticks of a loop at each look; it hangs after `looks` without one. Looks count
    and not the time: a suspended process does not hang when it continues.
    """

    def __init__(self, looks: int) -> None:
        self._most = looks
        self._ticks = -1
        self._without = 0

    def look(self, ticks: int) -> bool:
        """Return whether the loop hangs, given its ticks so far."""
        self._without = self._without + 1 if ticks == self._ticks else 0
        self._ticks = ticks
        return self._without >= self._most


def end_process(thread: threading.Thread, where: str) -> NoReturn:
    """Log the stack of a hanging thread, and end the process without waiting for anything."""
    # documented, in spite of its name
    frame = sys._current_frames().get(thread.ident or 0)  # noqa: SLF001
    stack = "".join(traceback.format_stack(frame)) if frame is not None else ""
    log.critical("thread_hung", thread=thread.name, where=where, stack=stack)
    logs.flush()
    os._exit(EXIT_HUNG)


class Systemd:
    """Reports to the service manager (NOTIFY_SOCKET), if any, that this process works."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._due = Cadence(NOTIFY_PERIOD_S)

    def ready(self) -> None:
        self._send(b"READY=1")

    def alive(self) -> None:
        """Report that the process works, at most once a second."""
        if self._due.due(time.monotonic()):
            self._send(b"WATCHDOG=1")

    def _send(self, state: bytes) -> None:
        if sys.platform == "win32" or not self._address:
            return
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as service_manager,
        ):
            service_manager.setblocking(False)
            service_manager.sendto(state, self._address)
