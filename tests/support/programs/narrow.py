"""A slow connection to a server: a TCP relay that limits the bytes per second towards the browser,
with short queues.
"""

import asyncio
import contextlib
import socket
import threading
from typing import Self

from tests.support.patience import patient

PIECE = 1024
BUFFER = 8192


class Narrow:
    """Relays `port` to a server on this computer, at `rate` bytes per second towards the client;
    None is unlimited.
    """

    def __init__(self, target: int) -> None:
        self.target = target
        self.rate: float | None = None
        self.port = 0
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(patient(5))
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(5)

    async def _main(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._ended, self._gate = asyncio.Event(), asyncio.Lock()
        async with await asyncio.start_server(self._serve, "127.0.0.1", 0) as server:
            self.port = server.sockets[0].getsockname()[1]
            self._ready.set()
            await self._ended.wait()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        upstream = socket.socket()
        upstream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        upstream.setblocking(False)
        await self._loop.sock_connect(upstream, ("127.0.0.1", self.target))
        there_reader, there_writer = await asyncio.open_connection(sock=upstream, limit=BUFFER)
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(
                self._pipe(reader, there_writer, narrow=False),
                self._pipe(there_reader, writer, narrow=True),
            )

    async def _pipe(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, narrow: bool
    ) -> None:
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(PIECE):
                if narrow and self.rate is not None:
                    async with self._gate:
                        await asyncio.sleep(len(data) / self.rate)
                writer.write(data)
                await writer.drain()
        writer.close()
