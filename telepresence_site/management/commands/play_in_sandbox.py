"""`manage.py play_in_sandbox`: the process that run_bots and rehearse_study start in a sandbox."""

from typing import Any

from django.core.management.base import BaseCommand, CommandError

from robots.process.ending import interrupted_by_signals
from telepresence_site.demo.supervision import PartLostError
from telepresence_site.rehearsal.play import PlayFailed, carry_out


class Command(BaseCommand):
    help = "Started by run_bots --speed and rehearse_study in a sandbox; do not run it by hand."
    requires_system_checks: list[str] = []

    def handle(self, *_args: Any, **_options: Any) -> None:
        try:
            with interrupted_by_signals():
                carry_out(lambda line: print(line, flush=True))
        except (PlayFailed, PartLostError) as error:
            raise CommandError(str(error)) from error
        except KeyboardInterrupt:
            raise CommandError("Stopped before the bots finished.") from None
