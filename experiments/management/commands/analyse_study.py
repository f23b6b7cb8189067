"""`manage.py analyse_study`: every table and figure of a study, from the database or from an
exported dataset alone.
"""

from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from django.core.management import BaseCommand, CommandError

from experiments.analysis.page import write_page
from experiments.analysis.report import analyse
from experiments.dataset.folder import DatasetError, read
from experiments.dataset.levels import Kind
from experiments.dataset.records import Dataset
from experiments.export.reports import ProgressLines
from experiments.extraction.build import dataset_of
from experiments.management.study_lookup import study_named

KINDS = ("participant", "pilot", "bot")


class Command(BaseCommand):
    """Writes the report on a study: the same bytes from the database and from its export."""

    help = "Write every table and figure of a study, with the sessions behind each number."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument(
            "study",
            nargs="?",
            default="",
            help="name of the study, or name:version; leave out with --dataset",
        )
        parser.add_argument(
            "--dataset", type=Path, help="folder written by export_study, instead of the database"
        )
        parser.add_argument(
            "--out", type=Path, required=True, help="output folder, which is created"
        )
        parser.add_argument(
            "--page",
            action="store_true",
            help="also write the files that the analysis page shows, but no PNG files",
        )
        parser.add_argument(
            "--progress",
            action="store_true",
            help="print a line of JSON each second: sessions measured, sessions, files written",
        )
        parser.add_argument(
            "--kind",
            choices=KINDS,
            action="append",
            help="whose sessions to include; may be repeated [participant]",
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        if bool(options["study"]) == bool(options["dataset"]):
            raise CommandError("Give either the name of a study or --dataset.")
        kinds: Sequence[Kind] = options["kind"] or ("participant",)
        progress = ProgressLines(options["out"])
        if options["progress"]:
            progress.start()
        try:
            dataset = progress.follow(self._dataset(options))
            if options["dataset"]:
                _check_kinds(dataset, kinds)
            files = analyse(dataset, options["out"], kinds, write_page if options["page"] else None)
        except DatasetError as error:
            raise CommandError(str(error)) from error
        finally:
            progress.stop()
        self.stdout.write(f"{options['out']}: {len(files)} files")

    def _dataset(self, options: dict[str, Any]) -> Dataset:
        return (
            read(options["dataset"])
            if options["dataset"]
            else dataset_of(study_named(options["study"]))
        )


def _check_kinds(dataset: Dataset, kinds: Sequence[Kind]) -> None:
    """Refuse a report on nobody where there is somebody of another kind."""
    there = sorted({one.kind for one in dataset.participants})
    if there and not set(there) & set(kinds):
        raise CommandError(
            f"The dataset has nobody of the kind {', '.join(kinds)}. Choose"
            f" {' or '.join(f'--kind {kind}' for kind in there)}."
        )
