"""`manage.py rotate_credentials NAME …`: agents fetch new credentials while they run."""

from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from accounts import audit
from robots.enrol.credentials import ask_for_renewal
from robots.models import Robot


class Command(BaseCommand):
    help = (
        "Make the agents of robots fetch new credentials by themselves; the current ones stay "
        "valid for one more day."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        names = "robot names; without any, all robots with credentials"
        parser.add_argument("robots", nargs="*", metavar="robot", help=names)

    def handle(self, *_args: Any, **options: Any) -> None:
        rows = Robot.objects.exclude(credentials__credential_hash="").select_related("credentials")
        chosen = list(rows.filter(name__in=options["robots"]) if options["robots"] else rows)
        missing = set(options["robots"]) - {robot.name for robot in chosen}
        if missing:
            raise CommandError(
                f"No such robot, or it has no credentials: {', '.join(sorted(missing))}."
            )
        for robot in chosen:
            ask_for_renewal(robot, timezone.now())
            audit.note("rotation_asked", robot=robot)
            self.stdout.write(robot.name)
