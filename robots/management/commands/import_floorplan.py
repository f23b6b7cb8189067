"""`manage.py import_floorplan DIR`: a site that was made elsewhere, into the database and to where
simulators find it.
"""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from robots.floorplans import FloorPlanRefusedError, import_site, read_folder
from robots.models import FloorPlan


class Command(BaseCommand):
    """Check a folder with map.yaml, its image and plan.json, and take it in place of an earlier one
    with the same map id.
    """

    help = (
        "Check a site in a folder with map.yaml, its image and plan.json, "
        "and import it into the database and for simulators."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("directory", type=Path, help="the folder")
        parser.add_argument(
            "--check", action="store_true", help="only check the folder and report problems"
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        directory: Path = options["directory"]
        try:
            if options["check"]:
                self._check(directory)
            else:
                self._take(directory)
        except FloorPlanRefusedError as error:
            lines = (
                f"The site in {directory} cannot be used:",
                *(f"  {p}" for p in error.problems),
            )
            raise CommandError("\n".join(lines)) from error
        except OSError as error:
            raise CommandError(f"{error.filename}: {error.strerror}.") from error

    def _check(self, directory: Path) -> None:
        values = read_folder(directory)
        self.stdout.write(f"The site {values['name']} ({values['title']}) can be used.")

    def _take(self, directory: Path) -> None:
        known = set(FloorPlan.objects.values_list("name", flat=True))
        plan, kept = import_site(directory)
        self.stdout.write(
            f"{'Replaced' if plan.name in known else 'Imported'} the site {plan.name}"
            f" ({plan.title})."
        )
        self.stdout.write(
            "Assign it to a robot in the administration. To simulate a robot in "
            f"it: `run_robot NAME --option plan={kept}`."
        )
