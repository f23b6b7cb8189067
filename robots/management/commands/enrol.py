"""`manage.py enrol NAME`: a one-time token with which a robot's computer fetches credentials."""

from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from accounts import audit
from robots.enrol.tokens import HOURS, make_token
from robots.models import Robot


class Command(BaseCommand):
    help = "Print the command that connects a robot's computer; its token works once."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("robot", help="the robot's name")
        server = "the address at which the robot reaches the site"
        parser.add_argument("--server", metavar="URL", required=True, help=server)
        hours = "how many hours the token is valid (default: %(default)s)"
        parser.add_argument("--hours", type=float, default=HOURS, help=hours)

    def handle(self, *_args: Any, **options: Any) -> None:
        robot = Robot.objects.filter(name=options["robot"]).first()
        if robot is None:
            raise CommandError(f"There is no robot called {options['robot']}.")
        if not options["hours"] > 0.0:
            raise CommandError("--hours must be positive.")
        token = make_token(robot, timezone.now(), options["hours"])
        audit.note("enrolment_made", robot=robot)
        self.stdout.write(
            "Run this on the robot's computer, with the ADAPTER of its control "
            "architecture and its PROFILE (docs/howto/connect-a-robot.md):"
        )
        server, adapter = options["server"].rstrip("/"), robot.adapter or "ADAPTER"
        where = f"--server {server} --adapter {adapter} --profile PROFILE"
        self.stdout.write(f"telepresence run_robot {robot.name} {where} --enrol {token}")
