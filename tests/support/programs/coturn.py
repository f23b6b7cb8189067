"""The real coturn on this computer's loopback: UDP, TCP and TLS, with credentials from a shared
secret.
"""

import shutil
import socket
import ssl
import subprocess
import time
from pathlib import Path
from typing import Self

from robots.api.messages import IceServer
from robots.ice import turn_credentials
from tests.support.patience import patient
from tests.support.programs.server import certificate
from tests.support.sessions.site import ROOT, free_port

PROGRAM = "/usr/bin/turnserver"
SECRET = "shared-with-the-site"


def deployed_limits() -> tuple[str, ...]:
    """Return the limits of a deployed relay as options: no peers in inner networks, and quotas."""
    lines = (ROOT / "deploy/coturn/turnserver.conf").read_text().splitlines()
    limits = ("denied-peer-ip", "no-multicast-peers", "user-quota", "total-quota", "max-bps")
    return tuple(f"--{line}" for line in lines if line.startswith(limits))


class Coturn:
    """A relay that listens and relays at `address`, as a process of `user`; `ca` is its certificate
    for TLS. Without `limits` (see `deployed_limits`) it relays to any address.
    """

    def __init__(
        self,
        directory: Path,
        address: str = "127.0.0.1",
        user: str | None = None,
        ports: tuple[int, int] | None = None,
        limits: tuple[str, ...] = (),
    ) -> None:
        self.directory, self.address, self.user = directory, address, user
        self.port, self.tls_port = ports or (free_port(), free_port())
        self.limits = limits or ("--allow-loopback-peers",)
        self.ca = directory / "fullchain.pem"
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        key, _ = certificate(self.directory, "localhost", *({self.address} - {"127.0.0.1"}))
        if self.user:
            for file in (self.directory, key, self.ca):
                shutil.chown(file, self.user, self.user)
        options = f"""-n --no-cli --log-file=stdout --realm=tests --fingerprint
            --listening-ip={self.address} --relay-ip={self.address}
            --listening-port={self.port} --tls-listening-port={self.tls_port}
            --use-auth-secret --static-auth-secret={SECRET} --cert={self.ca} --pkey={key}
            --pidfile={self.directory}/turn.pid --userdb={self.directory}/turn.db"""
        self.process = subprocess.Popen(
            [PROGRAM, *options.split(), *self.limits],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            user=self.user,
            group=self.user,
            extra_groups=[] if self.user else None,
        )
        deadline = time.monotonic() + patient(10.0)
        while not (self._listens(self.port) and self._listens(self.tls_port)):
            assert self.process.poll() is None, "coturn ended"
            assert time.monotonic() < deadline, "coturn does not listen"
            time.sleep(0.05)
        return self

    def __exit__(self, *_: object) -> None:
        assert self.process
        self.process.terminate()
        self.process.wait(patient(5.0))

    def server(self, *transports: str, secret: str = SECRET) -> IceServer:
        """Return the relay as the site announces it, by `udp`, `tcp` or `tls`."""
        urls = {
            "udp": f"turn:{self.address}:{self.port}?transport=udp",
            "tcp": f"turn:{self.address}:{self.port}?transport=tcp",
            "tls": f"turns:{self.address}:{self.tls_port}?transport=tcp",
        }
        username, credential = turn_credentials("ada", secret, time.time())
        chosen = tuple(urls[name] for name in transports)
        return IceServer(urls=chosen, username=username, credential=credential)

    def trust(self, monkeypatch) -> None:
        """Make this process trust its certificate, as a system trusts a public one."""
        monkeypatch.setenv("SSL_CERT_FILE", str(self.ca))
        assert ssl.create_default_context().cert_store_stats()["x509_ca"] >= 0

    def _listens(self, port: int) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex((self.address, port)) == 0
