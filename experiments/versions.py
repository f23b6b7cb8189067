"""Which software a record was made with."""

import subprocess
import tomllib
from collections.abc import Mapping
from functools import cache
from typing import Any

from django.conf import settings


@cache
def software_version() -> str:
    """Return the version of the server's software, with the commit where it runs from a clone
    ("0.1.0+3f2a…"); empty where its project file is missing.
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


def versions_of(sheet: Mapping[str, Any], sha256: str) -> dict[str, str]:
    """Return the versions with which a drive begins.

    Args:
        sheet: what the robot says of itself (robots.api.messages.Factsheet).
        sha256: of the study's definition.
    """
    found = {
        "server": software_version(),
        "agent": sheet.get("agent_version", ""),
        "adapter": sheet.get("adapter", ""),
        "driver": sheet.get("driver", ""),
        "definition": sha256,
    }
    return {name: version for name, version in found.items() if version}
