"""`manage.py export_study`: everything that was recorded of a study, as a folder
or a ZIP archive.
"""

import sys
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management import BaseCommand, CommandError

from experiments.dataset.selection import Selection
from experiments.export.archive import unpacked, zipped
from experiments.export.files import export_files
from experiments.export.formats import ON_REQUEST
from experiments.management.study_lookup import study_named


class Command(BaseCommand):
    """Writes the dataset of one version of a study, pseudonymous unless asked otherwise."""

    help = "Export everything recorded in a study as a Psych-DS folder, or as a ZIP archive of it."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument(
            "study", help="name of the study, or name:version: exploration, exploration:2"
        )
        parser.add_argument(
            "--out",
            type=Path,
            required=True,
            help=(
                "folder, which must be empty or not exist yet; with --zip the file, "
                "- for standard output"
            ),
        )
        parser.add_argument("--zip", action="store_true", help="write one ZIP archive")
        parser.add_argument(
            "--identified", action="store_true", help="with names, addresses, free text and photos"
        )
        parser.add_argument(
            "--free-text", action="store_true", help="with the free text that people wrote"
        )
        for name, one in ON_REQUEST.items():
            parser.add_argument(f"--{name.replace('_', '-')}", action="store_true", help=one.help)

    def handle(self, *_args: Any, **options: Any) -> None:
        out: Path = options["out"]
        choice = Selection(
            identified=options["identified"],
            free_text=options["free_text"],
            formats=frozenset(name for name in ON_REQUEST if options[name]),
        )
        if options["zip"] and str(out) == "-":
            sys.stdout.buffer.writelines(
                zipped(export_files(study_named(options["study"]), choice))
            )
            return
        if out.exists() and (options["zip"] or not out.is_dir() or any(out.iterdir())):
            raise CommandError(f"{out} already exists: choose another --out.")
        files = export_files(study_named(options["study"]), choice)
        if options["zip"]:
            out.parent.mkdir(parents=True, exist_ok=True)
            with out.open("wb") as archive:
                archive.writelines(zipped(files))
            self.stdout.write(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
            return
        count = sum(1 for _ in unpacked(files, out))
        self.stdout.write(f"{out}: {count} files")
