"""`manage.py api_key ROBOT LABEL`: a key for a program that looks after one robot."""

from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.db import IntegrityError, transaction
from django.utils import timezone

from accounts import audit
from robots.models import Robot
from sessions.api.keys import make_key
from sessions.models import ApiKey


class Command(BaseCommand):
    """Shows the key once."""

    help = (
        "Create, list or revoke keys of the JSON API. A key can read one "
        "robot's state, stop it and send it to its station."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("robot", help="the robot's name")
        parser.add_argument("label", nargs="?", help="what the key is for, such as home-assistant")
        parser.add_argument("--revoke", action="store_true", help="revoke the key with this label")
        parser.add_argument("--list", action="store_true", help="list the robot's keys")

    def handle(self, *_args: Any, **options: Any) -> None:
        robot = Robot.objects.filter(name=options["robot"]).first()
        if robot is None:
            raise CommandError(f"There is no robot “{options['robot']}”.")
        if options["list"]:
            for key in robot.api_keys.order_by("label"):
                used = f"{key.last_used_at:%Y-%m-%d %H:%M}" if key.last_used_at else "never"
                self.stdout.write(f"{key.label}  created {key.made_at:%Y-%m-%d %H:%M}  used {used}")
        elif (
            not options["label"]
            or len(options["label"]) > ApiKey._meta.get_field("label").max_length
        ):
            raise CommandError(
                "Give the key a label of at most 60 characters, such as home-assistant."
            )
        elif options["revoke"]:
            if not robot.api_keys.filter(label=options["label"]).delete()[0]:
                raise CommandError(f"{robot} has no key “{options['label']}”.")
            audit.note("api_key_revoked", robot=robot, detail=options["label"])
            self.stdout.write("Revoked.")
        else:
            self._make(robot, options["label"])

    def _make(self, robot: Robot, label: str) -> None:
        try:
            with transaction.atomic():
                key = make_key(robot, label, timezone.now())
        except IntegrityError as error:
            raise CommandError(f"{robot} already has a key “{label}”; revoke it first.") from error
        audit.note("api_key_made", robot=robot, detail=label)
        self.stdout.write(key)
