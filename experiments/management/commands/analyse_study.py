"""`manage.py analyse_study`: tables and figures of a study, from database or dataset."""

from argparse import SUPPRESS, ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from django.core.management import BaseCommand, CommandError

from accounts import audit
from experiments.analysis.page import write_page
from experiments.analysis.report import analyse
from experiments.dataset.folder import DatasetError, read
from experiments.dataset.levels import KINDS, Kind
from experiments.dataset.records import Dataset
from experiments.export.reports import ProgressLines
from experiments.extraction.build import dataset_of
from experiments.management.study_lookup import study_named


class Command(BaseCommand):
    help = "Write every table and figure of a study, with the sessions behind each number."

    def add_arguments(self, parser: ArgumentParser) -> None:
        add, named = parser.add_argument, "name of the study, or name:version"
        add("study", nargs="?", default="", help=f"{named}; leave out with --dataset")
        add("--dataset", type=Path, help="folder written by export_study, instead of the database")
        add("--out", type=Path, required=True, help="output folder, which is created")
        text = "also write the files that the analysis page shows, but no PNG files"
        add("--page", action="store_true", help=text)
        text = "print a line of JSON each second: sessions measured, sessions, files written"
        add("--progress", action="store_true", help=text)
        text = "whose sessions to include; may be repeated [participant]"
        add("--kind", choices=KINDS, action="append", help=text)
        # for the analysis page, which audits what it gives out
        add("--noted", action="store_true", help=SUPPRESS)

    def handle(self, *_args: Any, **options: Any) -> None:
        folder: Path | None = options["dataset"]
        if bool(options["study"]) == bool(folder):
            raise CommandError("Give either the name of a study or --dataset.")
        kinds: Sequence[Kind] = options["kind"] or ("participant",)
        progress = ProgressLines(options["out"])
        if options["progress"]:
            progress.start()
        try:
            dataset = read(folder) if folder else _dataset(options)
            if folder:
                _check_kinds(dataset, kinds)
            page = write_page if options["page"] else None
            files = analyse(progress.follow(dataset), options["out"], kinds, page)
        except DatasetError as error:
            raise CommandError(str(error)) from error
        finally:
            progress.stop()
        self.stdout.write(f"{options['out']}: {len(files)} files")


def _dataset(options: dict[str, Any]) -> Dataset:
    study = study_named(options["study"])
    if not options["noted"]:
        thing, out = f"version {study.version}", options["out"].name
        audit.note("analysis_exported", study=study.slug, thing=thing, detail=out)
    return dataset_of(study)


def _check_kinds(dataset: Dataset, kinds: Sequence[Kind]) -> None:
    """Refuse a report without participants where there are some of another kind."""
    there = sorted({one.kind for one in dataset.participants})
    if there and not set(there) & set(kinds):
        choice = " or ".join(f"--kind {kind}" for kind in there)
        text = f"The dataset has nobody of the kind {', '.join(kinds)}. Choose {choice}."
        raise CommandError(text)
