"""Keeps the demo's processes running: one that ends is reported and started again, and only one
that nothing works without ends the demo.
"""

import contextlib
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import NamedTuple

from telepresence_site.children import Child, Children

POLL_INTERVAL_S = 0.1  # while a part starts


class PartLostError(Exception):
    """An essential part ended too often, or was not ready in time; the message is one sentence."""


class NotReadyError(PartLostError):
    """A part was not ready in time."""


class DemoPart(NamedTuple):
    """A Python child to start: how to tell that it is ready, whether nothing works without it, and
    whether it writes notices.
    """

    name: str
    arguments: list[str]
    ready: Callable[[Child], bool]
    is_essential: bool = False
    has_notices: bool = False


@dataclass(frozen=True)
class RestartPolicy:
    """The delays before an ended process is restarted, in seconds.

    A process that lived shorter than `settled` died quickly; each quick death in a row doubles the
    delay before the next start. After `quick_deaths` in a row an essential process is given up; any
    other is tried for ever.
    """

    first_delay: float = 1.0
    longest_delay: float = 30.0
    settled: float = 20.0
    quick_deaths: int = 5

    def deaths_in_a_row(self, before: int, lived: float) -> int:
        """Return the number of quick deaths in a row, this one included; `lived` is the time since
        the last start.
        """
        return 1 if lived >= self.settled else before + 1

    def delay(self, deaths: int, *, is_essential: bool) -> float | None:
        """Return the delay after so many quick deaths in a row; None when it is to be given up."""
        if is_essential and deaths >= self.quick_deaths:
            return None
        return min(self.longest_delay, self.first_delay * 2.0 ** min(deaths - 1, 30))


@dataclass
class _Service:
    """A part and its present process; times by the supervisor's clock."""

    part: DemoPart
    child: Child
    started_at: float
    died_at: float | None = None  # of the first death that is not yet reported to be over
    restart_at: float | None = None  # None while it runs
    deaths: int = 0


class ServiceSupervisor:
    """Starts and restarts parts, and reports in one sentence what became of each that ended.

    Args:
        children: starts their processes.
        tell: prints a sentence.
        policy: when one that ended is started again.
        clock: seconds.
    """

    def __init__(
        self,
        children: Children,
        tell: Callable[[str], None],
        policy: RestartPolicy | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._children, self._tell, self._clock = children, tell, clock
        self._policy = policy or RestartPolicy()
        self._services: list[_Service] = []

    def start(
        self,
        parts: Sequence[DemoPart],
        *,
        within: float,
        step: Callable[[str], AbstractContextManager[object]] = contextlib.nullcontext,
    ) -> None:
        """Start parts side by side, because they wait for each other; then wait for each in turn.

        One that is not essential and needs longer than `within` seconds is reported, and no longer
        waited for. `step` is entered with a part's name while it is waited for.

        Raises:
            PartLostError: an essential one ended too often, or was not ready in time.
        """
        self._services += [
            _Service(part, self._children.start(part.name, part.arguments), self._clock())
            for part in parts
        ]
        for service in self._services:
            try:
                with step(service.part.name):
                    self._wait(service, self._clock() + within)
            except NotReadyError as error:
                if service.part.is_essential:
                    raise
                self._tell(f"{error} Continuing without it until it is ready.")
                service.died_at = service.died_at or service.started_at

    def _wait(self, service: _Service, deadline: float) -> None:
        while service.restart_at is not None or not service.part.ready(service.child):
            if self._clock() > deadline:
                raise NotReadyError(
                    f"The {service.part.name} is not ready yet: {service.child.last_line()} (its"
                    f" log: {service.child.log})."
                )
            time.sleep(POLL_INTERVAL_S)
            self.look()

    def look(self) -> bool:
        """Restart ended parts that are due; report ended and restarted parts, and parts' notices.
        Return whether anything is back.

        Raises:
            PartLostError: an essential part ended too often.
        """
        now, some_are_back = self._clock(), False
        for service in self._services:
            if service.part.has_notices:
                for sentence in service.child.notices():
                    self._tell(sentence)
            if service.restart_at is None and service.child.process.poll() is not None:
                self._on_death(service, now)
            if service.restart_at is not None and now >= service.restart_at:
                self._restart(service, now)
            runs = service.restart_at is None
            if runs and service.died_at is not None and service.part.ready(service.child):
                self._tell(
                    f"The {service.part.name} is {'back' if service.deaths else 'ready'} after"
                    f" {now - service.died_at:.1f} s."
                )
                service.died_at, some_are_back = None, True
        return some_are_back

    def _restart(self, service: _Service, now: float) -> None:
        name = service.part.name
        service.started_at, service.restart_at = now, None
        try:
            service.child = self._children.start(name, service.part.arguments)
        except OSError as error:  # no memory, or no room for its log
            reason = error.strerror or error
            self._plan_restart(service, now, f"The {name} could not be started: {reason}.")

    def _on_death(self, service: _Service, now: float) -> None:
        reason = service.child.why_ended()
        self._children.end(service.child)
        ended = f"The {service.part.name} ended: {reason} (its log: {service.child.log})."
        self._plan_restart(service, now, ended)

    def _plan_restart(self, service: _Service, now: float, what: str) -> None:
        lived = now - service.started_at
        service.deaths = self._policy.deaths_in_a_row(service.deaths, lived)
        service.died_at = service.died_at or now
        delay = self._policy.delay(service.deaths, is_essential=service.part.is_essential)
        if delay is None:
            often = f" {service.deaths} times in a row" if service.deaths > 1 else ""
            raise PartLostError(f"{what} It ended{often}, and nothing works without it.")
        service.restart_at = now + delay
        self._tell(f"{what} Starting it again in {delay:g} s.")
