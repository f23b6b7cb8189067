"""The child processes of the demo, of practice and of rehearsals, which end with their parent."""

import contextlib
import datetime
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from robots.process.ending import tied_to_parent

STOP_SECONDS = 8.0
NOTICE_PREFIX = "tell: "  # begins a line that the parent shows in its terminal
TAIL_BYTES = 4096  # of a log, in which its last line is looked for
ROOT = Path(__file__).resolve().parents[1]  # of the packages, for `-m daphne`
MAX_LOG_BYTES = 5_000_000  # a longer log is overwritten when its child is started again


@dataclass
class Child:
    """One process, with its output in a log file from byte `log_start` on."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    log_start: int
    started_at: datetime.datetime
    _notices_read: int = 0  # bytes of its output that `notices` has read

    def output(self, last: int | None = None) -> str:
        """Return its output, or the last so many bytes of it; empty if its log was deleted."""
        with contextlib.suppress(OSError), self.log.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(self.log_start if last is None else max(self.log_start, size - last))
            return file.read().decode(errors="replace")
        return ""

    def notices(self) -> list[str]:
        """Return the sentences for the terminal that it has written since the last call: complete
        lines that begin with NOTICE_PREFIX.
        """
        with contextlib.suppress(OSError), self.log.open("rb") as file:
            file.seek(self.log_start + self._notices_read)
            complete, end, _rest = file.read().rpartition(b"\n")
            self._notices_read += len(complete + end)
            lines = complete.decode(errors="replace").splitlines()
            return [
                line.removeprefix(NOTICE_PREFIX) for line in lines if line.startswith(NOTICE_PREFIX)
            ]
        return []

    def last_line(self) -> str:
        """Return the last line of its output that is not blank."""
        lines = [line.strip() for line in self.output(TAIL_BYTES).splitlines() if line.strip()]
        return lines[-1] if lines else "it said nothing"

    def why_ended(self) -> str:
        """Return the signal that ended it, else its last line."""
        code = self.process.poll()
        if code is None or code >= 0:
            return self.last_line().rstrip(".")
        with contextlib.suppress(ValueError):  # a real-time signal has no name
            return f"it was ended by {signal.Signals(-code).name}"
        return f"it was ended by signal {-code}"


@dataclass
class Children:
    """All children, in the order of their start."""

    log_dir: Path
    environment: dict[str, str]
    running: list[Child] = field(default_factory=list)
    _logs: set[Path] = field(default_factory=set)

    def start(self, name: str, arguments: list[str]) -> Child:
        """Start a Python child. Its output is appended to that of earlier children of its name."""
        self.log_dir.mkdir(parents=True, exist_ok=True)
        log = self.log_dir / f"{name.replace(' ', '-')}.log"
        appends = log in self._logs and log.exists() and log.stat().st_size < MAX_LOG_BYTES
        self._logs.add(log)
        started_at = datetime.datetime.now(datetime.UTC)
        paths = filter(None, (self.environment.get("PYTHONPATH"), str(ROOT)))
        with log.open("ab" if appends else "wb") as output:
            log_start = output.tell()  # before the child writes, which moves it
            process = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**self.environment, "PYTHONPATH": os.pathsep.join(paths)},
                # Ctrl-C reaches the demo alone, which then ends them in order
                start_new_session=True,
                preexec_fn=tied_to_parent(),
            )
        self.running.append(Child(name, process, log, log_start, started_at))
        return self.running[-1]

    def end(self, child: Child) -> None:
        _end_all([child])
        if child in self.running:
            self.running.remove(child)

    def stop(self) -> None:
        """End all children, last started first."""
        _end_all(self.running[::-1])
        self.running.clear()


def _end_all(children: list[Child]) -> None:
    """End children; kill those that have not ended after STOP_SECONDS, with their own children."""
    for child in children:
        with contextlib.suppress(ProcessLookupError):
            child.process.terminate()
    deadline = time.monotonic() + STOP_SECONDS
    for child in children:
        try:
            child.process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(child.process.pid, signal.SIGKILL)
            child.process.wait()
