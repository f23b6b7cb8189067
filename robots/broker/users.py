"""Who may connect, read from the database."""

import datetime
from collections.abc import Awaitable, Callable
from functools import cache
from typing import Any

from channels.db import database_sync_to_async
from django.db import DatabaseError, InterfaceError
from django.utils import timezone
from django.utils.crypto import salted_hmac

from robots.broker.permissions import BrokerUser, of_robot, of_server
from robots.enrol.credentials import (
    NONE,
    SALT_BYTES,
    SERVER_USERS,
    ServerPart,
    bcrypt_hash,
    bcrypt_hashes_of,
    hash_token,
    server_credentials,
    users_of,
)
from robots.models import RobotCredentials

POLL_SECONDS = 2.0
FIELDS = ("robot__name", *NONE)

ReadUsers = Callable[[], Awaitable[dict[str, BrokerUser]]]


class UsersUnavailableError(Exception):
    """The database could not be read; what was known before stays valid."""


@cache
def _server_user(part: ServerPart, name: str) -> BrokerUser:
    # The salt follows from the secret key like the password: every process writes the same, and
    # what has not changed looks the same.
    salt = salted_hmac("robots.broker.salt", part, algorithm="sha256").digest()
    password = server_credentials(part)[1]
    return BrokerUser(
        name,
        hash_token(password, salt=salt[:SALT_BYTES]),
        of_server(),
        bcrypt_hash(password, salt=salt),
    )


def _server_users() -> list[BrokerUser]:
    return [_server_user(part, name) for part, name in SERVER_USERS.items()]


class _RobotUsers:
    """The users of robots. They are read every two seconds, so users made from a row are kept
    until the row changes.
    """

    def __init__(self) -> None:
        self._made: dict[tuple[Any, ...], list[BrokerUser]] = {}

    def read(self) -> list[BrokerUser]:
        """Return the users of all enabled robots, by the robots' names."""
        now, until = timezone.now(), FIELDS.index("former_until")
        enabled = RobotCredentials.objects.filter(robot__enabled=True)
        rows = enabled.exclude(credential_hash="").order_by("robot__name")
        made = {}
        for row in rows.values_list(*FIELDS):
            key = (*row, row[until] is not None and now < row[until])
            made[key] = self._made.get(key) or _users_in(row, now)
        self._made = made
        return [user for users in made.values() for user in users]


def _users_in(row: tuple[Any, ...], now: datetime.datetime) -> list[BrokerUser]:
    name, kept = row[0], RobotCredentials(**dict(zip(NONE, row[1:], strict=True)))
    hashes = bcrypt_hashes_of(kept)
    return [
        BrokerUser(user, credential_hash, of_robot(name), hashes[credential_hash])
        for user, credential_hash in users_of(name, kept, now).items()
    ]


_robots = _RobotUsers()


def users_now() -> dict[str, BrokerUser]:
    """Return every user by name: the server's own processes, and the enabled robots that have
    credentials.

    Raises:
        UsersUnavailableError: the database could not be read.
    """
    try:
        return {user.name: user for user in (*_server_users(), *_robots.read())}
    except (DatabaseError, InterfaceError) as error:
        raise UsersUnavailableError(str(error)) from error


read_users: ReadUsers = database_sync_to_async(users_now)
