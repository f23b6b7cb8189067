"""`manage.py export_study`: everything recorded in a study, as a folder or a ZIP archive."""

import sys
from argparse import SUPPRESS, ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management import BaseCommand, CommandError

from accounts import audit
from experiments.definition.publication import from_stored
from experiments.export.anonymity import sharing_warnings
from experiments.export.archive import unpacked, zipped
from experiments.export.files import export_files
from experiments.export.formats import ON_REQUEST
from experiments.extraction.selection import Selection
from experiments.management.study_lookup import study_named
from experiments.models import Study


class Command(BaseCommand):
    help = "Export everything recorded in a study as a Psych-DS folder, or as a ZIP archive of it."

    def add_arguments(self, parser: ArgumentParser) -> None:
        add, flag = parser.add_argument, "store_true"
        add("study", help="name of the study, or name:version: exploration, exploration:2")
        text = "folder, which must be empty or not exist yet; with --zip the file,"
        add("--out", type=Path, required=True, help=f"{text} - for standard output")
        add("--zip", action=flag, help="write one ZIP archive")
        add("--identified", action=flag, help="with names, addresses, free text and photos")
        add("--free-text", action=flag, help="with the free text that people wrote")
        text = "for everybody: of those who agreed, ages as ranges, no devices and networks"
        add("--public", action=flag, help=text)
        for name, one in ON_REQUEST.items():
            add(f"--{name.replace('_', '-')}", action=flag, help=one.help)
        # the analysis page has audited the export already
        add("--noted", action=flag, help=SUPPRESS)

    def handle(self, *_args: Any, **options: Any) -> None:
        out: Path = options["out"]
        kinds = {name: options[name] for name in ("public", "identified", "free_text")}
        formats = frozenset(name for name in ON_REQUEST if options[name])
        try:
            choice = Selection(**kinds, formats=formats)
        except ValueError as error:
            raise CommandError(f"{error}.") from error
        study = study_named(options["study"])
        to_stdout = options["zip"] and str(out) == "-"
        taken = out.exists() and (options["zip"] or not out.is_dir() or any(out.iterdir()))
        if taken and not to_stdout:
            raise CommandError(f"{out} already exists: choose another --out.")
        if not options["noted"]:
            _note(study, options)
            if missing := from_stored(study.publication).missing:
                self.stderr.write(f"Publication details not filled in: {', '.join(missing)}.")
            for warning in sharing_warnings(study) if choice.public else ():
                self.stderr.write(warning)
        files = export_files(study, choice)
        if to_stdout:
            sys.stdout.buffer.writelines(zipped(files))
        elif options["zip"]:
            out.parent.mkdir(parents=True, exist_ok=True)
            with out.open("wb") as archive:
                archive.writelines(zipped(files))
            self.stdout.write(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
        else:
            count = sum(1 for _ in unpacked(files, out))
            self.stdout.write(f"{out}: {count} files")


def _note(study: Study, options: dict[str, Any]) -> None:
    """Audit the export, as the analysis page does: participants who withdraw learn of it."""
    names = [name for name in (*ON_REQUEST, "free_text", "identified", "public") if options[name]]
    version = f"version {study.version}"
    audit.note("study_exported", study=study.slug, thing=version, detail=" ".join(names))
