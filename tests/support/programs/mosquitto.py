"""A real Mosquitto on free ports of the loopback: MQTT, MQTT over WebSocket, and with a certificate
both of them over TLS.
"""

import contextlib
import getpass
import os
import shutil
import signal
import socket
import subprocess
import time

from tests.support.patience import patient
from tests.support.sessions.site import free_port

FOLDERS = ("/usr/sbin", "/usr/local/sbin", "/opt/homebrew/sbin")  # often not on the path
BINARY = shutil.which("mosquitto", path=os.pathsep.join((os.environ["PATH"], *FOLDERS)))


class Mosquitto:
    """Use as a context manager. `ports` are by the scheme of the address; `certificate` is (key,
    certificate) in PEM files. One that `persists` has its messages again after a stop.
    """

    def __init__(
        self, directory, certificate=None, host="127.0.0.1", *, anonymous=True, persists=False
    ):
        self.host = host
        schemes = ("mqtt", "ws", "mqtts", "wss") if certificate else ("mqtt", "ws")
        self.ports = {scheme: free_port() for scheme in schemes}
        self.port = self.ports["mqtt"]
        lines = [
            f"allow_anonymous {str(anonymous).lower()}",
            f"persistence {str(persists).lower()}",
            f"persistence_location {directory}/",
            "set_tcp_nodelay true",
            "max_queued_messages 0",
            f"user {getpass.getuser()}",
        ]
        for scheme, port in self.ports.items():
            lines.append(f"listener {port} {host}")
            if scheme.startswith("ws"):
                lines.append("protocol websockets")
            if scheme in {"mqtts", "wss"}:
                lines += [f"keyfile {certificate[0]}", f"certfile {certificate[1]}"]
        self._config = directory / "mosquitto.conf"
        self._config.write_text("\n".join(lines) + "\n")
        self._process = None

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.kill()

    @property
    def url(self):
        return self.url_of("mqtt")

    def url_of(self, scheme):
        return f"{scheme}://{self.host}:{self.ports[scheme]}"

    def start(self, *, forget=False):
        if forget:
            self._config.with_name("mosquitto.db").unlink(missing_ok=True)
        self._process = subprocess.Popen(
            [BINARY, "-c", str(self._config)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + patient(10.0)
        while not all(map(self._answers, self.ports.values())):
            assert self._process.poll() is None, "mosquitto ended"
            assert time.monotonic() < deadline, "mosquitto does not listen"
            time.sleep(0.02)

    def _answers(self, port):
        with contextlib.suppress(OSError), socket.create_connection((self.host, port), timeout=1.0):
            return True
        return False

    def stop(self):
        """End it properly: it stores its messages."""
        self._process.terminate()
        self._process.wait(patient(10.0))
        self._process = None

    def kill(self):
        if self._process is not None:
            self.freeze(on=False)
            self._process.kill()
            self._process.wait()
            self._process = None

    def freeze(self, *, on):
        self._process.send_signal(signal.SIGSTOP if on else signal.SIGCONT)
