"""Keys of programs: made for one robot, shown once, `<id>.<token>`, kept as a hash."""

import datetime
from uuid import UUID

from robots.enrol.credentials import hash_token, matches, new_token
from robots.models import Robot
from sessions.models import ApiKey

MAX_LENGTH = 128
# resolution of `last_used_at`: not every request is a write
USE_STEP = datetime.timedelta(minutes=1)


def make_key(robot: Robot, label: str, now: datetime.datetime) -> str:
    """Return a new key for a robot.

    Raises:
        IntegrityError: the robot has one of this label.
    """
    made = ApiKey(robot=robot, label=label)
    key = issue(made, now)
    made.save(force_insert=True)
    return key


def issue(row: ApiKey, now: datetime.datetime) -> str:
    """Create the token of a row that is not stored yet, and return the key."""
    token = new_token()
    row.token_hash, row.made_at = hash_token(token), now
    return f"{row.pk.hex}.{token}"


def key_of(header: str) -> ApiKey | None:
    """Return the key of an Authorization header, with its enabled robot; None for anything else."""
    scheme, _, given = header.partition(" ")
    name, _, token = given.strip().partition(".")
    if scheme.lower() != "bearer" or len(given) > MAX_LENGTH:
        return None
    try:
        found = (
            ApiKey.objects.filter(pk=UUID(name), robot__enabled=True)
            .select_related("robot__presence")
            .first()
        )
    except ValueError:
        return None
    return found if found is not None and matches(token, found.token_hash) else None


def note_use(key: ApiKey, now: datetime.datetime) -> None:
    """Store when a key was last used, to the minute."""
    if key.last_used_at is None or now - key.last_used_at >= USE_STEP:
        ApiKey.objects.filter(pk=key.pk).update(last_used_at=now)
