"""The embedded broker: sockets, clock and passwords around `Hub`. It needs nothing but Python, and
runs in a process of its own.

Each client is a `ClientConnection`. Passwords are checked off the loop; users come from memory,
which a task renews from the database, so that no message waits for a query.
"""

import asyncio
import logging
import ssl
import time
from collections import deque

import structlog

from accounts.client_address import counted
from robots.broker.admission import Admission
from robots.broker.bounded_log import BoundedLog
from robots.broker.connection import ClientConnection
from robots.broker.hub import Hub
from robots.broker.packets import Connect, ProtocolError
from robots.broker.permissions import SESSION_SECONDS, BrokerUser
from robots.broker.users import POLL_SECONDS, ReadUsers, UsersUnavailableError
from robots.enrol.credentials import Verifier, matches

logger = structlog.stdlib.get_logger(__name__)

SWEEP_SECONDS = 0.5
REFRESH_SECONDS = 0.5  # least time between two extra looks at the database
ACCEPTED_A_TURN = 4  # connections
BACKLOG = 1024  # connections that wait in the kernel for their turn


class EmbeddedBroker:
    """A broker on one port. `read_users` is asked every `poll` seconds, and when somebody unknown
    or with a new key connects.
    """

    name = "embedded"

    def __init__(self, read_users: ReadUsers, *, poll: float = POLL_SECONDS) -> None:
        self.log = BoundedLog(logger)
        self.hub = Hub(self.log)
        self.admission: Admission[ClientConnection] = Admission()
        self.connections: set[ClientConnection] = set()
        self._read_users, self._poll = read_users, poll
        self._users: dict[str, BrokerUser] = {}
        self._read_at = -1e18
        self._reading = asyncio.Lock()
        self._verifier = Verifier()
        self._unchecked: deque[ClientConnection] = deque()
        self._server: asyncio.Server | None = None
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self, host: str, port: int, tls: ssl.SSLContext | None = None) -> int:
        """Listen and return the port (a free one when asked for 0).

        Raises:
            OSError: the address cannot be had.
            UsersUnavailableError: the database cannot be read.
        """
        self._take_users(await self._read_users())
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: ClientConnection(self, tls),
            host,
            port,
            backlog=ACCEPTED_A_TURN,
            reuse_address=True,
        )
        # asyncio's one number is how many are accepted in a turn, and how many the kernel lets wait
        for listening in self._server.sockets:
            with listening.dup() as same:
                same.listen(BACKLOG)
        self._tasks = [loop.create_task(self._sweep()), loop.create_task(self._follow_users())]
        return int(self._server.sockets[0].getsockname()[1])

    async def wait(self) -> None:
        """Return only with an exception: when one of the broker's own tasks has failed."""
        await asyncio.gather(*self._tasks)

    async def stop(self) -> None:
        """Close every connection, and the port."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._server is not None:
            self._server.close()
        for connection in list(self.connections):
            connection.kick()
        if self._server is not None:
            await self._server.wait_closed()

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            now = time.monotonic()
            for connection in list(self.connections):
                connection.sweep(now)
            self.hub.expire(now - SESSION_SECONDS)
            self.log.flush()

    def check(self, connection: ClientConnection) -> None:
        """Look at the CONNECT of a stranger when its turn has come: one in a turn of the loop."""
        self._unchecked.append(connection)
        if len(self._unchecked) == 1:
            asyncio.get_running_loop().call_soon(self._check_next)

    def _check_next(self) -> None:
        connection = self._unchecked.popleft()
        if self._unchecked:
            asyncio.get_running_loop().call_soon(self._check_next)
        if connection.closing_since is None:
            try:
                connection.sign_in()
            except ProtocolError as error:
                connection.break_off(error)

    async def _follow_users(self) -> None:
        while True:
            await asyncio.sleep(self._poll)
            await self._refresh()

    async def _refresh(self) -> None:
        """See to it that the users are read after this moment, at most every REFRESH_SECONDS; what
        cannot be read changes nothing.
        """
        asked = time.monotonic()
        async with self._reading:
            if self._read_at > asked:  # somebody else's look came after ours was asked for
                return
            await asyncio.sleep(self._read_at + min(REFRESH_SECONDS, self._poll) - time.monotonic())
            begun = time.monotonic()
            try:
                self._take_users(await self._read_users())
            except UsersUnavailableError as error:
                self._warn("", "broker_users_unavailable", reason=str(error))
            self._read_at = begun

    def _take_users(self, users: dict[str, BrokerUser]) -> None:
        self._users = users
        self.hub.set_users(users, time.monotonic())
        self.admission.forget_users(users)

    async def authenticate(self, connect: Connect, address: str) -> BrokerUser | None:
        """Return whose password it is, or None. An address that is often wrong causes no more looks
        at the database.
        """
        name, token, network_prefix = connect.user, connect.password, counted(address)
        if name is None or token is None:
            self._warn(network_prefix, "broker_anonymous_refused", address=address)
            return None
        known = self._users.get(name)
        if known is not None and self._verifier.knows(
            token, known.credential_hash, time.monotonic()
        ):
            return known
        user = await self._verified(name, token)
        if user is None and not self._verifier.is_blocked(network_prefix, time.monotonic()):
            await self._refresh()  # perhaps the key is younger than our last look at the database
            user = await self._verified(name, token)
        if user is None:
            self._verifier.note_failure(network_prefix, time.monotonic())
            self._warn(network_prefix, "broker_password_refused", user=name[:80], address=address)
        return user

    async def _verified(self, name: str, token: str) -> BrokerUser | None:
        user = self._users.get(name)
        if user is None or not await asyncio.to_thread(matches, token, user.credential_hash):
            return None
        self._verifier.note(token, user.credential_hash, time.monotonic())
        return user if self._users.get(name) == user else None  # it may have been revoked meanwhile

    def _warn(self, subject: str, event: str, **fields: object) -> None:
        self.log.write(logging.WARNING, subject, event, **fields)
