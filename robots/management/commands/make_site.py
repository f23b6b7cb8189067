"""`manage.py make_site MAP.yaml --name ID`: a site from a robot's map, to be finished on a page."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.urls import reverse

from robots.api import floorplan
from robots.models import FloorPlan
from robots.plans.drafts import propose, read_map, store_site
from robots.plans.floorplans import FloorPlanRefusedError


class Command(BaseCommand):
    help = (
        "Make a site from a ROS map: trace its walls and propose rooms, openings and charging"
        " stations. Finish it in the administration."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("map", type=Path, help="the YAML file of the map")
        name = "map id: lower-case letters, digits, hyphens, underscores"
        add("--name", required=True, help=name)
        add("--title", default="", help="title; without it, the map id")
        occupied = (
            "occupancy (0 to 1) at or above which a cell is a wall, instead of the file's; 0.35 for"
            " maps with grey walls"
        )
        add("--occupied-thresh", type=float, help=occupied)
        free = "occupancy (0 to 1) below which a cell is free, instead of the file's"
        add("--free-thresh", type=float, help=free)
        add("--replace", action="store_true", help="replace the plan that has this map id")

    def handle(self, *_args: Any, **options: Any) -> None:
        name, path = options["name"], options["map"]
        if FloorPlan.objects.filter(name=name).exists() and not options["replace"]:
            raise CommandError(
                f"There is a floor plan {name} already. Choose another name, or add --replace to"
                " replace it and everything that was finished by hand."
            )
        try:
            grid = read_map(path, occupied=options["occupied_thresh"], free=options["free_thresh"])
            plan = propose(grid, name, options["title"] or name)
            row, kept = store_site(plan, grid)
        except FloorPlanRefusedError as error:
            problems = "".join(f"\n  {problem}" for problem in error.problems)
            raise CommandError(f"No site can be made from {path}:{problems}") from error
        except OSError as error:
            raise CommandError(f"{error.filename}: {error.strerror}.") from error
        self._report(plan, row, kept)

    def _report(self, plan: floorplan.FloorPlan, row: FloorPlan, kept: Path) -> None:
        self.stdout.write(
            f"Made the site {row.name}: {len(plan.rooms)} rooms, {len(plan.walls)} walls,"
            f" {len(plan.passages)} openings, {len(plan.furniture)} obstacles,"
            f" {len(plan.docks)} charging stations."
        )
        page = reverse("admin:robots_floorplan_finish", args=[row.pk])
        self.stdout.write(f"Finish it in the administration: {page}")
        self.stdout.write(f"To simulate a robot in it: `run_robot NAME --option plan={kept}`.")
