"""The static files as users get them, made by `collectstatic`; all pages of the tests use them."""

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

from telepresence_site.web.static_files import HashedModules
from tests.support.analysis.kept_folder import kept_folder
from tests.support.paths import ROOT


@functools.cache
def collected_files() -> Path:
    """Return their folder, made once for the present content of static/ and the locked packages."""
    sources = [path for path in (ROOT / "static").rglob("*") if path.is_file()]
    sources += ROOT.glob("requirements*.lock")
    site = ROOT / "telepresence_site"
    sources += [site / "settings.py", site / "web/static_files.py"]
    return kept_folder("static", sources, _collect)


def _collect(folder: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="telepresence-static-") as var:
        environment = os.environ | {"VAR_DIR": var, "HTTP_ONLY": "1"}
        environment["DJANGO_SETTINGS_MODULE"] = "telepresence_site.settings"
        for name in ("STATIC_ROOT", "DEBUG"):
            environment.pop(name, None)
        command = [sys.executable, "manage.py", "collectstatic", "--noinput", "-v", "0"]
        subprocess.run(command, cwd=ROOT, env=environment, check=True, timeout=300)
        shutil.copytree(Path(var) / "static", folder, dirs_exist_ok=True)


class CollectedFiles(HashedModules):
    """The storage of the collected files, for pages that are rendered in the tests' own process; a
    missing file is an error.
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
