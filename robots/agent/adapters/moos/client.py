"""A client of a MOOSDB, which ends a connection after five seconds of silence."""

import asyncio
import contextlib
import itertools
import time
from collections import deque
from collections.abc import Callable

from robots.agent.adapters.common.sockets import make_prompt
from robots.agent.adapters.moos import wire
from robots.agent.adapters.moos.wire import Mail, Value
from robots.agent.robot_interface import AdapterError
from robots.process.logs import reason_of

GREETING_TIME = 3.0
BEAT = 1.0
PARTING = 0.5
BACKLOG = 64 << 10  # bytes that may wait to be sent before the database counts as gone


class MoosClient:
    """One connection under a `name` that is unique at the database. `take` receives each variable,
    `lost` why the connection ended; both on the loop.
    """

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        take: Callable[[Mail], None],
        lost: Callable[[str], None],
    ) -> None:
        self.name, self.community = name, ""
        self.skew = 0.0  # seconds that the database's clock is ahead of ours
        self._host, self._port, self._take, self._lost = host, port, take, lost
        self._ids = itertools.count()
        self._writer: asyncio.StreamWriter | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._asking: deque[asyncio.Future[None]] = deque()

    async def connect(self) -> None:
        """Reach the database and register our name. Raises AdapterError when it refuses or is
        something else, OSError or TimeoutError without an answer.
        """
        async with asyncio.timeout(GREETING_TIME):
            reader, self._writer = await asyncio.open_connection(self._host, self._port)
            make_prompt(self._writer.get_extra_info("socket"))
            hello = Mail(wire.DATA, wire.ASYNCHRONOUS, self.name, time.time())
            self._writer.write(wire.GREETING + wire.pack([hello]))
            self.community = await self._welcome(reader)
        self._tasks = [
            asyncio.ensure_future(self._read(reader)),
            asyncio.ensure_future(self._beat()),
        ]

    async def _welcome(self, reader: asyncio.StreamReader) -> str:
        try:
            answer = (await _packet(reader))[0]
        except (wire.MoosWireError, IndexError, asyncio.IncompleteReadError) as error:
            raise AdapterError(
                f"no compatible MOOSDB at {self._host}:{self._port}: {reason_of(error)}"
            ) from error
        if answer.type == wire.POISON:
            raise AdapterError(f"the MOOSDB refused the connection: {answer.text}")
        if answer.type != wire.WELCOME or answer.text != wire.ASYNCHRONOUS:
            raise AdapterError(
                "the MOOSDB does not support asynchronous clients: it is older than version 10"
            )
        if isinstance(answer.value, float):
            self.skew = answer.value
        return answer.community

    def notify(self, key: str, value: Value) -> None:
        """Send a variable; raises AdapterError when the database is lost, or does not read."""
        self._send(wire.NOTIFY, key, value)

    def register(self, key: str, interval: float = 0.0) -> None:
        """Subscribe to a variable and its last value, at most every `interval` seconds."""
        self._send(wire.REGISTER, key, interval)

    async def ask(self) -> None:
        """Wait until the database has read what was sent so far; raises AdapterError when it is
        lost.

        It answers a timing message at the head of a packet after all earlier packets
        (ThreadedCommServer::ProcessClient).
        """
        await self._send_time()

    def abort(self) -> None:
        """Disconnect at once, discarding what was not received yet."""
        if self._writer is not None:
            self._writer.transport.abort()

    async def close(self) -> None:
        """Disconnect, after the database has read the last message."""
        if self._writer is not None and not self._writer.transport.is_closing():
            with contextlib.suppress(AdapterError, TimeoutError):
                async with asyncio.timeout(PARTING):
                    await self.ask()
        for answer in self._asking:
            answer.cancel()
        self._asking.clear()
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if self._writer is not None:
            self._writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(1.0):
                    await self._writer.wait_closed()
            self._writer = None

    def _send(self, kind: bytes, key: str, value: Value) -> None:
        writer = self._writer
        if writer is None or writer.transport.is_closing():
            raise AdapterError("the connection to the MOOSDB is lost")
        if writer.transport.get_write_buffer_size() > BACKLOG:
            raise AdapterError("the MOOSDB has stopped reading messages")
        mail = Mail(kind, key, value, time.time(), self.name, number=next(self._ids))
        writer.write(wire.pack([mail]))

    async def _beat(self) -> None:
        with contextlib.suppress(AdapterError):  # the reader reports the loss
            while True:
                self._send_time()  # its answer is not awaited
                await asyncio.sleep(BEAT)

    def _send_time(self) -> asyncio.Future[None]:
        """Return a future that completes with the answer: the database answers in order."""
        answer: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._asking.append(answer)
        self._send(wire.TIMING, wire.CLOCK, 0.0)
        return answer

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while True:
                for mail in await _packet(reader):
                    if mail.type == wire.NOTIFY:
                        self._take(mail)
                    elif mail.type == wire.TIMING and self._asking:
                        asked = self._asking.popleft()
                        if not asked.done():
                            asked.set_result(None)
        except (OSError, asyncio.IncompleteReadError, wire.MoosWireError) as error:
            self._lost(f"the MOOSDB is gone: {reason_of(error)}")


async def _packet(reader: asyncio.StreamReader) -> list[Mail]:
    size, count = wire.body_length(await reader.readexactly(wire.HEADER))
    return wire.unpack(await reader.readexactly(size), count)
