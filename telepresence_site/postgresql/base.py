"""Connections to the primary of several servers, which end when it is no longer the primary.

A server that dies closes its connections, and a standby refuses writers; libpq handles both. A
frozen server, or one whose machine is lost, stays silent, and its clients would wait for ever. A
thread that waits for long therefore tests whether the server still accepts a connection as the
primary. A slow statement is not interrupted, only one of a server that does not answer at all.
"""

import functools
import time
import weakref
from collections.abc import Callable, Generator
from typing import Any

import psycopg
from django.db.backends.postgresql import base

from telepresence_site.postgresql import CONNECT_SECONDS

QUIET_SECONDS = 2.0  # without an answer, after which the server is tested
Waiting = Generator[Any, Any, Any]
Server = tuple[str, str]  # host, port


class ServerOrder:
    """The order in which this process tries servers: first the one that answered last. A silent one
    is last, because a lost machine costs each attempt its whole time limit.
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
        return sorted(servers, key=lambda one: (one == self._silent, one != self._newest))


_order = ServerOrder()  # of the process: each thread has connections of its own


class DatabaseWrapper(base.DatabaseWrapper):
    def get_connection_params(self) -> dict[str, Any]:
        """Return psycopg's parameters, with the hosts in the order in which it tries them."""
        params: dict[str, Any] = super().get_connection_params()
        servers = zip(params["host"].split(","), params["port"].split(","), strict=True)
        hosts, ports = zip(*_order.sort(list(servers)), strict=True)
        return params | {"host": ",".join(hosts), "port": ",".join(ports)}

    def get_new_connection(self, conn_params: dict[str, Any]) -> Any:
        connection: Any = super().get_new_connection(conn_params)
        server = connection.info.host, str(connection.info.port)
        _order.answered(server)
        here = conn_params | {"host": server[0], "port": server[1]}
        # a weak reference: an unused connection must close itself at once
        connection.wait = functools.partial(_wait, weakref.proxy(connection), here)
        return connection

    def is_usable(self) -> bool:
        """Tell whether the server answers and accepts writes."""
        try:
            with self.connection.cursor() as cursor:
                cursor.execute("SHOW transaction_read_only")
                return bool(cursor.fetchone() == ("off",))
        except psycopg.Error:
            return False


def _wait(
    connection: psycopg.Connection, here: dict[str, Any], waiting: Waiting, **terms: Any
) -> Any:
    """Wait as psycopg does, while the server at `here` is the primary."""
    watched = watch(waiting, functools.partial(_check, connection, here))
    return psycopg.Connection.wait(connection, watched, **terms)


def watch(
    waiting: Waiting, check: Callable[[], None], clock: Callable[[], float] = time.monotonic
) -> Waiting:
    """Wait for what psycopg waits for, and call `check` every QUIET_SECONDS without an answer:
    while there is none, psycopg sends a false value ten times a second.
    """
    try:
        wanted, answered_at = next(waiting), clock()
        while True:
            ready = yield wanted
            is_quiet = not ready and clock() - answered_at >= QUIET_SECONDS
            if is_quiet:
                check()
            if ready or is_quiet:
                answered_at = clock()
            wanted = waiting.send(ready)
    except StopIteration as end:
        return end.value


def _check(connection: psycopg.Connection, here: dict[str, Any]) -> None:
    """Raise OperationalError and close the connection if its server accepts no writer any more."""
    try:
        psycopg.connect(**here | {"connect_timeout": CONNECT_SECONDS}).close()
    except psycopg.Error as error:
        _order.was_silent((here["host"], here["port"]))
        connection.close()
        raise psycopg.OperationalError(f"the database server is away: {error}") from error
