"""Connections to the primary of several servers, which end when it is the primary no more.

A server that dies closes its connections, and a standby refuses those that want to write. A server
that is frozen, or whose machine is gone, says nothing at all, and a client would wait for its
answer for ever. So whoever waits for long asks whether the server still takes a connection as a
primary. A slow statement is not cut off: only silence of the whole server is.
"""

import functools
import time
from collections.abc import Callable, Generator
from typing import Any

import psycopg
from django.db.backends.postgresql import base

from telepresence_site.postgresql import CONNECT_SECONDS

QUIET_SECONDS = 2.0  # without an answer, after which the server is asked whether it lives
Waiting = Generator[Any, Any, Any]
# (host, port) that answered last: each new connection tries it first, since a machine that is gone
# costs every attempt its whole time
_newest: tuple[str, str] | None = None


class DatabaseWrapper(base.DatabaseWrapper):
    """Django's own, for several hosts."""

    def get_connection_params(self) -> dict[str, Any]:
        """Return psycopg's parameters, with the host first that answered last."""
        params: dict[str, Any] = super().get_connection_params()
        servers = list(zip(params["host"].split(","), params["port"].split(","), strict=True))
        servers.sort(key=lambda server: server != _newest)
        params["host"], params["port"] = map(",".join, zip(*servers, strict=True))
        return params

    def get_new_connection(self, conn_params: dict[str, Any]) -> Any:
        """Connect to the primary."""
        global _newest  # noqa: PLW0603 -- of the process: each thread has connections of its own
        connection: Any = super().get_new_connection(conn_params)
        _newest = (connection.info.host, str(connection.info.port))
        here = conn_params | dict(zip(("host", "port"), _newest, strict=True))
        connection.wait = functools.partial(_wait, connection, here)
        return connection

    def is_usable(self) -> bool:
        """Tell whether the server answers and takes what is written."""
        try:
            with self.connection.cursor() as cursor:
                cursor.execute("SHOW transaction_read_only")
                return bool(cursor.fetchone() == ("off",))
        except psycopg.Error:
            return False


def _wait(
    connection: psycopg.Connection, here: dict[str, Any], waiting: Waiting, **terms: Any
) -> Any:
    """Wait as psycopg does, for as long as the server of `here` is a primary."""
    watched = watch(waiting, functools.partial(_check, connection, here))
    return psycopg.Connection.wait(connection, watched, **terms)


def watch(
    waiting: Waiting, check: Callable[[], None], clock: Callable[[], float] = time.monotonic
) -> Waiting:
    """Do what psycopg waits for, and `check` whenever nothing has come for so long; psycopg sends a
    falsy value ten times a second in which nothing came.
    """
    try:
        wanted, heard_at = next(waiting), clock()
        while True:
            ready = yield wanted
            if ready:
                heard_at = clock()
            elif clock() - heard_at >= QUIET_SECONDS:
                check()
                heard_at = clock()
            wanted = waiting.send(ready)
    except StopIteration as end:
        return end.value


def _check(connection: psycopg.Connection, here: dict[str, Any]) -> None:
    """Close a connection whose server takes no other one that may write.

    Raises:
        psycopg.OperationalError: so it was.
    """
    try:
        psycopg.connect(**here | {"connect_timeout": CONNECT_SECONDS}).close()
    except psycopg.Error as error:
        connection.close()
        raise psycopg.OperationalError(f"the database server is away: {error}") from error
