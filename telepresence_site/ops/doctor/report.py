"""The file that `manage.py doctor --report` writes for a request for help. It has no secret."""

import os
import platform
import re
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from importlib.metadata import distributions
from pathlib import Path

from django.conf import settings
from django.db import DatabaseError, InterfaceError
from django.utils import timezone

from sessions.models import SystemLog
from telepresence_site.environment import READ
from telepresence_site.ops.doctor.findings import Finding
from telepresence_site.ops.fresh_site import setup_code
from telepresence_site.ops.log_lines import MIN_SECRET_LENGTH, known_secrets, without_secrets

LINES = 300  # of each log
JOURNAL = ["journalctl", "--no-pager", "--output=short-iso", f"--lines={LINES}"]
JOURNAL += ["--unit=telepresence-*"]
JOURNAL_SECONDS = 10.0
# Values that tell nothing about people or passwords: switches and numbers.
HARMLESS = re.compile(r"true|false|yes|no|on|off|[0-9]{1,6}(\.[0-9]{1,3})?", re.IGNORECASE)


def support_report(found: Sequence[Finding], logs: Iterable[Path] = ()) -> str:
    """Return versions, findings, names of settings, and the newest lines of logs, without secrets.

    Args:
        found: the findings of the checks.
        logs: further log files.
    """
    parts = {
        "Versions": _versions(),
        "Checks": [as_line(one) for one in found],
        "Settings": _settings(),
        "System log": _system_log(),
        "Journal": _journal(),
        **{f"Log {path}": _tail(path) for path in logs},
    }
    text = f"Telepresence support report of {timezone.now():%Y-%m-%d %H:%M} UTC\n"
    for title, lines in parts.items():
        text += f"\n== {title} ==\n" + "".join(f"{line}\n" for line in lines)
    return without_secrets(text, (*known_secrets(), setup_code(), *_stored_secrets()))


def as_line(finding: Finding) -> str:
    """Return a finding for a terminal: a line, and one with what to do."""
    advice = f"\n{'':8}{finding.advice}" if finding.advice else ""
    return f"{finding.state:8}{finding.part}: {finding.detail}{advice}"


def _versions() -> list[str]:
    system = f"Python {platform.python_version()}, {platform.platform()}"
    packages = {f"{one.metadata['Name']} {one.version}" for one in distributions()}
    return [system, *sorted(packages, key=str.casefold)]


def _settings() -> list[str]:
    """Return the variables that are set, by name; the value only of numbers and switches, and the
    kind of an address.
    """
    return [f"{name} = {_harmless(os.environ[name])}" for name in sorted(READ & os.environ.keys())]


def _harmless(value: str) -> str:
    if HARMLESS.fullmatch(value) or not value:
        return value or "(empty)"
    kind, found, _rest = value.partition("://")
    return f"{kind}://(set)" if found and kind.isalpha() else "(set)"


def _system_log() -> list[str]:
    try:
        rows = list(SystemLog.objects.order_by("-at")[:LINES])
    except (DatabaseError, InterfaceError) as error:
        return [f"(not readable: {error})"]
    lines = [f"{row.at:%Y-%m-%d %H:%M:%S} {row.level} {row.event} {row.fields}" for row in rows]
    return lines[::-1]


def _journal() -> list[str]:
    if not shutil.which(JOURNAL[0]):
        return ["(there is no journal here)"]
    try:
        done = subprocess.run(
            JOURNAL, capture_output=True, text=True, timeout=JOURNAL_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return [f"(not readable: {error})"]
    return done.stdout.splitlines()


def _tail(path: Path) -> list[str]:
    try:
        return path.read_text(errors="replace").splitlines()[-LINES:]
    except OSError as error:
        return [f"(not readable: {error.strerror})"]


def _stored_secrets() -> list[str]:
    """Return the contents of the files with secrets in VAR_DIR: keys, codes, robots' tokens."""
    files = [*(settings.VAR_DIR / "secrets").glob("*"), *settings.CREDENTIALS_DIR.glob("*")]
    values: set[str] = set()
    for file in files:
        if file.is_file():
            text = file.read_text(errors="replace")
            values |= {text.strip(), *text.replace('"', " ").split()}
    secrets = [one for one in values if len(one) >= max(MIN_SECRET_LENGTH, 12)]
    return sorted(secrets, key=len, reverse=True)
