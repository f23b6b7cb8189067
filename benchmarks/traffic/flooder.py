"""A process that floods a broker as fast as it can, until it is killed: `-m
benchmarks.traffic.flooder FLOOD PORT USER TOKEN CONNECTIONS [CA]`.

With a robot's key it logs in, without one it does not; with the path of a certificate it uses TLS.
A closed connection is opened again at once.
"""

import asyncio
import contextlib
import itertools
import ssl
import sys
from collections.abc import Callable

from benchmarks.traffic.mqtt_line import hello, subscribe
from benchmarks.traffic.packets import PublishPacket, publish
from robots.api import topics

HOST = "127.0.0.1"
PIECE = 256 * 1024  # bytes of one write
IDLE_SECONDS = 2.0  # how long a silent stranger waits to see whether it is hung up on


def _repeated(*one: bytes) -> bytes:
    cycle = b"".join(one)
    return cycle * max(1, PIECE // len(cycle))


def _subscribes(user: str) -> bytes:
    return _repeated(
        *(
            subscribe([(topics.of(user, f"signal/x{number}"), 1), (topics.of(user, "signal/+"), 1)])
            for number in range(500)
        )
    )


def _photos(user: str) -> bytes:
    return _repeated(
        *(
            publish(PublishPacket(topics.of(user, f"photo/{number}"), b"x", retain=True))
            for number in range(500)
        )
    )


def _unacknowledged(user: str) -> bytes:
    return subscribe([(topics.of(user, "connection"), 1)]) + _repeated(
        publish(PublishPacket(topics.of(user, "connection"), b"", 1, packet_id=1))
    )


def _unreleased(user: str) -> bytes:
    return _repeated(
        *(
            publish(PublishPacket(topics.of(user, "state"), b"", 2, packet_id=number))
            for number in range(1, 5000)
        )
    )


KEY_FLOODS: dict[str, Callable[[str], bytes]] = {
    "pings": lambda _: _repeated(b"\xc0\x00"),
    "empty": lambda user: _repeated(publish(PublishPacket(topics.of(user, "state"), b""))),
    "refused": lambda _: _repeated(
        publish(PublishPacket(topics.of("somebody-else", "state"), b""))
    ),
    "subscribes": _subscribes,
    "unacknowledged": _unacknowledged,
    "unreleased": _unreleased,
    "huge": lambda user: publish(PublishPacket(topics.of(user, "state"), bytes(1024 * 1024))),
    "retained": lambda user: _repeated(
        publish(PublishPacket(topics.of(user, "connection"), b"x" * 100, retain=True))
    ),
    "photos": _photos,
    "reconnects": lambda _: b"",
}
STRANGER_FLOODS = ("password", "passwords", "come-and-go", "silent")


class Flooder:
    """One attacker; `user` and `token` are wrong for a stranger."""

    def __init__(self, port: int, user: str, token: str, tls: ssl.SSLContext | None = None) -> None:
        self._port, self._user, self._token, self._tls = port, user, token, tls
        self._numbers = itertools.count()

    async def by_key(self, flood: str) -> None:
        """Sign in, and write whatever the flood is made of for as long as the broker takes it; read
        nothing of its answers.
        """
        will = PublishPacket(topics.of(self._user, "connection"), b"x", 1)
        data = KEY_FLOODS[flood](self._user)
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await self._open()
                writer.write(hello(f"flooder-{next(self._numbers)}", self._user, self._token, will))
                await reader.read(4)
                while data:
                    writer.write(data)
                    await writer.drain()
                writer.transport.abort()

    async def as_stranger(self, flood: str) -> None:
        """Come again and again."""
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await self._open()
                if flood.startswith("password"):
                    user = (
                        f"{self._user}{next(self._numbers)}" if flood == "passwords" else self._user
                    )
                    writer.write(
                        hello("stranger", user, "wrong")
                        + (_repeated(b"\xc0\x00") if flood == "password" else b"")
                    )
                if flood != "come-and-go":
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(reader.read(), IDLE_SECONDS)
                writer.transport.abort()

    async def _open(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection(HOST, self._port, ssl=self._tls)


async def main(flood: str, port: str, user: str, token: str, connections: str, *ca: str) -> None:
    flooder = Flooder(
        int(port), user, token, ssl.create_default_context(cafile=ca[0]) if ca else None
    )
    attack = flooder.by_key if flood in KEY_FLOODS else flooder.as_stranger
    await asyncio.gather(*(attack(flood) for _ in range(int(connections))))


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
