"""manage.py demo: everything on one machine, and a link that drives a robot."""

import os
import sys
from argparse import ArgumentParser

from django.core.management.base import BaseCommand, CommandError

from telepresence_site.environment import flag


class Command(BaseCommand):
    help = "Run the whole system on this machine with two simulated robots."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument(
            "--port", default=os.environ.get("PORT") or "8000", help="port of the web page (8000)"
        )
        parser.add_argument(
            "--lan",
            action="store_true",
            default=flag("LAN"),
            help="let other devices connect, with a self-signed certificate",
        )
        parser.add_argument(
            "--reset",
            action="store_true",
            default=flag("RESET"),
            help="delete the data of earlier runs; passwords and imported sites stay",
        )

    def handle(self, *_args: object, **options: object) -> None:
        # Before anything reads the settings of the demo: plain http unless the page leaves this
        # machine.
        if not str(options["port"]).isdigit() or not 0 < int(str(options["port"])) < 2**16:
            raise CommandError(f"PORT must be a number from 1 to 65535, not “{options['port']}”.")
        from telepresence_site.demo.run import Options, run  # noqa: PLC0415 -- as said

        sys.exit(
            run(
                Options(
                    port=int(str(options["port"])),
                    lan=bool(options["lan"]),
                    reset=bool(options["reset"]),
                )
            )
        )
