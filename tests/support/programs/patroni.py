"""PostgreSQL on several nodes, run by Patroni as deploy/patroni has it, with one etcd: all on
loopback, each node in a directory of its own.

Patroni gives its servers their settings; what a test changes are addresses, paths and names.
"""

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.postgres import OWNER, Postgres, identity, migrated, program
from tests.support.sessions.site import LOOPBACK, free_port, wait_for

CONFIG = ROOT / "deploy/patroni/telepresence.yml"
PASSWORD = "tests-only"


@dataclass(frozen=True)
class PatroniNode(Postgres):
    """Patroni and the server that it runs; `kill` and `hold` mean the whole machine."""

    name: str = ""
    etcd_port: int = 0
    api_port: int = field(default_factory=free_port)
    patroni: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"postgres://{OWNER}:{PASSWORD}@{LOOPBACK}:{self.port}/postgres"

    def start(self) -> None:
        """Start Patroni, which makes a primary, or a copy of the one that is there."""
        path = self.directory / "config.yml"
        path.write_text(self._config())
        self.patroni.append(spawn(self.directory, _found("patroni"), str(path)))

    def adopt(self) -> None:
        """Have a server with all tables, and the roles that Patroni would make in an empty one."""
        subprocess.run(["cp", "-a", migrated(), self.data], check=True)
        super().start()
        roles = {"replicator": "REPLICATION", "rewind": "SUPERUSER"}
        for role, may in roles.items():
            self.ask(f"CREATE ROLE {role} {may} LOGIN PASSWORD '{PASSWORD}'")
        self.ask(f"ALTER ROLE {OWNER} PASSWORD '{PASSWORD}'")
        super().stop("fast")

    def stop(self, mode: str = "") -> None:
        """End Patroni, which ends its server."""
        process = self.patroni.pop()
        process.terminate()
        process.wait(patient(20))

    def restart(self) -> None:
        """Start it as it was left by `kill`."""
        self.patroni.pop().wait(patient(10))
        self.start()

    @property
    def is_running(self) -> bool:
        return bool(self.patroni) and self.patroni[-1].poll() is None

    def status(self) -> dict[str, Any]:
        """What Patroni says of its node."""
        with contextlib.suppress(OSError, urllib.error.URLError, json.JSONDecodeError):
            url = f"http://{LOOPBACK}:{self.api_port}/cluster"
            with urllib.request.urlopen(url, timeout=2) as answer:
                members = json.load(answer)["members"]
                return next((one for one in members if one["name"] == self.name), {})
        return {}

    def log(self) -> str:
        """Return the end of what Patroni says."""
        return (self.directory / "patroni.log").read_text(errors="replace")[-3000:]

    def has_role(self, role: str) -> bool:
        status = self.status()
        return status.get("role") == role and status.get("state") in {"running", "streaming"}

    def _config(self) -> str:
        text = CONFIG.read_text()
        for old, new in {
            "NAME": self.name,
            "SECRET": PASSWORD,
            "ADDRESS:8008": f"{LOOPBACK}:{self.api_port}",
            "ADDRESS:5432": f"{LOOPBACK}:{self.port}",
            "[10.0.0.1:2379, 10.0.0.2:2379, 10.0.0.3:2379]": f"[{LOOPBACK}:{self.etcd_port}]",
            "/var/lib/postgresql/15/telepresence": self.data,
            "/usr/lib/postgresql/15/bin": str(Path(program("postgres")).parent),
            "/var/lib/postgresql/telepresence.pgpass": str(self.directory / "pgpass"),
            "/var/run/postgresql": str(self.directory),
            "local all all peer": "local all all trust",
            "10.0.0.0/24": f"{LOOPBACK}/32",
        }.items():
            assert old in text, f"{CONFIG} has no {old}"
            text = text.replace(old, new)
        return text

    def _processes(self) -> list[psutil.Process]:
        found: dict[int, psutil.Process] = {}
        with contextlib.suppress(FileNotFoundError, psutil.NoSuchProcess):
            found = {one.pid: one for one in super()._processes()}
        with contextlib.suppress(IndexError, psutil.NoSuchProcess):
            parent = psutil.Process(self.patroni[-1].pid)
            found |= {one.pid: one for one in [parent, *parent.children(recursive=True)]}
        return list(found.values())


def _found(name: str) -> str:
    path = shutil.which(name)
    assert path, f"{name} is not installed: sh deploy/test_packages.sh"
    return path


def spawn(directory: Path, *command: str) -> subprocess.Popen[bytes]:
    """Start a program as PostgreSQL's user; its output goes to a log beside its data."""
    with (directory / f"{Path(command[0]).name}.log").open("ab") as log:
        return subprocess.Popen(
            command,
            cwd=directory,
            env={**os.environ, "HOME": str(directory)},
            stdout=log,
            stderr=subprocess.STDOUT,
            **identity(),
        )


@contextlib.contextmanager
def _folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="telepresence-patroni-"))
    if os.geteuid() == 0:
        shutil.chown(folder, OWNER)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _etcd() -> Iterator[int]:
    port, among = free_port(), f"http://{LOOPBACK}:{free_port()}"
    own = f"http://{LOOPBACK}:{port}"
    with _folder() as folder:
        process = spawn(
            folder,
            _found("etcd"),
            *("--name", "etcd", "--data-dir", str(folder / "data")),
            *("--listen-client-urls", own, "--advertise-client-urls", own),
            *("--listen-peer-urls", among, "--initial-advertise-peer-urls", among),
            *("--initial-cluster", f"etcd={among}"),
        )
        try:
            yield port
        finally:
            process.terminate()
            process.wait(patient(10))


@contextlib.contextmanager
def running_patroni() -> Iterator[tuple[PatroniNode, PatroniNode]]:
    """Start a primary with all tables and nothing in them, and a synchronous standby."""
    with _etcd() as etcd, _folder() as one, _folder() as other:
        nodes = tuple(
            PatroniNode(folder, free_port(), name=name, etcd_port=etcd)
            for name, folder in (("one", one), ("other", other))
        )
        primary, standby = nodes
        try:
            primary.adopt()
            primary.start()
            wait_for(lambda: primary.has_role("leader"), 60, "a primary", primary.log)
            standby.start()
            wait_for(lambda: standby.has_role("sync_standby"), 90, "a standby", standby.log)
            yield primary, standby
        finally:
            for node in reversed(nodes):
                if node.is_running:
                    node.stop()
