"""Settings from environment variables (listed in docs/reference/settings.md), and private files."""

import contextlib
import os
import secrets
from pathlib import Path

from robots.api.private_files import write_private

READ: set[str] = set()  # the names of all variables that the settings have read


def text(name: str, default: str = "") -> str:
    """Return an environment variable, or the default when it is unset or empty."""
    READ.add(name)
    return os.environ.get(name) or default


def flag(name: str, *, default: bool = False) -> bool:
    """Tell whether an environment variable is 1, true, yes or on."""
    READ.add(name)
    value = os.environ.get(name)
    return default if not value else value.strip().lower() in {"1", "true", "yes", "on"}


def words(name: str, default: str = "") -> list[str]:
    return [word.strip() for word in text(name, default).split(",") if word.strip()]


def kept_secret(path: Path, nbytes: int = 48) -> str:
    """Return the secret in a file that only its owner can read, created by the first call.

    Raises:
        ValueError: the file is empty.
    """
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        # of two processes that start together, one creates the secret and the other reads it
        with contextlib.suppress(FileExistsError):
            write_private(path, secrets.token_urlsafe(nbytes), replace=False)
    secret = path.read_text().strip()
    if not secret:
        raise ValueError(f"{path} is empty. Delete it, and a new secret is made.")
    return secret


def private_folder(path: Path) -> Path:
    """Create a folder that only its owner can read. An existing one stays as it is (check
    telepresence.W009 reports it).
    """
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    return path


def private_sqlite(name: str) -> None:
    """Create a database's file, readable by its owner alone, before SQLite does, which gives the
    files beside it (-wal, -shm) the same mode.
    """
    path = Path(name)
    # in memory, or an address of SQLite's own
    if name.startswith((":", "file:")) or not path.parent.is_dir():
        return
    with contextlib.suppress(FileExistsError):
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    for file in (path, *(path.with_name(path.name + part) for part in ("-wal", "-shm"))):
        # absent, or of another user
        with contextlib.suppress(FileNotFoundError, PermissionError):
            file.chmod(0o600)
