"""A MOOSDB with the real wire format: greeting, registration, the last value on registration,
silent clients, duplicate names.

As in core-moos, a timing message is answered only if it is the first of its packet, after the
packets before it (Core/libMOOS/Comms/ThreadedCommServer.cpp, ProcessClient). As a process: `python
-m tests.support.architectures.moosdb HOST PORT`.
"""

import asyncio
import contextlib
import sys
import time
from dataclasses import replace

from robots.agent.adapters.moos import wire
from robots.agent.adapters.moos.wire import Mail

SILENCE = 5.0


class MoosDb:
    def __init__(self, community="test", host="127.0.0.1", port=0):
        self.community, self.host, self.port = community, host, port
        self.clients, self.values = {}, {}
        self._registered = {}
        self._server = None

    async def start(self):
        self._server = await asyncio.start_server(self._client, self.host, self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self):
        """Abort all connections and lose all values."""
        self._server.close()
        for writer in list(self.clients.values()):
            writer.transport.abort()
        self.values.clear()

    async def _client(self, reader, writer):
        name = None
        try:
            name = await self._greet(reader, writer)
            while name is not None:
                async with asyncio.timeout(SILENCE):
                    mails = await self._packet(reader)
                answers = []
                if mails and mails[0].type == wire.TIMING:
                    answers.append(replace(mails.pop(0), value=time.time(), second=0.0))
                answers += [answer for mail in mails for answer in self._take(name, mail)]
                if answers:
                    writer.write(wire.pack(answers))
        except (OSError, TimeoutError, asyncio.IncompleteReadError, wire.MoosWireError):
            pass
        finally:
            if name is not None:
                self.clients.pop(name, None)
                for table in self._registered.values():
                    table.discard(name)
            writer.close()

    async def _packet(self, reader):
        size, count = wire.body_length(await reader.readexactly(wire.HEADER))
        return wire.unpack(await reader.readexactly(size), count)

    async def _greet(self, reader, writer):
        async with asyncio.timeout(SILENCE):
            if await reader.readexactly(len(wire.GREETING)) != wire.GREETING:
                return None
            (hello,) = await self._packet(reader)
        name = hello.value
        if hello.type != wire.DATA or name in self.clients:
            refusal = f'A client of this name ("{name}") already exists'
            writer.write(wire.pack([Mail(wire.POISON, value=refusal)]))
            with contextlib.suppress(OSError):
                await writer.drain()
            return None
        self.clients[name] = writer
        now, words = time.time(), {"helper": "hostname=localhost", "text": "asynchronous"}
        welcome = Mail(wire.WELCOME, "", now - hello.time, now, community=self.community, **words)
        writer.write(wire.pack([welcome]))
        return name

    def _take(self, name, mail):
        if mail.type == wire.NOTIFY:
            self._notify(mail)
        elif mail.type == wire.REGISTER:
            self._registered.setdefault(mail.key, set()).add(name)
            return [self.values[mail.key]] if mail.key in self.values else []
        return []

    def _notify(self, mail):
        before = self.values.get(mail.key)
        if before is not None and type(before.value) is not type(mail.value):
            return  # a variable keeps its type
        mail = self.values[mail.key] = replace(mail, community=self.community)
        packet = wire.pack([mail])
        for name in self._registered.get(mail.key, ()):
            if name in self.clients:
                self.clients[name].write(packet)


async def main(host, port):
    await MoosDb(host=host, port=port).start()
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
