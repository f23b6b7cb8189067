"""Backup and restore of a site: its database, and the files in VAR_DIR that are not recreated."""

import shutil
import tempfile
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from django.conf import settings
from django.db import connection
from django.db.migrations.loader import MigrationLoader
from django.utils.crypto import salted_hmac

from robots.files.limited_process import ChildLimits, ImportRefusedError, run_limited
from telepresence_site.ops.backup import archive, databases
from telepresence_site.ops.backup.archive import BackupError

# Not the broker's store (robots and servers republish its content), logs, static files, sandboxes
# and mail.
FOLDERS = ("secrets", "credentials", "media", "sites")
LARGEST = 20 * archive.GB  # bytes, unless the operator allows more
RESERVE = archive.GB  # bytes of the disk that a restore leaves free
UNPACKING = ChildLimits(memory=2 * archive.GB, processor=4 * 3600, elapsed=8 * 3600.0)
REPLACED = Path("secrets/secret_key")  # every command creates it, also `restore`


def back_up(target: Path, now: datetime) -> dict[str, Any]:
    """Write everything into one new file, while the site runs, and return the manifest.

    Raises:
        BackupError: it failed; no file is left.
    """
    name = databases.member()
    with tempfile.TemporaryDirectory(dir=settings.VAR_DIR, prefix="backup-") as directory:
        dump = Path(directory) / name
        databases.dump(dump)
        applied = MigrationLoader(connection).applied_migrations
        facts = {
            "made_at": now.isoformat(),
            "engine": connection.vendor,
            "migrations": sorted(f"{app}.{name}" for app, name in applied),
            "key": _key_id(),
        }
        return archive.write(target, [(name, dump), *_files()], facts)


def restore(
    source: Path, *, check_only: bool = False, largest: int = LARGEST
) -> tuple[dict[str, Any], list[str]]:
    """Fill an empty site from a backup; return the manifest and sentences for the operator.

    With `check_only`, only read the backup to its end and verify every checksum. It may unpack to
    `largest` bytes, if the disk has that much room.

    Raises:
        BackupError: the backup is damaged or not for this site, or the site is not empty; nothing
            was changed.
    """
    if not check_only:
        _must_be_empty()
    with tempfile.TemporaryDirectory(dir=settings.VAR_DIR, prefix="restore-") as directory:
        staged = Path(directory)
        manifest = _unpacked(source, staged, largest)
        words = _check_fits(manifest)
        if not check_only:
            databases.load(staged / databases.member())
            for name in manifest["files"]:
                if name.partition("/")[0] in FOLDERS:
                    target = settings.VAR_DIR / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    (staged / name).chmod(0o600)
                    shutil.move(staged / name, target)
    return manifest, words


def _unpacked(source: Path, directory: Path, largest: int) -> dict[str, Any]:
    room = max(shutil.disk_usage(directory).free - RESERVE, 0)
    try:
        manifest: dict[str, Any] = run_limited(
            archive.unpack, str(source), str(directory), min(largest, room), limits=UNPACKING
        )
    except ImportRefusedError as error:
        raise BackupError(str(error)) from error
    return manifest


def _files() -> Iterator[tuple[str, Path]]:
    for folder in FOLDERS:
        for path in sorted((settings.VAR_DIR / folder).rglob("*")):
            if path.is_file() and not path.is_symlink():
                yield path.relative_to(settings.VAR_DIR).as_posix(), path


def _must_be_empty() -> None:
    if not databases.is_empty():
        raise BackupError(
            "The database is not empty; a restore never overwrites anything. Set "
            "DATABASE_URL to an empty one, or set another VAR_DIR."
        )
    there = [name for name, _ in _files() if Path(name) != REPLACED]
    if there:
        raise BackupError(
            f"{settings.VAR_DIR} is not empty ({there[0]}); a restore never "
            "overwrites anything. Set another VAR_DIR."
        )


def _check_fits(manifest: dict[str, Any]) -> list[str]:
    if manifest["engine"] != connection.vendor:
        raise BackupError(
            f"The backup is of a {manifest['engine']} database, but DATABASE_URL "
            f"names a {connection.vendor} one."
        )
    migrations = MigrationLoader(None, ignore_no_migrations=True).disk_migrations.values()
    known = {str(migration) for migration in migrations}
    replaced = {f"{app}.{name}" for migration in migrations for app, name in migration.replaces}
    newer = sorted(set(manifest["migrations"]) - known - replaced)
    if newer:
        count = "one migration" if len(newer) == 1 else f"{len(newer)} migrations"
        raise BackupError(
            f"The backup is from a newer version ({count} unknown here, first {newer[0]}): "
            f"update the code first."
        )
    words = []
    if known - set(manifest["migrations"]):
        words.append("The backup is from an older version: run manage.py migrate.")
    if "secrets/secret_key" not in manifest["files"] and manifest["key"] != _key_id():
        words.append(
            "SECRET_KEY differs from that of the backup: everybody has to log in again, and "
            "links that were sent no longer work."
        )
    return words


def _key_id() -> str:
    """Return a text that identifies the secret key without revealing it."""
    digest = salted_hmac("telepresence_site.backing_up", "which key", algorithm="sha256")
    return digest.hexdigest()[:16]
