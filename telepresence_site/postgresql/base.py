"""Connections to the primary of several servers, which end when it is the primary no more.

A server that dies closes its connections, and a standby refuses those that want to write. A server
that is frozen, or whose machine is gone, says nothing at all, and a client would wait for its
answer for ever. So a thread that waits for long asks whether the server still takes a connection as
a primary. A slow statement is not cut off: only silence of the whole server is.
"""

import functools
import time
import weakref
from collections.abc import Callable, Generator
from typing import Any

import psycopg
from django.db.backends.postgresql import base

from telepresence_site.postgresql import CONNECT_SECONDS

QUIET_SECONDS = 2.0  # without an answer, after which the server is asked whether it lives
Waiting = Generator[Any, Any, Any]
Server = tuple[str, str]  # host, port


class ServerOrder:
    """In which order this process tries servers: the one that answered last comes first, and one
    that said nothing last, since a machine that is gone costs each attempt its whole time.
    """

    def __init__(self) -> None:
        self._newest: Server | None = None
        self._silent: Server | None = None

    def answered(self, server: Server) -> None:
        self._newest = server
        if self._silent == server:
            self._silent = None

    def was_silent(self, server: Server) -> None:
        self._silent = server

    def sort(self, servers: list[Server]) -> list[Server]:
        """Return servers as they are to be tried, otherwise in the order of the setting."""
        return sorted(servers, key=lambda one: (one == self._silent, one != self._newest))


_order = ServerOrder()  # of the process: each thread has connections of its own


class DatabaseWrapper(base.DatabaseWrapper):
    """Django's own, for several hosts."""

    def get_connection_params(self) -> dict[str, Any]:
        """Return psycopg's parameters, with the hosts in the order of their trial."""
        params: dict[str, Any] = super().get_connection_params()
        servers = zip(params["host"].split(","), params["port"].split(","), strict=True)
        hosts, ports = zip(*_order.sort(list(servers)), strict=True)
        return params | {"host": ",".join(hosts), "port": ",".join(ports)}

    def get_new_connection(self, conn_params: dict[str, Any]) -> Any:
        connection: Any = super().get_new_connection(conn_params)
        server = connection.info.host, str(connection.info.port)
        _order.answered(server)
        here = conn_params | {"host": server[0], "port": server[1]}
        # a proxy, since a connection that nobody has any more closes itself at once
        connection.wait = functools.partial(_wait, weakref.proxy(connection), here)
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
        _order.was_silent((here["host"], here["port"]))
        connection.close()
        raise psycopg.OperationalError(f"the database server is away: {error}") from error
