"""manage.py run_practice: simulated robots for visitors who wait."""

import signal
import threading
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError

from robots.processes import END_SIGNALS
from telepresence_site.practice.robots import prepare
from telepresence_site.practice.supervisor import READY, Supervisor


class Command(BaseCommand):
    """Run up to PRACTICE_ROBOTS simulated robots, each only when somebody may want it, until
    Ctrl-C.
    """

    help = (
        "Run simulated robots on which visitors practise while they wait for "
        "a real one (PRACTICE_ROBOTS sets how many at once)."
    )
    # of the settings; to check every page takes a second
    requires_system_checks: list[str] = ["telepresence", "security"]

    def handle(self, *_args: Any, **_options: Any) -> None:
        if settings.PRACTICE_ROBOTS < 1:
            raise CommandError(
                "PRACTICE_ROBOTS is 0: set it to how many visitors may practise at once."
            )
        stopping = threading.Event()
        for number in END_SIGNALS:
            signal.signal(number, lambda *_: stopping.set())
        names = prepare(settings.PRACTICE_ROBOTS, settings.MQTT_URL)
        self.stdout.write(READY)
        self.stdout.flush()
        Supervisor(names, settings.VAR_DIR / "log").run(stopping)
