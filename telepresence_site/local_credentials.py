"""Credentials of robots on this machine, in the files that `manage.py run_robot NAME` reads."""

import tomllib
from pathlib import Path

from django.conf import settings
from django.utils import timezone

from robots.enrol import credentials
from robots.models import Robot


def save_local_credentials(robot: Robot, mqtt_url: str) -> None:
    """Write the robot's credentials file. A token in it that is still valid stays, so that copies
    of it elsewhere remain valid.
    """
    file = settings.CREDENTIALS_DIR / f"{robot.name}.toml"
    token, row = _token_in(file), robot.credentials
    if token and credentials.matches(token, row.credential_hash):
        kept = credentials.Credentials(robot.name, token, row.credential_user)
    else:
        kept = credentials.make_credentials(robot, timezone.now())
    credentials.keep_credentials(kept, file, mqtt_url=mqtt_url)


def _token_in(file: Path) -> str | None:
    try:
        return tomllib.loads(file.read_text()).get("token")
    except (FileNotFoundError, tomllib.TOMLDecodeError):
        return None
