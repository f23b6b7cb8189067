"""Programs that tests run to their end."""

import os
import subprocess
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT

INHERITED = ("PATH", "HOME", "LANG", "VIRTUAL_ENV")


def run(
    *words: Any, cwd: Path = ROOT, check: bool = False, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program in the checkout, and return it with its output."""
    options = {"capture_output": True, "text": True, "timeout": 300, **options}
    return subprocess.run(words, cwd=cwd, check=check, **options)


def site_environment(var: Path, **settings: str) -> dict[str, str]:
    """Return the environment of a user who runs a site with these settings."""
    inherited = {name: os.environ[name] for name in INHERITED if name in os.environ}
    own = {"VAR_DIR": str(var), "DJANGO_SETTINGS_MODULE": "telepresence_site.settings"}
    return inherited | own | settings
