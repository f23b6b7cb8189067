"""A Redis of one test or benchmark."""

import subprocess
from pathlib import Path

from tests.support.programs.server import program, redis_options
from tests.support.sessions.site import LOOPBACK, free_port


class Redis:
    """A Redis that keeps nothing: the channel layer and the cache need no persistence."""

    def __init__(self, directory: Path, host: str = LOOPBACK) -> None:
        self._directory, self._host, self._port = directory, host, free_port()
        self.url = f"redis://{host}:{self._port}/0"

    @property
    def pid(self) -> int:
        return self._process.pid

    def start(self) -> None:
        words = [program("redis-server"), *redis_options(self._port, self._host)]
        with (self._directory / "redis.log").open("ab") as log:
            self._process = subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT)

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
