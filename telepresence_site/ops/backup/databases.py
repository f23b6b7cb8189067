"""Dumps and restores the database: SQLite's online backup, PostgreSQL's pg_dump and pg_restore.

Both copy one moment of a running site. A restore needs a database without tables.
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
PG_OPTIONS = ("sslmode", "sslrootcert", "sslcert", "sslkey", "service", "passfile")
# libpq's environment variables, by Django's settings and by options of the connection
VARIABLES = {
    "HOST": "PGHOST",
    "PORT": "PGPORT",
    "USER": "PGUSER",
    "PASSWORD": "PGPASSWORD",
    "NAME": "PGDATABASE",
    **{name: f"PG{name.upper()}" for name in PG_OPTIONS},
    "connect_timeout": "PGCONNECT_TIMEOUT",
    "target_session_attrs": "PGTARGETSESSIONATTRS",  # the primary of several servers
}


def member() -> str:
    """Return the name of the dump in an archive.

    Raises:
        BackupError: this engine has its own tools.
    """
    if connection.vendor not in MEMBERS:
        raise BackupError(
            f"Back up a {connection.vendor} database with its own tools (MongoDB: "
            "mongodump, mongorestore)."
        )
    return MEMBERS[connection.vendor]


def dump(path: Path) -> None:
    if connection.vendor == "sqlite":
        _copy_sqlite(_sqlite_file(), path)
    else:
        _run("pg_dump", "--format=custom", "--no-owner", "--no-privileges", f"--file={path}")
    path.chmod(0o600)


def load(path: Path) -> None:
    if connection.vendor == "sqlite":
        _copy_sqlite(path, _sqlite_file())
        _sqlite_file().chmod(0o600)
    else:
        whole = ("--single-transaction", "--exit-on-error", "--no-owner", "--no-privileges")
        database = f"--dbname={connection.settings_dict['NAME']}"
        _run("pg_restore", *whole, database, str(path))


def _copy_sqlite(source: Path, target: Path) -> None:
    with closing(sqlite3.connect(source)) as of, closing(sqlite3.connect(target)) as to:
        of.backup(to)


def is_empty() -> bool:
    if connection.vendor == "sqlite" and not _sqlite_file().exists():
        return True
    with connection.cursor() as cursor:
        return not connection.introspection.table_names(cursor)


def _sqlite_file() -> Path:
    return Path(str(connection.settings_dict["NAME"]))


def _run(program: str, *arguments: str) -> None:
    found = shutil.which(program)
    if found is None:
        raise BackupError(f"{program} is not installed (Debian: apt install postgresql-client).")
    given: dict[str, Any] = {**connection.settings_dict.get("OPTIONS", {})}
    given |= connection.settings_dict
    # in the environment, because other users can read a password on a command line
    variables = {VARIABLES[name]: str(given[name]) for name in VARIABLES if given.get(name)}
    done = subprocess.run(
        [found, *arguments],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last_line = done.stderr.strip().splitlines()[-1:]
        raise BackupError(f"{program} failed: {last_line[0] if last_line else done.returncode}")
