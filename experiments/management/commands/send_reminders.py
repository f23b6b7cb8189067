"""`manage.py send_reminders`: the e-mails to participants that are due."""

import threading
from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.db import close_old_connections
from django.utils import timezone

from experiments.recruitment.reminders import send_due

LEAST_SECONDS = 10.0


class Command(BaseCommand):
    help = (
        "Send participants the reminders of their appointments and invitations to second sessions "
        "that are due, and delete e-mail addresses that are no longer needed. Run it every few "
        "minutes."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        text = "keep running and send this often"
        parser.add_argument("--every", type=float, metavar="SECONDS", help=text)

    def handle(self, *_args: Any, **options: Any) -> None:
        every = options["every"]
        if every is not None and every < LEAST_SECONDS:
            raise CommandError(f"Send at most every {LEAST_SECONDS:g} seconds.")
        self.stdout.write(f"{send_due(timezone.now())} e-mails sent.")
        pause = threading.Event()
        while every is not None:
            pause.wait(every)
            close_old_connections()
            if sent := send_due(timezone.now()):
                self.stdout.write(f"{sent} e-mails sent.")
