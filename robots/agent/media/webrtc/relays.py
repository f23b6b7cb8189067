"""Which of the offered relays and address servers a robot reaches. aiortc takes one of each, and
waits 5 s for one that is silent.

All are tried at once: relays by asking for a relayed address and giving it back, address servers
(STUN) by asking for ours. The first of the list that answers counts (UDP before TCP before TLS, as
the server names them); a later one has to be quick only when the earlier ones are silent. Where
there are relays in several regions, the region counts whose answer came soonest. What was found
holds for some minutes, so that only the first visitor of a robot waits.
"""

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import structlog
from aioice import stun, turn
from aiortc import RTCIceServer
from aiortc.rtcicetransport import connection_kwargs

from robots.api.messages import IceServer
from robots.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

# s for a relay to answer; one at the other end of the world needs two round trips of 0.3 s
ANSWER_TIME = 1.5
ASK_AGAIN = 0.3  # s, for a question that was lost on the way
HEAD_START = 0.25  # s for an earlier address when a later one has answered
HOLDS, FAILURE_HOLDS = 300.0, 20.0  # s
FAILURES = (OSError, TimeoutError, ValueError, stun.TransactionError)

Probe = Callable[[RTCIceServer], Awaitable[bool]]


async def answers(server: RTCIceServer, trust: ssl.SSLContext | None = None) -> bool:
    """Tell whether the server's only address answers: a relay with a relayed address, an address
    server with anything. `trust` are the certificates for TLS, the system's when None.
    """
    try:
        asked = connection_kwargs([server])
        async with asyncio.timeout(ANSWER_TIME):
            if "turn_server" in asked:
                await _relayed(asked, trust)
            elif "stun_server" in asked:
                await _address_from(asked["stun_server"])
            else:
                return False
    except FAILURES as error:
        log.info("relay_silent", address=server.urls[0], reason=reason_of(error))
        return False
    return True


async def _relayed(asked: dict[str, Any], trust: ssl.SSLContext | None) -> None:
    transport, _ = await turn.create_turn_endpoint(
        asyncio.DatagramProtocol,
        server_addr=asked["turn_server"],
        username=asked["turn_username"],
        password=asked["turn_password"],
        ssl=asked["turn_ssl"] and (trust or True),
        transport=asked["turn_transport"],
    )
    transport.close()


async def _address_from(server: tuple[str, int]) -> None:
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[None] = loop.create_future()
    transport, _ = await loop.create_datagram_endpoint(
        lambda: _Ear(answer), remote_addr=server, family=socket.AF_INET
    )
    question = bytes(
        stun.Message(message_method=stun.Method.BINDING, message_class=stun.Class.REQUEST)
    )
    try:
        while not answer.done():
            transport.sendto(question)
            await asyncio.wait([answer], timeout=ASK_AGAIN)
        answer.result()
    finally:
        transport.close()


class _Ear(asyncio.DatagramProtocol):
    """Notes the first answer; the socket is connected to one server, the only possible sender."""

    def __init__(self, answer: "asyncio.Future[None]") -> None:
        self._answer = answer

    def datagram_received(self, data: bytes, addr: object) -> None:
        if not self._answer.done():
            self._answer.set_result(None)

    def error_received(self, exc: Exception) -> None:
        if not self._answer.done():
            self._answer.set_exception(exc)


class Relays:
    """The relays and address servers that `probe` reaches. Belongs to the media loop."""

    def __init__(
        self,
        probe: Probe | None = None,
        clock: Callable[[], float] = time.monotonic,
        *,
        trust: ssl.SSLContext | None = None,
    ) -> None:
        self.trust = trust
        self._probe, self._clock = probe or partial(answers, trust=trust), clock
        # by address: when it was asked, and the seconds that its answer took (infinite: none came)
        self._known: dict[str, tuple[float, float]] = {}
        self._tries: dict[str, asyncio.Task[bool]] = {}

    async def usable(self, servers: tuple[IceServer, ...]) -> list[RTCIceServer]:
        """Return the address server and the relay to use, as far as any answers."""
        tellers, regions = _split(servers)
        asked = [self._ask(teller) for teller in tellers]
        relay = await self._first(await self._nearest(regions))
        # An address is told in one message to and fro, and a relay takes two or more: who is silent
        # until then stays so.
        await _wait_for_one(asked, HEAD_START if relay else None)
        teller = next(
            (teller for teller, task in zip(tellers, asked, strict=True) if _succeeded(task)), None
        )
        return [server for server in (teller, relay) if server is not None]

    def doubt(self) -> None:
        """Forget the results: one seems to be out of date."""
        self._known.clear()

    async def _nearest(self, regions: list[list[RTCIceServer]]) -> list[RTCIceServer]:
        if len(regions) < 2:
            return [relay for region in regions for relay in region]
        await _wait_for_one([self._ask(relay) for region in regions for relay in region], None)
        return min(regions, key=lambda region: min(map(self._seconds, region)))

    def _seconds(self, relay: RTCIceServer) -> float:
        return self._known.get(relay.urls[0], (0.0, float("inf")))[1]

    async def _first(self, relays: list[RTCIceServer]) -> RTCIceServer | None:
        asked = [self._ask(relay) for relay in relays]
        await _wait_for_one(asked, None)
        quickest = next((index for index, task in enumerate(asked) if _succeeded(task)), 0)
        await _wait_for_one(asked[:quickest], HEAD_START)
        return next(
            (relay for relay, task in zip(relays, asked, strict=True) if _succeeded(task)), None
        )

    def _ask(self, server: RTCIceServer) -> "asyncio.Task[bool]":
        url = server.urls[0]
        running = self._tries.get(url)
        if running is None:
            running = self._tries[url] = asyncio.ensure_future(self._find_out(server))
            running.add_done_callback(lambda _: self._tries.pop(url, None))
        return running

    async def _find_out(self, server: RTCIceServer) -> bool:
        url, began = server.urls[0], self._clock()
        when, seconds = self._known.get(url, (float("-inf"), float("inf")))
        if began - when > (FAILURE_HOLDS if seconds == float("inf") else HOLDS):
            reachable, now = await self._probe(server), self._clock()
            seconds = now - began if reachable else float("inf")
            self._known[url] = (now, seconds)
        return seconds < float("inf")


def _succeeded(task: "asyncio.Task[bool]") -> bool:
    return task.done() and task.result()


async def _wait_for_one(tasks: list["asyncio.Task[bool]"], seconds: float | None) -> None:
    """Wait until one succeeds, all have failed, or the time is over."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            while not any(_succeeded(task) for task in tasks) and (
                silent := [task for task in tasks if not task.done()]
            ):
                await asyncio.wait(silent, return_when=asyncio.FIRST_COMPLETED)


def _split(
    servers: tuple[IceServer, ...],
) -> tuple[list[RTCIceServer], list[list[RTCIceServer]]]:
    tellers: list[RTCIceServer] = []
    regions: list[list[RTCIceServer]] = []
    for server in servers:
        relays: list[RTCIceServer] = []
        for url in server.urls:
            one = RTCIceServer(
                urls=[url], username=server.username or None, credential=server.credential or None
            )
            (relays if url.startswith(("turn:", "turns:")) else tellers).append(one)
        if relays:
            regions.append(relays)
    return tellers, regions
