"""manage.py run_practice: simulated robots, for visitors who wait and for rehearsals."""

import signal
import threading
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand

from robots.process.ending import END_SIGNALS
from telepresence_site.children import NOTICE_PREFIX
from telepresence_site.practice.robots import prepare
from telepresence_site.practice.supervisor import READY, Supervisor
from telepresence_site.rehearsal.runner import RehearsalRunner


class Command(BaseCommand):
    help = (
        "Run simulated robots on which visitors practise while they wait for "
        "a real one (PRACTICE_ROBOTS sets how many at once), and the rehearsals "
        "of studies that researchers start from a page."
    )
    # only those of settings; to check every page takes a second
    requires_system_checks: list[str] = ["telepresence", "security"]

    def handle(self, *_args: Any, **_options: Any) -> None:
        stopping = threading.Event()
        for number in END_SIGNALS:
            signal.signal(number, lambda *_: stopping.set())
        names = prepare(settings.PRACTICE_ROBOTS, settings.MQTT_URL)
        self.stdout.write(READY)
        self.stdout.flush()
        supervisor = Supervisor(names, settings.VAR_DIR / "log", tell=self._tell)
        supervisor.run(stopping, RehearsalRunner(supervisor.children).look)

    def _tell(self, sentence: str) -> None:
        self.stdout.write(f"{NOTICE_PREFIX}{sentence}")
        self.stdout.flush()
