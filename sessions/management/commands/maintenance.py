"""`manage.py maintenance`: announce the site's maintenance, wait until no drive is left, end it."""

import datetime
import time
from argparse import ArgumentParser
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from accounts import audit
from sessions.models import HOLDING_STATES, Maintenance, Session

# How long a session manager takes at most to end the drives whose time is over.
ENDING_SECONDS = 30.0


class Command(BaseCommand):
    """Session managers read the announcement at their next tick, half a second later."""

    help = (
        "Announce maintenance: no drive begins, drivers are warned, and their drives end when it "
        "begins. Visitors who wait keep their places."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("what", choices=["begin", "end", "status"])
        parser.add_argument(
            "--in",
            dest="seconds",
            type=float,
            default=120.0,
            metavar="SECONDS",
            help="with begin: how long drivers may go on (default: 120)",
        )
        parser.add_argument(
            "--wait", action="store_true", help="with begin: return when no drive is left"
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        if options["what"] == "begin":
            self._begin(options["seconds"], wait=options["wait"])
        elif options["what"] == "end":
            is_announced = bool(Maintenance.objects.all().delete()[0])
            if is_announced:
                audit.note("maintenance_ended")
            self.stdout.write(
                "Visitors can drive again." if is_announced else "None was announced."
            )
        else:
            self.stdout.write(_status())

    def _begin(self, seconds: float, *, wait: bool) -> None:
        if seconds < 0:
            raise CommandError("--in is a number of seconds from now, 0 or more.")
        starts_at = timezone.now() + datetime.timedelta(seconds=seconds)
        Maintenance.objects.update_or_create(defaults={"starts_at": starts_at})
        audit.note("maintenance_announced", detail=starts_at.isoformat(timespec="seconds"))
        self.stdout.write(_status())
        if wait:
            self._wait(time.monotonic() + seconds + ENDING_SECONDS)

    def _wait(self, until: float) -> None:
        while left := _drives():
            if time.monotonic() > until:
                raise CommandError(f"{left} drives have not ended. Is a session manager running?")
            time.sleep(0.5)
        self.stdout.write("No drive is left.")


def _drives() -> int:
    return Session.objects.filter(state__in=HOLDING_STATES).count()


def _status() -> str:
    row = Maintenance.objects.first()
    if row is None:
        return f"No maintenance is announced. Drives: {_drives()}."
    verb = "begins" if row.starts_at > timezone.now() else "began"
    local = timezone.localtime(row.starts_at)
    return f"Maintenance {verb} at {local:%H:%M:%S}. Drives: {_drives()}."
