"""A drive page's WebSocket as the server has it, for clients that are tested without one: grants,
pictures, and what it was told.
"""

import asyncio
import contextlib
import json

from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

from robots.api import codec, picture
from sessions import protocol
from tests.support import words
from tests.support.patience import patient

JPEG = b"\xff\xd8\xff\xe0 a picture \xff\xd9"


class RobotSocket:
    """Use with `async with`. `heard` holds (suffix, message as plain data) of everything that came,
    in order.
    """

    def __init__(self, *, queued: bool = False) -> None:
        self.heard = []
        self.queued = queued
        self.connections = 0
        self.frame = 1000.0
        self._news = asyncio.Event()

    async def __aenter__(self):
        self._server = await serve(self._talk, "127.0.0.1", 0)
        self.url = f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}"
        return self

    async def __aexit__(self, *_error):
        self._server.close()
        await self._server.wait_closed()

    async def _talk(self, socket):
        self.socket = socket
        self.connections += 1
        with contextlib.suppress(ConnectionClosed):
            await self.say(
                "hello",
                protocol.Hello(
                    peer=f"p{self.connections}",
                    stamp=0.0,
                    robot="giraff",
                    online=True,
                    may_drive=True,
                    may_observe=True,
                ),
            )
            async for frame in socket:
                suffix, _, payload = frame.partition("\n")
                self.heard.append((suffix, json.loads(payload)))
                await self._answer(suffix)
                self._news.set()

    async def _answer(self, suffix):
        if suffix == "session/take" and self.queued:
            await self.say("session/queued", protocol.Queued(session="s1", place=1, minutes=2.0))
        elif suffix == "session/take":
            await self.grant()
        elif suffix == "command/picture":
            self.frame += 0.25
            await self.socket.send(picture.frame(picture.pack(self.frame, JPEG)))

    async def grant(self):
        self.queued = False
        terms = protocol.GrantedTerms(interface="standard")
        granted = protocol.Granted(session="s1", epoch=3, peer="p1", terms=terms)
        await self.say("session/granted", granted)
        await self.say("state", words.state(session="s1"))

    async def say(self, suffix, message):
        await self.socket.send(codec.encode_frame(suffix, message))

    def all(self, suffix):
        return [message for name, message in self.heard if name == suffix]

    async def until(self, condition, seconds=5.0):
        """Wait for something to be heard."""
        async with asyncio.timeout(patient(seconds)):
            while not condition():
                self._news.clear()
                await self._news.wait()
