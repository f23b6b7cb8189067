"""The key of a robot's own display, which authorizes it as the screen of that robot alone.

The owner creates the key and opens an address with it on the display, where it is exchanged for a
cookie that no script can read. The key follows the `#`, which browsers do not send, so that no
server logs it. Only its hash is stored.
"""

import datetime

from django.urls import reverse

from robots.enrol.credentials import hash_token, matches, new_token
from robots.models import Robot

YEAR = 365 * 24 * 3600


def make_screen_key(robot: Robot, now: datetime.datetime) -> str:
    """Return a new key for a robot's screen; displays with the old one are disconnected within a
    minute.
    """
    key = new_token()
    _write(robot, hash_token(key), now)
    return key


def revoke_screen_key(robot: Robot) -> None:
    _write(robot, "", None)


def _write(robot: Robot, screen_hash: str, made_at: datetime.datetime | None) -> None:
    kept = robot.credentials
    kept.screen_hash, kept.screen_made_at = screen_hash, made_at
    kept.save(update_fields=["screen_hash", "screen_made_at"])


def screen_address(robot: Robot, key: str, server: str) -> str:
    """Return the address to open on the display; `server` has no slash at its end."""
    return f"{server}{reverse('screen', args=[robot.name])}#{key}"


def screen_of(name: str, key: str) -> Robot | None:
    """Return the enabled robot of this name if this is its screen's key, else None."""
    robot = Robot.objects.filter(name=name, enabled=True).select_related("credentials").first()
    fits = robot is not None and key and matches(key, robot.credentials.screen_hash)
    return robot if fits else None


def cookie_of(name: str) -> str:
    """Return the name of the cookie that contains the key."""
    return f"screen-{name}"
