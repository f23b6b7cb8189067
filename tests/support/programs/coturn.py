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
    """Return what the relay of a real server refuses, as options: peers in inner networks, more
    than a share for each.
    """
    lines = (ROOT / "deploy/coturn/turnserver.conf").read_text().splitlines()
    return tuple(
        f"--{line}"
        for line in lines
        if line.startswith(
            ("denied-peer-ip", "no-multicast-peers", "user-quota", "total-quota", "max-bps")
        )
    )


class Coturn:
    """A relay. `address` is where it listens and relays; `ca` is the certificate that it shows for
    TLS; `user` is whose process it is.

    `limits` are more of its options, such as those of deploy/coturn, see `deployed_limits`; without
    any it relays to wherever asked.
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
        self.process = subprocess.Popen(
            [
                PROGRAM,
                "-n",
                "--no-cli",
                "--log-file=stdout",
                f"--listening-ip={self.address}",
                f"--relay-ip={self.address}",
                f"--listening-port={self.port}",
                f"--tls-listening-port={self.tls_port}",
                "--realm=tests",
                "--use-auth-secret",
                f"--static-auth-secret={SECRET}",
                f"--cert={self.ca}",
                f"--pkey={key}",
                *self.limits,
                "--fingerprint",
                f"--pidfile={self.directory}/turn.pid",
                f"--userdb={self.directory}/turn.db",
            ],
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

    def server(self, *ways: str, secret: str = SECRET) -> IceServer:
        """Return the relay as the site names it to pages and robots, by `udp`, `tcp` or `tls`."""
        urls = {
            "udp": f"turn:{self.address}:{self.port}?transport=udp",
            "tcp": f"turn:{self.address}:{self.port}?transport=tcp",
            "tls": f"turns:{self.address}:{self.tls_port}?transport=tcp",
        }
        username, credential = turn_credentials("ada", secret, time.time())
        return IceServer(
            urls=tuple(urls[way] for way in ways), username=username, credential=credential
        )

    def trust(self, monkeypatch) -> None:
        """Let this process trust its certificate, as a system trusts one that was bought."""
        monkeypatch.setenv("SSL_CERT_FILE", str(self.ca))
        assert ssl.create_default_context().cert_store_stats()["x509_ca"] >= 0

    def _listens(self, port: int) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex((self.address, port)) == 0
