"""manage.py demo: everything on one machine, and a link that drives a robot."""

import sys
from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from telepresence_site.demo.run import Options, run
from telepresence_site.environment import flag, text


class Command(BaseCommand):
    help = "Run the whole system on this machine with two simulated robots."

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        port = text("PORT", "8000")
        add("--port", default=port, help="port of the web page (8000)")
        lan = "let other devices connect, with a self-signed certificate"
        add("--lan", action="store_true", default=flag("LAN"), help=lan)
        reset = "delete the data of earlier runs; passwords and imported sites stay"
        add("--reset", action="store_true", default=flag("RESET"), help=reset)

    def handle(self, *_args: Any, **options: Any) -> None:
        port = str(options["port"])
        if not port.isdigit() or not 0 < int(port) < 2**16:
            raise CommandError(f"PORT must be a number from 1 to 65535, not “{port}”.")
        sys.exit(run(Options(int(port), lan=options["lan"], reset=options["reset"])))
