"""`manage.py interventions FILE`: the log of interventions as a file, and back."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from accounts import interventions


class Command(BaseCommand):
    help = (
        "Write the log of interventions to a new file, a line of JSON each; with --merge, add what "
        "such a file has and this site's log has not, as after a restore of an older backup."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("file", type=Path)
        parser.add_argument("--merge", action="store_true", help="read the file instead")

    def handle(self, *_args: Any, **options: Any) -> None:
        path: Path = options["file"]
        try:
            done = self._merge(path) if options["merge"] else self._export(path)
        except (OSError, ValueError) as error:
            raise CommandError(f"{path}: {error}") from error
        self.stdout.write(done)

    @staticmethod
    def _merge(path: Path) -> str:
        with path.open(encoding="utf-8") as lines:
            return f"{interventions.merge(lines)} entries added."

    @staticmethod
    def _export(path: Path) -> str:
        count = 0
        with path.open("x", encoding="utf-8") as file:
            path.chmod(0o600)
            for line in interventions.exported():
                file.write(f"{line}\n")
                count += 1
        return f"{count} entries written."
