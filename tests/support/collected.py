"""The static files as a user has them: what `collectstatic` makes, under its names. Every page of
the tests is given these.
"""

import fcntl
import functools
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from django.contrib.staticfiles.finders import BaseFinder

from telepresence_site.web.static_files import HashedModules
from tests.support.paths import ROOT

FORGOTTEN_S = 24 * 3600.0


@functools.cache
def collected_files() -> Path:
    """Return the folder: made once for what static/ holds now, by the first process to need it."""
    kept = ROOT / ".pytest_cache" / "static"
    kept.mkdir(parents=True, exist_ok=True)
    with (kept / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        folder = kept / _digest()
        if not folder.is_dir():
            for old in kept.glob("*/"):
                # another run may still use a newer one
                if time.time() - old.stat().st_mtime > FORGOTTEN_S:
                    shutil.rmtree(old, ignore_errors=True)
            _collect(folder)
    return folder


def _digest() -> str:
    """Return what changes when the files or the way they are collected change."""
    sources = [path for path in (ROOT / "static").rglob("*") if path.is_file()]
    sources += [
        ROOT / "telepresence_site" / name for name in ("settings.py", "web/static_files.py")
    ]
    entries = sorted(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in sources)
    return hashlib.sha256("\n".join(entries).encode()).hexdigest()[:16]


def _collect(folder: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="telepresence-static-") as var:
        kept = {
            name: value
            for name, value in os.environ.items()
            if name not in {"STATIC_ROOT", "DEBUG"}
        }
        ours = {
            "VAR_DIR": var,
            "HTTP_ONLY": "1",
            "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
        }
        command = [sys.executable, "manage.py", "collectstatic", "--noinput", "-v", "0"]
        subprocess.run(command, cwd=ROOT, env={**kept, **ours}, check=True, timeout=300)
        unfinished = folder.with_suffix(".new")
        shutil.copytree(Path(var) / "static", unfinished)
        unfinished.rename(folder)


class CollectedFiles(HashedModules):
    """The names of the collected files, for the pages that are rendered in the tests' own process;
    a file that is not there is an error.
    """

    def __init__(self) -> None:
        super().__init__(location=collected_files())


class CollectedFinder(BaseFinder):
    """The collected files themselves, for the servers in the tests' own process."""

    def find(self, path: str, find_all: bool = False, **_: Any) -> str | list[str]:
        found = collected_files() / path
        paths = [str(found)] if found.is_file() else []
        return paths if find_all else "".join(paths)

    def list(self, ignore_patterns: Any) -> Iterator[Any]:
        return iter(())
