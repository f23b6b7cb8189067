"""The versions of software that a record was made with."""

import subprocess
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from typing import Any

from django.conf import settings


@cache
def software_version() -> str:
    """Return the version of the server, in a clone with the commit ("0.1.0+3f2a…"); empty without a
    project file.
    """
    path = settings.BASE_DIR / "pyproject.toml"
    if not path.is_file():
        return ""
    version = str(tomllib.loads(path.read_text(encoding="utf-8"))["project"]["version"])
    try:
        asked = ["git", "-C", str(settings.BASE_DIR), "rev-parse", "--short=12", "HEAD"]
        found = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=5.0)
    except (OSError, subprocess.SubprocessError):
        return version
    return f"{version}+{found.stdout.strip()}"


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
