"""A database into one file and back, with each engine's own means: SQLite's online backup,
PostgreSQL's pg_dump and pg_restore.

Both give one moment of a running site. A database is restored only where none is: no table at all.
"""

import os
import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any

from django.db import connection

from telepresence_site.ops.backup.archive import BackupError

MEMBERS = {"sqlite": "database.sqlite3", "postgresql": "database.pgdump"}
OPTIONS = {
    **{
        name: f"PG{name.upper()}"
        for name in ("sslmode", "sslrootcert", "sslcert", "sslkey", "service", "passfile")
    },
    "connect_timeout": "PGCONNECT_TIMEOUT",
    "target_session_attrs": "PGTARGETSESSIONATTRS",  # of several servers the primary
}


def member() -> str:
    """Return the name of the dump in an archive.

    Raises:
        BackupError: this engine has other means.
    """
    if connection.vendor not in MEMBERS:
        raise BackupError(
            f"Back up a {connection.vendor} database with its own tools (MongoDB: "
            "mongodump, mongorestore)."
        )
    return MEMBERS[connection.vendor]


def dump(path: Path) -> None:
    if connection.vendor == "sqlite":
        with (
            closing(sqlite3.connect(_sqlite_file())) as source,
            closing(sqlite3.connect(path)) as target,
        ):
            source.backup(target)
    else:
        _run("pg_dump", "--format=custom", "--no-owner", "--no-privileges", f"--file={path}")
    path.chmod(0o600)


def load(path: Path) -> None:
    if connection.vendor == "sqlite":
        with (
            closing(sqlite3.connect(path)) as source,
            closing(sqlite3.connect(_sqlite_file())) as target,
        ):
            source.backup(target)
        _sqlite_file().chmod(0o600)
    else:
        # All of it or nothing.
        _run(
            "pg_restore",
            "--single-transaction",
            "--exit-on-error",
            "--no-owner",
            "--no-privileges",
            f"--dbname={_name()}",
            str(path),
        )


def is_empty() -> bool:
    if connection.vendor == "sqlite" and not _sqlite_file().exists():
        return True
    with connection.cursor() as cursor:
        return not connection.introspection.table_names(cursor)


def _sqlite_file() -> Path:
    return Path(str(connection.settings_dict["NAME"]))


def _name() -> str:
    return str(connection.settings_dict["NAME"])


def _run(program: str, *arguments: str) -> None:
    found = shutil.which(program)
    if found is None:
        raise BackupError(f"{program} is not installed (Debian: apt install postgresql-client).")
    done = subprocess.run(
        [found, *arguments],
        env={**os.environ, **_environment()},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise BackupError(
            f"{program} failed:"
            f" {done.stderr.strip().splitlines()[-1] if done.stderr.strip() else done.returncode}"
        )


def _environment() -> dict[str, str]:
    """Return libpq's variables: a password does not belong on a command line."""
    given: dict[str, Any] = connection.settings_dict
    names = {
        "PGHOST": "HOST",
        "PGPORT": "PORT",
        "PGUSER": "USER",
        "PGPASSWORD": "PASSWORD",
        "PGDATABASE": "NAME",
    }
    variables = {variable: str(given[name]) for variable, name in names.items() if given.get(name)}
    options = {
        variable: str(given["OPTIONS"][name])
        for name, variable in OPTIONS.items()
        if given.get("OPTIONS", {}).get(name)
    }
    return variables | options
