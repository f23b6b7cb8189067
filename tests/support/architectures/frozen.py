"""A server in a process of its own, which can be frozen, resumed and killed; unread data then wait
in its sockets.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.sessions.site import free_port


class ServerProcess:
    """`python -m MODULE HOST PORT WORDS`, or what `command` returns; `start` returns when it
    listens.
    """

    environment, stderr = None, None

    def __init__(self, module, host="127.0.0.1", words=()):
        self.module, self.host, self.port, self.words = module, host, free_port(), words
        self._process = None

    def command(self):
        return [sys.executable, "-m", self.module, self.host, str(self.port), *self.words]

    def start(self):
        self._process = subprocess.Popen(
            self.command(),
            cwd=ROOT,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=self.stderr,
        )
        deadline = time.monotonic() + patient(15.0)
        while not self._answers():
            assert self._process.poll() is None, f"{self.module} ended"
            assert time.monotonic() < deadline, f"{self.module} does not listen"
            time.sleep(0.02)

    def _answers(self):
        with (
            contextlib.suppress(OSError),
            socket.create_connection((self.host, self.port), timeout=1.0),
        ):
            return True
        return False

    def kill(self):
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()

    def freeze(self, *, on):
        freeze(self._process.pid, on=on)


def freeze(pid, *, on):
    os.kill(pid, signal.SIGSTOP if on else signal.SIGCONT)
