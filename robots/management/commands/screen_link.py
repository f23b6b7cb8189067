"""`manage.py screen_link NAME`: a new address for the robot's own display."""

from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from accounts import audit
from robots.models import Robot
from robots.screens import make_screen_key, screen_address


class Command(BaseCommand):
    help = "Print a new address for the display on a robot; the previous one stops working."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("robot", help="the robot's name")
        server = "the address at which the display reaches the site"
        parser.add_argument("--server", metavar="URL", required=True, help=server)

    def handle(self, *_args: Any, **options: Any) -> None:
        robot = Robot.objects.filter(name=options["robot"]).first()
        if robot is None:
            raise CommandError(f"There is no robot called {options['robot']}.")
        key = make_screen_key(robot, timezone.now())
        audit.note("screen_key_made", robot=robot)
        self.stdout.write(screen_address(robot, key, options["server"].rstrip("/")))
