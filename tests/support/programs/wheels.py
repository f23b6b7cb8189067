"""The wheel of this checkout, and computers on which it is installed."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil

from tests.support.paths import ROOT
from tests.support.programs.finished import run

# The root of the other system is the first argument, and the command follows.
CHROOT = (
    'mount --rbind /dev "$0/dev" && mount -t proc proc "$0/proc" && exec chroot "$0"'
    ' /usr/bin/env -i --chdir=/root HOME=/root PATH=/usr/bin:/bin "$@"'
)
NAMESPACE = ("unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", CHROOT)
TESTS_OWN = ("DJANGO_SETTINGS_MODULE", "HTTP_ONLY", "LOG_LEVEL", "PLAIN_STATIC", "PYTHONPATH")
TESTS_OWN += ("VAR_DIR", "XDG_DATA_HOME")
END_SECONDS = 30.0


def build(folder: Path) -> Path:
    """Build the wheel in a folder and return its path."""
    words = ("-m", "hatchling", "build", "-t", "wheel", "-d", folder)
    run(sys.executable, *words, cwd=ROOT, check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


@dataclass(frozen=True)
class Computer:
    """Where the wheel is installed.

    `before` precedes each command, `python` is the first one there, `packages` are the words with
    which pip finds packages, and `home` is the user's folder, as seen from here.
    """

    before: tuple[str, ...]
    python: str
    packages: tuple[str, ...]
    home: Path
    environment: dict[str, str]

    def run(self, *words: str) -> str:
        """Run a command in the user's folder; return its output."""
        done = run(*self.before, *words, cwd=self.home, env=self.environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def install(self, folder: str, extra: str) -> float:
        """Install the wheel in a new virtual environment; return the seconds that this took."""
        started = time.monotonic()
        self.run(self.python, "-m", "venv", folder)
        self.run(f"{folder}/bin/pip", "install", *self.packages, f"telepresence[{extra}]")
        return time.monotonic() - started

    @contextlib.contextmanager
    def running(self, *words: str) -> Iterator[Path]:
        """Run a command until the end of the block; yields the file of its output."""
        output = self.home / "output"
        with output.open("wb") as file:
            process = subprocess.Popen(
                [*self.before, *words],
                cwd=self.home,
                env=self.environment,
                stdout=file,
                stderr=subprocess.STDOUT,
            )
        try:
            yield output
        finally:
            # unshare ignores signals while its child runs
            own = psutil.Process(process.pid)
            (own.children()[0] if self.before and own.children() else own).terminate()
            process.wait(END_SECONDS)


def this_computer(wheel: Path, home: Path) -> Computer:
    """Return this computer, where pip finds packages as usual."""
    inherited = {name: value for name, value in os.environ.items() if name not in TESTS_OWN}
    packages = ("--find-links", str(wheel.parent))
    return Computer((), sys.executable, packages, home, {**inherited, "HOME": str(home)})


def bare_debian(wheel: Path, root: Path) -> Computer:
    """Make a Debian 12 that has Python and nothing else of use, and download for it what the site
    needs.
    """
    packages = "--include=python3,python3-venv"
    run("mmdebstrap", "--quiet", "--variant=apt", packages, "bookworm", root, check=True)
    needed = f"telepresence[site] @ {wheel.as_uri()}"
    words = ("-m", "pip", "download", "-q", "-d", root / "wheels", needed)
    run(sys.executable, *words, check=True)
    offline = ("--no-index", "--find-links", "/wheels")
    before = (*NAMESPACE, str(root))
    return Computer(before, "/usr/bin/python3", offline, root / "root", dict(os.environ))
