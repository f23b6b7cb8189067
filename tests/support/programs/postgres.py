"""A real PostgreSQL server for one test, in a temporary directory on an unused port.

PostgreSQL refuses to run as root: tests of root run it as the user `postgres`.
"""

import contextlib
import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import psycopg

from tests.support.analysis.kept_folder import kept_folder
from tests.support.patience import patient
from tests.support.sessions.site import MIGRATIONS, Site, free_port, wait_for

OWNER = "postgres"
PROGRAMS = Path("/usr/lib/postgresql")


@dataclass(frozen=True)
class Postgres:
    """A running server; `url` is a DATABASE_URL of its database."""

    directory: Path
    port: int
    options: tuple[str, ...] = ()  # the last one of a name counts

    @property
    def url(self) -> str:
        return f"postgres://{OWNER}@127.0.0.1:{self.port}/postgres"

    @property
    def data(self) -> str:
        return str(self.directory / "data")

    def start(self) -> None:
        options = (
            f"-p {self.port} -c listen_addresses=127.0.0.1 -c"
            f" unix_socket_directories={self.directory} -c fsync=off -c max_connections=40"
            f" {' '.join(self.options)}"
        )
        self._control("start", "-t", "60", "-l", str(self.directory / "log"), "-o", options)

    def _control(self, command: str, *options: str) -> None:
        _run(program("pg_ctl"), command, "-D", self.data, "-w", *options, cwd=self.directory)

    def stop(self, mode: str = "immediate") -> None:
        """End it as a crash does; `fast` ends it in order."""
        self._control("stop", "-m", mode)

    def kill(self) -> None:
        """End it as a loss of power does."""
        psutil.wait_procs(self._each(psutil.Process.kill), patient(10))

    def hold(self) -> None:
        """Suspend its processes, which keeps all connections open."""
        self._each(psutil.Process.suspend)

    def go_on(self) -> None:
        self._each(psutil.Process.resume)

    def _each(self, act: Callable[[psutil.Process], None]) -> list[psutil.Process]:
        processes = self._processes()
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):  # a connection may have ended
                act(process)
        return processes

    def promote(self) -> None:
        """Make this standby the primary."""
        self._control("promote")

    def ask(self, sql: str, *values: Any) -> list[tuple[Any, ...]]:
        """Return the rows of a query, or none of a statement without any."""
        with psycopg.connect(self.url, autocommit=True, connect_timeout=5) as connection:
            answer = connection.execute(sql, values)
            return answer.fetchall() if answer.description else []

    @property
    def is_running(self) -> bool:
        """Whether it has neither been ended nor killed."""
        try:
            return self._processes()[0].status() != psutil.STATUS_ZOMBIE
        except (FileNotFoundError, psutil.NoSuchProcess):
            return False

    def _processes(self) -> list[psutil.Process]:
        pid = (self.directory / "data" / "postmaster.pid").read_text().split()[0]
        postmaster = psutil.Process(int(pid))
        return [postmaster, *postmaster.children(recursive=True)]


def program(name: str) -> str:
    """Return the path of a PostgreSQL program; a missing one fails the test."""
    found = sorted(PROGRAMS.glob(f"*/bin/{name}"), key=lambda path: int(path.parts[-3]))
    found = found or [Path(shutil.which(name) or "")]
    assert found[-1].is_file(), f"{name} is not installed: apt-get install postgresql"
    return str(found[-1])


def identity() -> dict[str, int]:
    """Return the user of a server, as arguments for subprocess."""
    if os.geteuid() != 0:
        return {}
    owner = pwd.getpwnam(OWNER)
    return {"user": owner.pw_uid, "group": owner.pw_gid, "extra_groups": []}


def _run(*command: str, cwd: Path) -> None:
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False, **identity()
    )
    assert done.returncode == 0, done.stdout + done.stderr


@contextlib.contextmanager
def running_postgres(*options: str) -> Iterator[Postgres]:
    """Start a server whose database has all tables, and no rows in them."""
    with _server(*options) as server:
        subprocess.run(["cp", "-a", migrated(), server.data], check=True)
        server.start()
        try:
            yield server
        finally:
            if server.is_running:
                server.stop()


@contextlib.contextmanager
def running_pair() -> Iterator[tuple[Postgres, Postgres]]:
    """Start a server as `running_postgres` does, and a synchronous standby."""
    with running_postgres() as primary, _server() as standby:
        copy = ("-h", "127.0.0.1", "-p", str(primary.port), "-U", OWNER, "-D", standby.data)
        quickly = ("--checkpoint=fast", "--no-sync", "--write-recovery-conf")
        _run(program("pg_basebackup"), *copy, *quickly, cwd=standby.directory)
        standby.start()
        try:
            primary.ask("ALTER SYSTEM SET synchronous_standby_names = '*'")
            primary.ask("SELECT pg_reload_conf()")
            synchronous = "SELECT 1 FROM pg_stat_replication WHERE sync_state = 'sync'"
            wait_for(lambda: primary.ask(synchronous), 20, "a synchronous standby")
            yield primary, standby
        finally:
            if standby.is_running:
                standby.stop()


@contextlib.contextmanager
def _server(*options: str) -> Iterator[Postgres]:
    directory = Path(tempfile.mkdtemp(prefix="telepresence-postgres-"))
    if os.geteuid() == 0:
        shutil.chown(directory, OWNER)
    try:
        yield Postgres(directory, free_port(), options)
    finally:
        shutil.rmtree(directory, ignore_errors=True)


def migrated() -> Path:
    """Return the data folder of a migrated server, made once for these migrations."""
    programs = [Path(program(name)) for name in ("initdb", "postgres")]
    return kept_folder("postgres", [*MIGRATIONS, *programs], _migrate) / "data"


def _migrate(folder: Path) -> None:
    with _server() as server:
        as_utf8 = ("--auth=trust", "-E", "UTF8", "--no-sync")
        _run(program("initdb"), "-D", server.data, "-U", OWNER, *as_utf8, cwd=server.directory)
        server.start()
        try:
            site = Site(server.directory / "var", settings={"DATABASE_URL": server.url})
            site.run("manage.py", "migrate", "-v", "0")
        finally:
            server.stop("fast")
        subprocess.run(["cp", "-a", server.data, folder], check=True)
