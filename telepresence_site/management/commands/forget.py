"""`manage.py forget`: deletes data older than settings.RETENTION_DAYS. Run it daily."""

from argparse import ArgumentParser
from typing import Any

from django.core.management import call_command
from django.core.management.base import BaseCommand
from django.utils import timezone

from sessions import system_log
from telepresence_site.ops.retention import empty_write_ahead_log, forget_all


class Command(BaseCommand):
    help = "Delete what is older than the RETENTION_ settings allow; run it daily."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("--dry-run", action="store_true", help="only count; delete nothing")

    def handle(self, *_args: Any, **options: Any) -> None:
        dry_run = options["dry_run"]
        for kind, count in forget_all(timezone.now(), dry_run=dry_run):
            self.stdout.write(f"{kind}: {count}{' would be deleted' if dry_run else ' deleted'}")
            if count and not dry_run:
                system_log.log("forgotten", kind=kind, count=count)
        if not dry_run:
            call_command("clearsessions")
            empty_write_ahead_log()
