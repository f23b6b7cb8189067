"""`manage.py import_floorplan DIR`: imports a site into the database and for simulators."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from robots.models import FloorPlan
from robots.plans.floorplans import FloorPlanRefusedError, import_site, read_folder


class Command(BaseCommand):
    help = (
        "Check a site in a folder with map.yaml, its image and plan.json, "
        "and import it into the database and for simulators."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("directory", type=Path, help="the folder")
        check = "only check the folder and report problems"
        parser.add_argument("--check", action="store_true", help=check)

    def handle(self, *_args: Any, **options: Any) -> None:
        directory: Path = options["directory"]
        try:
            if options["check"]:
                values = read_folder(directory)
                self.stdout.write(f"The site {values['name']} ({values['title']}) can be used.")
            else:
                self._import(directory)
        except FloorPlanRefusedError as error:
            problems = "".join(f"\n  {problem}" for problem in error.problems)
            message = f"The site in {directory} cannot be used:{problems}"
            raise CommandError(message) from error
        except OSError as error:
            raise CommandError(f"{error.filename}: {error.strerror}.") from error

    def _import(self, directory: Path) -> None:
        known = set(FloorPlan.objects.values_list("name", flat=True))
        plan, kept = import_site(directory)
        done = "Replaced" if plan.name in known else "Imported"
        self.stdout.write(f"{done} the site {plan.name} ({plan.title}).")
        self.stdout.write(
            "Assign it to a robot in the administration. To simulate a robot in "
            f"it: `run_robot NAME --option plan={kept}`."
        )
