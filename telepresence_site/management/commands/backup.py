"""`manage.py backup FILE`: the database, secrets, credentials and media of a running site in one
file.
"""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from telepresence_site.ops.backup.archive import BackupError
from telepresence_site.ops.backup.whole import back_up


class Command(BaseCommand):
    """Never overwrites anything."""

    help = (
        "Write everything that cannot be made again into one new file, readable by its owner alone;"
        " the site may go on running."
    )
    requires_system_checks: list[str] = []

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument(
            "file", type=Path, help="such as /backup/telepresence-2026-11-21.tar.gz"
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        try:
            manifest = back_up(options["file"], timezone.now())
        except BackupError as error:
            raise CommandError(str(error)) from error
        size = sum(file["size"] for file in manifest["files"].values())
        self.stdout.write(
            f"{len(manifest['files'])} files, {size / 1e6:.1f} MB, in {options['file']}. It holds"
            " keys: keep it like one."
        )
