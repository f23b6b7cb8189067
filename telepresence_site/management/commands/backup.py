"""`manage.py backup FILE`: a site's database, secrets, credentials and media in one file."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from telepresence_site.ops.backup.archive import BackupError
from telepresence_site.ops.backup.whole import back_up


class Command(BaseCommand):
    help = (
        "Write everything that cannot be recreated into one new file that "
        "only its owner can read; the site can keep running."
    )
    requires_system_checks: list[str] = []

    def add_arguments(self, parser: ArgumentParser) -> None:
        example = "such as /backup/telepresence-2026-11-21.tar.gz"
        parser.add_argument("file", type=Path, help=example)

    def handle(self, *_args: Any, **options: Any) -> None:
        try:
            manifest = back_up(options["file"], timezone.now())
        except BackupError as error:
            raise CommandError(str(error)) from error
        size = sum(file["size"] for file in manifest["files"].values())
        self.stdout.write(
            f"{len(manifest['files'])} files, {size / 1000000.0:.1f} MB, in "
            f"{options['file']}. It contains keys: protect it like one."
        )
