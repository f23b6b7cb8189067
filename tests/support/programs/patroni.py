"""PostgreSQL on several nodes, run by Patroni as in deploy/patroni, with one etcd: all on loopback,
each node in its own directory. Only addresses, paths and names differ from the deployed settings.
"""

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
import urllib.error
import urllib.request
from collections.abc import Iterable, Iterator
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
    """Patroni and its server; `kill` and `hold` act on both, as on a whole machine."""

    name: str = ""
    etcd: tuple[str, ...] = ()  # host:port
    host: str = LOOPBACK
    clients: str = f"{LOOPBACK}/32"  # the network from which clients may connect
    api_port: int = field(default_factory=free_port)
    patroni: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"postgres://{OWNER}:{PASSWORD}@{self.host}:{self.port}/postgres"

    def start(self) -> None:
        """Start Patroni, which makes a primary, or a copy of the existing one."""
        path = self.directory / "config.yml"
        path.write_text(self._config())
        self.patroni.append(spawn(self.directory, _found("patroni"), str(path)))

    def adopt(self) -> None:
        """Make a server with all tables, and the roles that Patroni would make in an empty one."""
        subprocess.run(["cp", "-a", migrated(), self.data], check=True)
        alone = Postgres(self.directory, self.port)
        alone.start()
        roles = {"replicator": "REPLICATION", "rewind": "SUPERUSER"}
        for role, may in roles.items():
            alone.ask(f"CREATE ROLE {role} {may} LOGIN PASSWORD '{PASSWORD}'")
        alone.ask(f"ALTER ROLE {OWNER} PASSWORD '{PASSWORD}'")
        alone.stop("fast")

    def stop(self, mode: str = "") -> None:
        """End Patroni, which ends its server."""
        process = self.patroni.pop()
        process.terminate()
        process.wait(patient(20))

    def restart(self) -> None:
        """Start it again after `kill`."""
        self.patroni.pop().wait(patient(10))
        self.start()

    def begin(self) -> None:
        """Start it for the first time or again."""
        self.restart() if self.patroni else self.start()

    @property
    def is_running(self) -> bool:
        return bool(self.patroni) and self.patroni[-1].poll() is None

    def status(self) -> dict[str, Any]:
        """Return what Patroni reports of its node, nothing if it does not answer."""
        with contextlib.suppress(OSError, urllib.error.URLError, json.JSONDecodeError):
            url = f"http://{self.host}:{self.api_port}/cluster"
            with urllib.request.urlopen(url, timeout=2) as answer:
                members = json.load(answer)["members"]
                return next((one for one in members if one["name"] == self.name), {})
        return {}

    def log(self) -> str:
        return (self.directory / "patroni.log").read_text(errors="replace")[-3000:]

    def is_leading(self) -> bool:
        return self.has_role("leader")

    def is_following(self) -> bool:
        return self.has_role("sync_standby") or self.has_role("replica")

    def has_role(self, role: str) -> bool:
        status = self.status()
        return status.get("role") == role and status.get("state") in {"running", "streaming"}

    def _config(self) -> str:
        text = CONFIG.read_text()
        for old, new in {
            "NAME": self.name,
            "SECRET": PASSWORD,
            "ADDRESS:8008": f"{self.host}:{self.api_port}",
            "ADDRESS:5432": f"{self.host}:{self.port}",
            "[10.0.0.1:2379, 10.0.0.2:2379, 10.0.0.3:2379]": f"[{', '.join(self.etcd)}]",
            "/var/lib/postgresql/15/telepresence": self.data,
            "/usr/lib/postgresql/15/bin": str(Path(program("postgres")).parent),
            "/var/lib/postgresql/telepresence.pgpass": str(self.directory / "pgpass"),
            "/var/run/postgresql": str(self.directory),
            "local all all peer": "local all all trust",
            "10.0.0.0/24": self.clients,
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
    """Start a program as PostgreSQL's user, with a log beside its data."""
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
def owned_folder() -> Iterator[Path]:
    """Make a folder that PostgreSQL's user can reach: pytest's are root's alone."""
    folder = Path(tempfile.mkdtemp(prefix="telepresence-patroni-"))
    if os.geteuid() == 0:
        shutil.chown(folder, OWNER)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@dataclass
class EtcdNode:
    """One node of etcd."""

    name: str
    directory: Path
    host: str = LOOPBACK
    port: int = field(default_factory=free_port)
    peer_port: int = field(default_factory=free_port)

    @property
    def address(self) -> str:
        return f"{self.host}:{self.port}"

    @property
    def member(self) -> str:
        """Its name and address among the nodes."""
        return f"{self.name}=http://{self.host}:{self.peer_port}"

    def start(self, members: Iterable["EtcdNode"]) -> None:
        """Start it as one of these; after `kill` as well."""
        own, among = f"http://{self.address}", f"http://{self.host}:{self.peer_port}"
        self.process = spawn(
            self.directory,
            _found("etcd"),
            *("--name", self.name, "--data-dir", str(self.directory / "data")),
            *("--listen-client-urls", own, "--advertise-client-urls", own),
            *("--listen-peer-urls", among, "--initial-advertise-peer-urls", among),
            *("--initial-cluster", ",".join(node.member for node in members)),
        )

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(patient(10))


@contextlib.contextmanager
def running_patroni() -> Iterator[tuple[PatroniNode, PatroniNode]]:
    """Start a primary with all tables and nothing in them, and a synchronous standby."""
    with owned_folder() as etcds, owned_folder() as one, owned_folder() as other:
        etcd = EtcdNode("etcd", etcds)
        etcd.start([etcd])
        nodes = tuple(
            PatroniNode(folder, free_port(), name=name, etcd=(etcd.address,))
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
            etcd.kill()
