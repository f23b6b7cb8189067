"""The child processes of the demo: started in order, watched, and never left behind."""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

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


@dataclass
class Children:
    """All of them, in order of their start."""

    log_dir: Path
    environment: dict[str, str]
    running: list[Child] = field(default_factory=list)

    def start(self, name: str, arguments: list[str], ready: Callable[[], bool], *, within: float = 30.0) -> Child:
        """Start a Python child and wait until `ready()` says yes.

        Raises:
            StartFailed: it ended, or was not ready within that many seconds.
        """
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
        self._wait(child, ready, time.monotonic() + within)
        return child

    def _wait(self, child: Child, ready: Callable[[], bool], deadline: float) -> None:
        while not ready():
            if child.process.poll() is not None:
                raise StartFailed(f"The {child.name} ended at once: {child.last_words()} (its log: {child.log})")
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
