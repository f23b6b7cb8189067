"""Runs the rehearsals that pages request, one at a time, each in a child process: part of
`run_practice`, which runs simulated robots anyway. A runner on another computer takes others.
"""

import socket
import time
from collections.abc import Callable

import structlog
from django.conf import settings
from django.utils import timezone

from experiments.models import Rehearsal
from experiments.rehearsal import runs
from telepresence_site.children import Child, Children

log = structlog.stdlib.get_logger(__name__)
MANAGE = str(settings.BASE_DIR / "manage.py")
END_SECONDS = 40.0  # in which the process of a rehearsal that was ended must end


def rehearsal_command(row: Rehearsal) -> list[str]:
    study = f"{row.study.slug}:{row.study.version}"
    return [MANAGE, "rehearse_study", study, "--requested", str(row.pk)]


class RehearsalRunner:
    """Runs at most one rehearsal.

    Args:
        children: starts its process.
        command: returns the arguments of the process.
    """

    def __init__(
        self, children: Children, command: Callable[[Rehearsal], list[str]] = rehearsal_command
    ) -> None:
        self._children = children
        self._command = command
        self._host = socket.gethostname()[:100]
        self._row: Rehearsal | None = None
        self._child: Child | None = None
        self._ended_at: float | None = None  # monotonic seconds; when its row was found ended

    def look(self) -> None:
        if self._row is None:
            self._row = runs.take_next(self._host, timezone.now())
        if self._row is None:
            return
        if self._child is None:
            self._start(self._row)
        elif self._child.process.poll() is not None or self._is_overdue(self._row):
            self._end(self._row, self._child)

    def _start(self, row: Rehearsal) -> None:
        log.info("rehearsal_started", rehearsal=str(row.pk), study=str(row.study))
        try:
            self._child = self._children.start("rehearsal", self._command(row))
        except OSError as error:  # no memory, or no room for its log
            runs.fail(row.pk, f"It could not be started: {error.strerror or error}.")
            self._row = None
        self._ended_at = None

    def _is_overdue(self, row: Rehearsal) -> bool:
        """Tell whether the rehearsal was ended END_SECONDS ago, and its process still runs."""
        if Rehearsal.objects.filter(pk=row.pk, status=runs.Status.RUNNING).exists():
            return False
        self._ended_at = self._ended_at or time.monotonic()
        return time.monotonic() - self._ended_at > END_SECONDS

    def _end(self, row: Rehearsal, child: Child) -> None:
        if runs.fail(row.pk, f"Its process ended: {child.why_ended()}."):
            log.warning("rehearsal_died", rehearsal=str(row.pk), log=str(child.log))
        self._children.end(child)
        self._row = self._child = None
