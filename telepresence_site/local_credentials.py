"""Credentials of robots that run on this very machine, kept where `manage.py run_robot NAME` finds
them.
"""

import tomllib
from pathlib import Path

from django.conf import settings
from django.utils import timezone

from robots.enrol import credentials
from robots.models import Robot


def keep_credentials_here(robot: Robot, mqtt_url: str) -> None:
    """Write the robot's credentials file; a token that still fits is kept, so that a copy of it
    elsewhere goes on working.
    """
    file = settings.CREDENTIALS_DIR / f"{robot.name}.toml"
    token = _token_in(file)
    fits = token is not None and credentials.matches(token, robot.credentials.credential_hash)
    same = (
        credentials.Credentials(robot.name, token, robot.credentials.credential_user)
        if fits and token
        else None
    )
    kept = same or credentials.make_credentials(robot, timezone.now())
    credentials.keep_credentials(kept, file, mqtt_url=mqtt_url)


def _token_in(file: Path) -> str | None:
    try:
        return tomllib.loads(file.read_text()).get("token")
    except (FileNotFoundError, tomllib.TOMLDecodeError):
        return None
