"""Starts and kills tests/support/programs/rtsp_camera.py, which needs the system's Python."""

import contextlib
import signal
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

SCRIPT = Path(__file__).with_name("rtsp_camera.py")


class RtspServer:
    """A camera at `url` with a key frame every `key_interval` seconds; `credentials` are user and
    password.
    """

    def __init__(self, key_interval: float, credentials: tuple[str, ...] = ()) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self._arguments = (str(self.port), str(key_interval), *credentials)
        self._process: subprocess.Popen | None = None

    @property
    def url(self) -> str:
        return f"rtsp://127.0.0.1:{self.port}/stream"

    def url_for(self, user: str, password: str) -> str:
        return f"rtsp://{user}:{password}@127.0.0.1:{self.port}/stream"

    @property
    def is_plugged(self) -> bool:
        return self._process is not None

    def plug(self) -> None:
        self._process = subprocess.Popen(
            ("/usr/bin/python3", str(SCRIPT), *self._arguments), stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout.readline() == "ready\n", "the RTSP server has ended"

    def pull(self) -> None:
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()
        self._process = None

    def freeze(self) -> None:
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        self._process.send_signal(signal.SIGCONT)


@contextlib.contextmanager
def rtsp_server(key_interval: float, credentials: tuple[str, ...] = ()) -> Iterator[RtspServer]:
    server = RtspServer(key_interval, credentials)
    server.plug()
    try:
        yield server
    finally:
        server.pull()
