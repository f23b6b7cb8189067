"""One process of a broker, and waiting until it answers."""

import asyncio
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

from robots.process.ending import tied_to_parent
from tests.support.patience import patient

START_SECONDS = 60.0


class MissingProgramError(AssertionError):
    """The program of a broker that was asked for is not installed."""


def program(name, package):
    """Return the path of a program, or fail with the name of its Debian package."""
    found = shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/local/sbin")
    if found is None:
        raise MissingProgramError(f"{name} is not installed (Debian: apt install {package})")
    return found


class Node:
    """A process that writes its output to a file, and can be killed, stopped and started again."""

    def __init__(self, command, log: Path, environment=None):
        self.command, self.log, self.environment = command, log, environment
        self.start()

    def start(self):
        with self.log.open("ab") as output:
            self.process = subprocess.Popen(
                self.command,
                stdout=output,
                stderr=output,
                stdin=subprocess.DEVNULL,
                env=os.environ | (self.environment or {}),
                start_new_session=True,
                preexec_fn=tied_to_parent(),
            )

    def reload(self):
        self.process.send_signal(signal.SIGHUP)

    def kill(self):
        """End it as a failing machine would, with all that it has started."""
        self._signal(signal.SIGKILL)
        self.process.wait()

    def freeze(self):
        self._signal(signal.SIGSTOP)

    def thaw(self):
        self._signal(signal.SIGCONT)

    def _signal(self, number):
        if self.process.poll() is None:
            os.killpg(self.process.pid, number)

    async def until(self, question, what):
        """Wait until an async question is answered with yes while the process lives."""
        deadline = time.monotonic() + patient(START_SECONDS)
        while not await question():
            assert self.process.poll() is None, f"{what}: it ended\n{self.tail()}"
            assert time.monotonic() < deadline, f"{what} never came\n{self.tail()}"
            await asyncio.sleep(0.05)

    def tail(self):
        return self.log.read_text(errors="replace")[-3000:]


async def is_open(host, port):
    try:
        _, writer = await asyncio.open_connection(host, port)
    except OSError:
        return False
    writer.close()
    return True
