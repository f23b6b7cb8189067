"""The child processes of the demo, of practice and of rehearsals: started side by side, watched,
and never left behind.
"""

import contextlib
import datetime
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

from robots.processes import tied_to_parent

STOP_SECONDS = 8.0
TELLS = "tell: "  # begins a line that is for whoever looks at the parent's terminal
TAIL_BYTES = 4096  # of a log, in which its last line is looked for
LARGEST_LOG = 5_000_000  # bytes; a longer one is begun anew when its child is started again


class StartFailed(Exception):
    """A child ended, or was not ready in time; the message is one sentence."""


@dataclass
class Child:
    """One process, with its output in a log file from byte `log_start` on."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    log_start: int
    started_at: datetime.datetime
    _heard: int = 0  # bytes of its output in which it was listened for what it tells

    def output(self, last: int | None = None) -> str:
        """Return what it has written, or the last so many bytes of that; nothing when somebody has
        removed its log.
        """
        with contextlib.suppress(OSError), self.log.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(self.log_start if last is None else max(self.log_start, size - last))
            return file.read().decode(errors="replace")
        return ""

    def told(self) -> list[str]:
        """Return the sentences for the terminal that it has written since this was asked last:
        whole lines that begin with TELLS.
        """
        with contextlib.suppress(OSError), self.log.open("rb") as file:
            file.seek(self.log_start + self._heard)
            whole, end, _rest = file.read().rpartition(b"\n")
            self._heard += len(whole + end)
            lines = whole.decode(errors="replace").splitlines()
            return [line.removeprefix(TELLS) for line in lines if line.startswith(TELLS)]
        return []

    def last_words(self) -> str:
        """Return the last line of its log that says something."""
        lines = [line.strip() for line in self.output(TAIL_BYTES).splitlines() if line.strip()]
        return lines[-1] if lines else "it said nothing"

    def cause_of_death(self) -> str:
        """Return why it ended: the signal that ended it, else its last words."""
        code = self.process.poll()
        if code is not None and code < 0:
            return f"it was ended by {_signal_name(-code)}"
        return self.last_words().rstrip(".")


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # a real-time signal
        return f"signal {number}"


class DemoPart(NamedTuple):
    """What is to be started: a Python child, how it shows that it is ready, whether nothing works
    without it, and whether it has children of its own to tell of.
    """

    name: str
    arguments: list[str]
    ready: Callable[[Child], bool]
    is_essential: bool = False
    tells: bool = False


@dataclass
class Children:
    """All of them, in order of their start."""

    log_dir: Path
    environment: dict[str, str]
    running: list[Child] = field(default_factory=list)
    _logs: set[Path] = field(default_factory=set)

    def start(self, name: str, arguments: list[str]) -> Child:
        """Start a Python child, its output in a log file of its name, behind what an earlier one of
        this name has left there.
        """
        self.log_dir.mkdir(parents=True, exist_ok=True)
        log = self.log_dir / f"{name.replace(' ', '-')}.log"
        goes_on = log in self._logs and log.exists() and log.stat().st_size < LARGEST_LOG
        self._logs.add(log)
        started_at = datetime.datetime.now(datetime.UTC)
        with log.open("ab" if goes_on else "wb") as output:
            log_start = output.tell()  # before the child writes, which moves it
            process = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self.environment,
                # Ctrl-C reaches the demo alone, which then ends them in order
                start_new_session=True,
                preexec_fn=tied_to_parent(),
            )
            child = Child(name, process, log, log_start, started_at)
        self.running.append(child)
        return child

    def start_together(
        self,
        parts: Iterable[DemoPart],
        *,
        within: float = 30.0,
        step: Callable[[str], AbstractContextManager[None]] = contextlib.nullcontext,
    ) -> None:
        """Start parts that look for each other until they find one another, and wait for each in
        turn.

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

    def _wait(self, child: Child, ready: Callable[[Child], bool], deadline: float) -> None:
        while not ready(child):
            gone = self.ended()
            if gone is not None:
                raise StartFailed(
                    f"The {gone.name} ended at once: {gone.last_words()} (its log: {gone.log})"
                )
            if time.monotonic() > deadline:
                raise StartFailed(
                    f"The {child.name} was not ready in time: {child.last_words()} (its log:"
                    f" {child.log})"
                )
            time.sleep(0.05)

    def end(self, child: Child) -> None:
        """End one of them, and forget it; one that is not there any more is none to end."""
        with contextlib.suppress(ProcessLookupError):
            child.process.terminate()
        self._bury(child, time.monotonic() + STOP_SECONDS)
        if child in self.running:
            self.running.remove(child)

    def ended(self) -> Child | None:
        """Return a child that ended by itself, if any did."""
        return next((child for child in self.running if child.process.poll() is not None), None)

    def stop(self) -> None:
        """End all of them, last started first; who does not listen within some
        seconds is killed.
        """
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
