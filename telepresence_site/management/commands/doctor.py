"""`manage.py doctor`: what the site lacks to serve visitors, and a file for a request for help."""

import sys
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError

from robots.api.private_files import write_private
from telepresence_site.ops.doctor.report import as_line, support_report
from telepresence_site.ops.doctor.services import examine_site


class Command(BaseCommand):
    help = "Check database, storage, broker, mail, HTTPS, TURN servers and clock."
    requires_system_checks: list[str] = []  # their findings are among its own

    def add_arguments(self, parser: ArgumentParser) -> None:
        report = "also write versions, checks, names of settings and logs, without secrets"
        parser.add_argument("--report", metavar="FILE", type=Path, help=report)
        log = "with --report: a log file whose newest lines are added; may be repeated"
        parser.add_argument(
            "--log", metavar="FILE", type=Path, action="append", default=[], help=log
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        found = examine_site()
        for finding in found:
            self.stdout.write(as_line(finding))
        if options["report"]:
            self._write(options["report"], support_report(found, options["log"]))
        if any(finding.state == "error" for finding in found):
            sys.exit(1)

    def _write(self, path: Path, text: str) -> None:
        try:
            write_private(path, text)
        except OSError as error:
            raise CommandError(f"{path} cannot be written: {error.strerror}") from error
        self.stdout.write(f"The report is in {path}. Read it before you send it.")
