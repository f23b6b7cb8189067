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
from robots.logs import reason_of

GREETING_TIME = 3.0
BEAT = 1.0
PARTING = 0.5
BACKLOG = 64 << 10  # bytes that may wait to be sent before the database counts as gone


class MoosClient:
    """One connection under a `name` unique at the database. `heard` gets every variable that
    arrives, `lost` why the connection ended; both on the loop.
    """

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        heard: Callable[[Mail], None],
        lost: Callable[[str], None],
    ) -> None:
        self.name, self.community = name, ""
        self.skew = 0.0  # seconds that the database's clock is ahead of ours
        self._host, self._port, self._heard, self._lost = host, port, heard, lost
        self._ids = itertools.count()
        self._writer: asyncio.StreamWriter | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._asking: deque[asyncio.Future[None]] = deque()

    async def connect(self) -> None:
        """Reach the database and say who we are.

        Raises:
            AdapterError: it refuses, or is something else.
            OSError, TimeoutError: there is no answer.
        """
        async with asyncio.timeout(GREETING_TIME):
            reader, self._writer = await asyncio.open_connection(self._host, self._port)
            make_prompt(self._writer.get_extra_info("socket"))
            self._writer.write(
                wire.GREETING
                + wire.pack([Mail(wire.DATA, wire.ASYNCHRONOUS, self.name, time.time())])
            )
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
        """Send a variable; raises AdapterError when the database is gone, or does not read."""
        self._send(Mail(wire.NOTIFY, key, value, time.time(), self.name, number=next(self._ids)))

    def register(self, key: str, interval: float = 0.0) -> None:
        """Subscribe to a variable, at most every `interval` seconds; its last value comes first."""
        self._send(
            Mail(wire.REGISTER, key, interval, time.time(), self.name, number=next(self._ids))
        )

    async def ask(self) -> None:
        """Wait until the database has read what was sent so far.

        It answers a message of timing that leads a packet, behind all packets of before
        (ThreadedCommServer::ProcessClient).

        Raises:
            AdapterError: the database is gone.
        """
        answer = asyncio.get_running_loop().create_future()
        self._asking.append(answer)
        self._say_time()
        await answer

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

    def _send(self, mail: Mail) -> None:
        writer = self._writer
        if writer is None or writer.transport.is_closing():
            raise AdapterError("the connection to the MOOSDB is lost")
        if writer.transport.get_write_buffer_size() > BACKLOG:
            raise AdapterError("the MOOSDB has stopped reading messages")
        writer.write(wire.pack([mail]))

    async def _beat(self) -> None:
        """Send before the silence is too long."""
        with contextlib.suppress(AdapterError):  # the reader reports that it is lost
            while True:
                # its answer is not awaited
                self._asking.append(asyncio.get_running_loop().create_future())
                self._say_time()
                await asyncio.sleep(BEAT)

    def _say_time(self) -> None:
        self._send(
            Mail(wire.TIMING, wire.CLOCK, 0.0, time.time(), self.name, number=next(self._ids))
        )

    def _answer(self) -> None:
        """Take the answer to the oldest question: the database answers in order."""
        asked = self._asking.popleft()
        if not asked.done():
            asked.set_result(None)

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while True:
                for mail in await _packet(reader):
                    if mail.type == wire.NOTIFY:
                        self._heard(mail)
                    elif mail.type == wire.TIMING and self._asking:
                        self._answer()
        except (OSError, asyncio.IncompleteReadError, wire.MoosWireError) as error:
            self._lost(f"the MOOSDB is gone: {reason_of(error)}")


async def _packet(reader: asyncio.StreamReader) -> list[Mail]:
    size, count = wire.body_length(await reader.readexactly(wire.HEADER))
    return wire.unpack(await reader.readexactly(size), count)
