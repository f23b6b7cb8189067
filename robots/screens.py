"""The key of a robot's own display, which authorizes it as the screen of that robot alone.

The owner creates the key, and opens the address with it once on the display, where it is exchanged
for a cookie that no script can read. The key follows the `#`, which browsers do not send, so that
no server logs it. Only its hash is stored, like that of a robot's credentials.
"""

import datetime

from django.urls import reverse

from robots.enrol.credentials import hash_token, matches, new_token
from robots.models import Robot

YEAR = 365 * 24 * 3600


def make_screen_key(robot: Robot, now: datetime.datetime) -> str:
    """Give a robot's screen a new key and return it, for the only time; displays with the old one
    are sent away within a minute.
    """
    key = new_token()
    _write(robot, hash_token(key), now)
    return key


def revoke_screen_key(robot: Robot) -> None:
    """Take the key away."""
    _write(robot, "", None)


def _write(robot: Robot, screen_hash: str, made_at: datetime.datetime | None) -> None:
    kept = robot.credentials
    kept.screen_hash, kept.screen_made_at = screen_hash, made_at
    kept.save(update_fields=["screen_hash", "screen_made_at"])


def screen_address(robot: Robot, key: str, server: str) -> str:
    """Return what to open on the display; `server` is the site's address without a slash at its
    end.
    """
    return f"{server}{reverse('screen', args=[robot.name])}#{key}"


def screen_of(name: str, key: str) -> Robot | None:
    """Return the robot whose screen this key makes, or None."""
    robot = Robot.objects.filter(name=name, enabled=True).select_related("credentials").first()
    fits = robot is not None and key and matches(key, robot.credentials.screen_hash)
    return robot if fits else None


def cookie_of(name: str) -> str:
    """Return the name of the cookie that holds the key."""
    return f"screen-{name}"
