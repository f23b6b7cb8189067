"""Keeps the demo's processes running: one that ends is named and started again, and only one that
nothing works without ends the demo.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from telepresence_site.children import Child, Children, DemoPart, StartFailed
from telepresence_site.demo.restart import (
    GiveUp,
    Restart,
    RestartPolicy,
    after_death,
    deaths_in_a_row,
)

POLL_INTERVAL_S = 0.1  # between two looks at a part that is started


class PartLostError(Exception):
    """An essential part does not live, however often it is started; the message is one sentence."""


@dataclass
class _Service:
    """A part and its present process. All times are of the supervisor's clock; None: that does not
    apply now.
    """

    part: DemoPart
    child: Child
    started_at: float
    died_at: float | None = None  # of the death that is not yet told to be over
    restart_at: float | None = None
    deaths: int = 0

    @property
    def is_back(self) -> bool:
        """Whether it died, runs again, and is ready."""
        return self.died_at is not None and self.restart_at is None and self.part.ready(self.child)


class ServiceSupervisor:
    """Starts parts, looks after them, and says in one sentence what became of each that ended.

    Args:
        children: where their processes are.
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
        step: Callable[[str], AbstractContextManager[None]],
    ) -> None:
        """Start parts that look for each other until they find one another, and wait for each in
        turn.

        One that is not essential and needs longer than `within` seconds is waited for no more, and
        told.

        Raises:
            PartLostError: an essential one does not live.
            StartFailed: an essential one was not ready in time.
        """
        self._services += [
            _Service(part, self._children.start(part.name, part.arguments), self._clock())
            for part in parts
        ]
        for service in self._services:
            try:
                with step(service.part.name):
                    self._wait(service, self._clock() + within)
            except StartFailed as error:
                if service.part.is_essential:
                    raise
                self._tell(f"{error} Continuing without it until it is ready.")
                service.died_at = service.died_at or service.started_at

    def _wait(self, service: _Service, deadline: float) -> None:
        while service.restart_at is not None or not service.part.ready(service.child):
            if self._clock() > deadline:
                raise StartFailed(
                    f"The {service.part.name} is not ready yet: {service.child.last_words()} (its"
                    f" log: {service.child.log})."
                )
            time.sleep(POLL_INTERVAL_S)
            self.look()

    def look(self) -> bool:
        """Start again what ended and is due; say what ended, what is back, and what parts tell of
        their own children. Return whether anything is back.

        Raises:
            PartLostError: an essential part does not live.
        """
        now, some_are_back = self._clock(), False
        for service in self._services:
            if service.part.tells:
                for sentence in service.child.told():
                    self._tell(sentence)
            if service.restart_at is None and service.child.process.poll() is not None:
                self._bury(service, now)
            if service.restart_at is not None and now >= service.restart_at:
                self._restart(service, now)
            if service.is_back and service.died_at is not None:
                self._tell(
                    f"The {service.part.name} is {'back' if service.deaths else 'ready'} after"
                    f" {now - service.died_at:.1f} s."
                )
                service.died_at, some_are_back = None, True
        return some_are_back

    def _restart(self, service: _Service, now: float) -> None:
        service.started_at, service.restart_at = now, None
        try:
            service.child = self._children.start(service.part.name, service.part.arguments)
        except OSError as error:  # no memory, or no room for its log
            self._plan_restart(
                service,
                now,
                f"The {service.part.name} could not be started: {error.strerror or error}.",
            )

    def _bury(self, service: _Service, now: float) -> None:
        ended = (
            f"The {service.part.name} ended: {service.child.cause_of_death()} (its log:"
            f" {service.child.log})."
        )
        self._children.end(service.child)
        self._plan_restart(service, now, ended)

    def _plan_restart(self, service: _Service, now: float, what: str) -> None:
        service.deaths = deaths_in_a_row(self._policy, service.deaths, now - service.started_at)
        service.died_at = service.died_at or now
        match after_death(self._policy, service.deaths, is_essential=service.part.is_essential):
            case GiveUp():
                raise PartLostError(
                    f"{what} It ended {service.deaths} times in a row, and nothing works"
                    " without it."
                )
            case Restart(delay):
                service.restart_at = now + delay
                self._tell(f"{what} Starting it again in {delay:g} s.")
