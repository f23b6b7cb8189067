"""A Redis of one test or benchmark."""

import subprocess
from pathlib import Path

from tests.support.programs.server import program
from tests.support.sessions.site import LOOPBACK, free_port


class Redis:
    """A Redis that keeps nothing, as the channel layer and the cache need none."""

    def __init__(self, directory: Path, host: str = LOOPBACK) -> None:
        self._directory, self._host, self._port = directory, host, free_port()
        self.url = f"redis://{host}:{self._port}/0"

    @property
    def pid(self) -> int:
        """Return the id of its process."""
        return self._process.pid

    def start(self) -> None:
        """Start it."""
        words = [
            program("redis-server"),
            "--port",
            str(self._port),
            "--bind",
            self._host,
            "--protected-mode",
            "no",
            "--save",
            "",
            "--appendonly",
            "no",
        ]
        with (self._directory / "redis.log").open("ab") as log:
            self._process = subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT)

    def kill(self) -> None:
        """End it without a word."""
        self._process.kill()
        self._process.wait()
