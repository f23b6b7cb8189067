"""`manage.py run_session_manager`: one is enough for a site; several share its robots."""

import asyncio
import random
import signal
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError

from robots.bridge.broker_address import BadAddress
from robots.enrol.credentials import server_credentials
from robots.process.interpreter import set_up_for_latency
from sessions.manager.active import RecorderDied
from sessions.manager.service import SessionManager


class Command(BaseCommand):
    """Keeps the time of all sessions, and records them."""

    help = (
        "Run the session manager: leases, queue, time limits, presence and the record of every"
        " session."
    )
    # of the settings; to check every page takes a second
    requires_system_checks: list[str] = ["telepresence", "security"]

    def handle(self, *_args: Any, **_options: Any) -> None:
        # taking turns more often gave a third more states a second, and a quicker lease
        set_up_for_latency()
        try:
            asyncio.run(self._run())
        except BadAddress as error:
            raise CommandError(str(error)) from error
        except RecorderDied as error:
            raise CommandError(
                "The recorder ended with an error; see the log above. Start the "
                "session manager again."
            ) from error

    async def _run(self) -> None:
        manager = SessionManager(
            settings.MQTT_URL,
            server_credentials("session-manager"),
            random.Random(),
        )
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, manager.stop)
        await manager.run()
