"""The child processes of the demo: started side by side, watched, and never left behind."""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

PR_SET_PDEATHSIG = 1
STOP_SECONDS = 8.0


class StartFailed(Exception):  # noqa: N818 -- the demo's own word for it
    """A child ended, or was not ready in time; the message is one sentence."""


def die_with_parent() -> None:
    """Ask Linux to end this child when whoever started it is killed; elsewhere the demo's own clean-up has to do."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


@dataclass
class Child:
    """One process, with its output in a log file."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path

    def last_words(self) -> str:
        """Return the last line of its log that says something."""
        lines = [line.strip() for line in self.log.read_text(errors="replace").splitlines() if line.strip()]
        return lines[-1] if lines else "it said nothing"


class Part(NamedTuple):
    """What is to be started: a Python child, and how it shows that it is ready."""

    name: str
    arguments: list[str]
    ready: Callable[[], bool]


@dataclass
class Children:
    """All of them, in order of their start."""

    log_dir: Path
    environment: dict[str, str]
    running: list[Child] = field(default_factory=list)

    def start(self, name: str, arguments: list[str]) -> Child:
        """Start a Python child, its output in a log file of its name."""
        self.log_dir.mkdir(parents=True, exist_ok=True)
        log = self.log_dir / f"{name.replace(' ', '-')}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(  # noqa: S603 -- our own commands
                [sys.executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self.environment,
                start_new_session=True,  # Ctrl-C reaches the demo alone, which then ends them in order
                preexec_fn=die_with_parent if os.name == "posix" else None,  # noqa: PLW1509 -- the demo has no threads yet
            )
        child = Child(name, process, log)
        self.running.append(child)
        return child

    def start_together(
        self, parts: Iterable[Part], *, within: float = 30.0, step: Callable[[str], AbstractContextManager[None]] = contextlib.nullcontext
    ) -> None:
        """Start parts that look for each other until they find one another, and wait for each in turn.

        Args:
            parts: in the order in which they are ended last.
            within: seconds that each may need after the one before it is ready.
            step: entered with a part's name while it is waited for.

        Raises:
            StartFailed: one ended, or was not ready in time.
        """
        started = [(self.start(part.name, part.arguments), part.ready) for part in parts]
        for child, ready in started:
            with step(child.name):
                self._wait(child, ready, time.monotonic() + within)

    def _wait(self, child: Child, ready: Callable[[], bool], deadline: float) -> None:
        while not ready():
            gone = self.ended()
            if gone is not None:
                raise StartFailed(f"The {gone.name} ended at once: {gone.last_words()} (its log: {gone.log})")
            if time.monotonic() > deadline:
                raise StartFailed(f"The {child.name} was not ready in time: {child.last_words()} (its log: {child.log})")
            time.sleep(0.05)

    def end(self, child: Child) -> None:
        """End one of them, and forget it."""
        with contextlib.suppress(ProcessLookupError):
            child.process.terminate()
        self._bury(child, time.monotonic() + STOP_SECONDS)
        self.running.remove(child)

    def ended(self) -> Child | None:
        """Return a child that ended by itself, if any did."""
        return next((child for child in self.running if child.process.poll() is not None), None)

    def stop(self) -> None:
        """End all of them, last started first; who does not listen within some seconds is killed."""
        for child in reversed(self.running):
            with contextlib.suppress(ProcessLookupError):
                child.process.terminate()
        deadline = time.monotonic() + STOP_SECONDS
        for child in reversed(self.running):
            self._bury(child, deadline)
        self.running.clear()

    @staticmethod
    def _bury(child: Child, deadline: float) -> None:
        try:
            child.process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(child.process.pid, signal.SIGKILL)
            child.process.wait()
