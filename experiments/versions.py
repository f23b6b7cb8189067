"""The versions of software that a record was made with."""

import subprocess
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from typing import Any

from django.conf import settings

from telepresence import __version__


@cache
def software_version() -> str:
    """Return the version of the server, in a clone with the commit ("0.9.0+3f2a…")."""
    if not (settings.BASE_DIR / ".git").exists():  # an installed wheel may be in another's clone
        return __version__
    try:
        asked = ["git", "-C", str(settings.BASE_DIR), "rev-parse", "--short=12", "HEAD"]
        found = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=5.0)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__}+{found.stdout.strip()}"


@cache
def analysis_versions() -> tuple[str, ...]:
    """Return the versions of everything that computes a report: the server and its libraries."""
    return software_version(), *map(metadata.version, ("numpy", "scipy", "statsmodels"))


def versions_of(sheet: Mapping[str, Any], sha256: str) -> dict[str, str]:
    """Return the versions at the start of a drive, by the robot's robots.api.messages.Factsheet and
    the digest of the study's definition.
    """
    reported = {"agent": "agent_version", "adapter": "adapter", "driver": "driver"}
    found = {"server": software_version()}
    found |= {name: sheet.get(key, "") for name, key in reported.items()}
    found["definition"] = sha256
    return {name: version for name, version in found.items() if version}
