"""`manage.py safety_file OUTPUT`: a file about this installation for people who assess it."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone, translation

from telepresence_site.ops.safety_file import document, test_results
from telepresence_site.ops.safety_file.content import rendered


class Command(BaseCommand):
    help = (
        "Write one HTML file for people who assess this installation: hazards, safety functions, "
        "tests and whether they ran, measured stopping times, versions and interventions. It is "
        "not a declaration of conformity."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("output", type=Path, help="a new file, such as safety-2026-11-28.html")
        results = "what pytest --junitxml wrote; may be repeated"
        parser.add_argument(
            "--results", type=Path, action="append", default=[], metavar="FILE", help=results
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        output: Path = options["output"]
        try:
            results = test_results.read(options["results"])
            # the names of tests and the safety document are English, and so is the file
            with translation.override("en"):
                text = rendered(document.read(), results, timezone.now())
            with output.open("x", encoding="utf-8") as file:
                file.write(text)
        except (OSError, ValueError) as error:
            raise CommandError(str(error)) from error
        self.stdout.write(f"{output} is written. Open it in a browser; print it for a PDF.")
