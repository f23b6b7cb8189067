"""Runs the practice robots: checks the demand every second, and starts and ends robots.

The robots end with this process. A new one finds in the database who practises, and starts their
robots again.
"""

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import structlog
from django.conf import settings
from django.db import DatabaseError, InterfaceError, connection
from django.utils import timezone

from telepresence_site.children import Child, Children
from telepresence_site.practice import robots
from telepresence_site.practice.pool import decide

log = structlog.stdlib.get_logger(__name__)
POLL_INTERVAL_S = 1.0
READY = "practice ready"  # printed by `run_practice` when it has started
MANAGE = str(settings.BASE_DIR / "manage.py")


def robot_command(name: str) -> list[str]:
    return [MANAGE, "run_robot", name, "--profile", robots.PROFILE, "--viewers", "2"]


class Supervisor:
    """Keeps as many robots running as `decide` says.

    Args:
        names: of the practice robots.
        log_dir: for a log file of each.
        command: returns the arguments of a robot's process.
        tell: prints a sentence in the terminal.
    """

    def __init__(
        self,
        names: list[str],
        log_dir: Path,
        command: Callable[[str], list[str]] = robot_command,
        tell: Callable[[str], None] = lambda _sentence: None,
    ) -> None:
        self._names = names
        self._command, self._tell = command, tell
        self.children = Children(log_dir, dict(os.environ))
        self._running: dict[str, Child] = {}
        self._started_at: dict[str, float] = {}  # Unix seconds, of all robots ever started
        self._wanted_at: float | None = None

    def run(self, stopping: threading.Event, also: Callable[[], None] = lambda: None) -> None:
        """Run the robots until `stopping` is set, then end all children; `also` is called every
        second.
        """
        try:
            while not stopping.wait(POLL_INTERVAL_S):
                try:
                    self.look()
                    also()
                except (DatabaseError, InterfaceError) as error:
                    log.warning("practice_database_retry", reason=str(error))
                    connection.close()
        finally:
            self.children.stop()

    def look(self) -> None:
        demand = robots.demand(self._wanted_at, timezone.now())
        self._wanted_at = demand.wanted_at
        self._report_dead()
        stopped, started = decide(self._names, demand, self._started_at, self._running, time.time())
        for name in stopped:
            log.info("practice_robot_stopped", robot=name)
            self._end(name)
        for name in started:
            log.info("practice_robot_started", robot=name)
            self._running[name] = self.children.start(name, self._command(name))
            self._started_at[name] = time.time()

    def _report_dead(self) -> None:
        """Report every robot that ended by itself, and forget its process."""
        for name, child in list(self._running.items()):
            if child.process.poll() is not None:
                reason = child.why_ended()
                log.warning("practice_robot_died", robot=name, reason=reason, log=child.log)
                self._tell(
                    f"The practice robot {name} ended: {reason} (its log: {child.log}). It is"
                    " started again when somebody needs it."
                )
                self._end(name)

    def _end(self, name: str) -> None:
        self.children.end(self._running.pop(name))
