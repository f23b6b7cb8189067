"""The static files as a user has them: what `collectstatic` makes, under its names. Every page of the tests is given these."""

import atexit
import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from django.contrib.staticfiles.finders import BaseFinder

from telepresence_site.static_files import HashedModules

ROOT = Path(__file__).resolve().parents[2]


@functools.cache
def collected_files() -> Path:
    """Return the folder, made once a process that needs it."""
    var = Path(tempfile.mkdtemp(prefix="telepresence-static-"))
    atexit.register(shutil.rmtree, var, ignore_errors=True)
    kept = {name: value for name, value in os.environ.items() if name not in {"STATIC_ROOT", "DEBUG"}}
    ours = {"VAR_DIR": str(var), "HTTP_ONLY": "1", "DJANGO_SETTINGS_MODULE": "telepresence_site.settings"}
    command = [sys.executable, "manage.py", "collectstatic", "--noinput", "-v", "0"]
    subprocess.run(command, cwd=ROOT, env={**kept, **ours}, check=True, timeout=300)
    return var / "static"


class CollectedFiles(HashedModules):
    """The names of the collected files, for the pages that are rendered in the tests' own process; a file that is not there is an error."""

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
