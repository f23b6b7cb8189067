"""`manage.py restore FILE`: an empty site from a backup."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from telepresence_site.ops.backup.archive import GB, BackupError
from telepresence_site.ops.backup.whole import LARGEST, restore


class Command(BaseCommand):
    help = "Fill an empty database and an empty VAR_DIR from what `backup` wrote."
    requires_system_checks: list[str] = []

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("file", type=Path)
        check = "only read it to the end and verify every checksum"
        parser.add_argument("--check", action="store_true", help=check)
        largest = "refuse a backup that unpacks to more than so many GB (default: %(default)g)"
        parser.add_argument("--largest-gb", type=float, default=LARGEST / GB, help=largest)

    def handle(self, *_args: Any, **options: Any) -> None:
        try:
            largest = int(options["largest_gb"] * GB)
            manifest, words = restore(options["file"], check_only=options["check"], largest=largest)
        except BackupError as error:
            raise CommandError(str(error)) from error
        done = "is sound" if options["check"] else "is restored"
        self.stdout.write(
            f"The backup of {manifest['made_at']} with {len(manifest['files'])} files {done}."
        )
        for sentence in words:
            self.stdout.write(sentence)
