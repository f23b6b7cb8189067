"""`manage.py demo` as started in the foreground or in the background of a shell."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil

from tests.support.patience import patient
from tests.support.sessions.site import ROOT, wait_for

LINK = re.compile(r"Drive Giraff now:\s+(\S+)")
# variables that tests have set and no user has
TESTS_OWN = {"HTTP_ONLY", "PLAIN_STATIC", "LOG_LEVEL", "DJANGO_SETTINGS_MODULE"}


def disposition(*, background: bool) -> Callable[[], None]:
    """Return a `preexec_fn` that sets signals as in a terminal, or as in the background of a shell
    without job control, where SIGINT and SIGQUIT are ignored (POSIX, Shell Command Language, 2.11).
    """

    def set_signals() -> None:
        for number in (signal.SIGINT, signal.SIGQUIT):
            signal.signal(number, signal.SIG_IGN if background else signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)

    return set_signals


class RunningDemo:
    """One `manage.py demo`, its output in a file."""

    def __init__(
        self, var: Path, *arguments: str, background: bool = False, **settings: str
    ) -> None:
        environment = {name: value for name, value in os.environ.items() if name not in TESTS_OWN}
        self.var = var
        self.output = var / "demo.out"
        var.mkdir(parents=True, exist_ok=True)
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "manage.py", "demo", *arguments],
                cwd=ROOT,
                env={**environment, "VAR_DIR": str(var), **settings},
                stdout=output,
                stderr=subprocess.STDOUT,
                preexec_fn=disposition(background=background),
            )

    def said(self) -> str:
        return self.output.read_text(errors="replace")

    def waits_to_say(self, pattern: str, within: float, since: int = 0) -> re.Match[str]:
        """Wait until its output after `since`, a length of `said()`, has a pattern."""

        def found() -> re.Match[str] | None:
            ended, match = self.process.poll() is not None, re.search(pattern, self.said()[since:])
            assert match or not ended, self.said()
            return match

        return wait_for(found, within, f"{pattern!r} (it said: {self.said()[since:]!r})")

    def link(self) -> str:
        return self.waits_to_say(LINK.pattern, 90).group(1)

    def family(self) -> list[psutil.Process]:
        return psutil.Process(self.process.pid).children(recursive=True)

    def member(self, *words: str) -> psutil.Process:
        """Return the first of its processes whose command line has all these words."""
        found = self.find(*words)
        assert found, f"no process with {words}"
        return found

    def find(self, *words: str) -> psutil.Process | None:
        for process in self.family():
            with contextlib.suppress(psutil.NoSuchProcess):
                if set(words) <= set(process.cmdline()):
                    return process
        return None

    def end(self, number: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(patient(20))


@contextlib.contextmanager
def demo(
    var: Path, *arguments: str, background: bool = False, **settings: str
) -> Iterator[RunningDemo]:
    running = RunningDemo(var, *arguments, background=background, **settings)
    try:
        yield running
    finally:
        running.end()
