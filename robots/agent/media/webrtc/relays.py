"""Which of the offered relays (TURN) and address servers (STUN) a robot reaches. aiortc uses one of
each, and waits 5 s for one that is silent.

All are probed at once: relays by requesting a relayed address and releasing it, address servers by
requesting ours. The first of the list that answers is used (UDP before TCP before TLS, as the
server names them); a later one only when the earlier ones stay silent for `HEAD_START` more. Where
there are relays in several regions, the region whose answer arrives first is used. Results are
cached for some minutes, so that only the first visitor of a robot waits.
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
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

# s for a relay to answer; one on the other side of the world needs two round trips of 0.3 s
ANSWER_TIME = 1.5
ASK_AGAIN = 0.3  # s after a request that may have been lost
HEAD_START = 0.25  # s for an earlier address when a later one has answered
HOLDS, FAILURE_HOLDS = 300.0, 20.0  # s
FAILURES = (OSError, TimeoutError, ValueError, stun.TransactionError)

Probe = Callable[[RTCIceServer], Awaitable[bool]]


async def answers(server: RTCIceServer, trust: ssl.SSLContext | None = None) -> bool:
    """Tell whether the server's only address answers: a relay with a relayed address, an address
    server with anything. `trust` are the certificates for TLS, the system's when None.
    """
    try:
        options = connection_kwargs([server])
        async with asyncio.timeout(ANSWER_TIME):
            if "turn_server" in options:
                await _relayed(options, trust)
            elif "stun_server" in options:
                await _address_from(options["stun_server"])
            else:
                return False
    except FAILURES as error:
        log.info("relay_silent", address=server.urls[0], reason=reason_of(error))
        return False
    return True


async def _relayed(options: dict[str, Any], trust: ssl.SSLContext | None) -> None:
    transport, _ = await turn.create_turn_endpoint(
        asyncio.DatagramProtocol,
        server_addr=options["turn_server"],
        username=options["turn_username"],
        password=options["turn_password"],
        ssl=options["turn_ssl"] and (trust or True),
        transport=options["turn_transport"],
    )
    transport.close()


async def _address_from(server: tuple[str, int]) -> None:
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[None] = loop.create_future()
    transport, _ = await loop.create_datagram_endpoint(
        lambda: _FirstAnswer(answer), remote_addr=server, family=socket.AF_INET
    )
    request = stun.Message(message_method=stun.Method.BINDING, message_class=stun.Class.REQUEST)
    try:
        while not answer.done():
            transport.sendto(bytes(request))
            await asyncio.wait([answer], timeout=ASK_AGAIN)
        answer.result()
    finally:
        transport.close()


class _FirstAnswer(asyncio.DatagramProtocol):
    """The socket is connected to one server, the only possible sender."""

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
        # by address: when it was probed, and the seconds until its answer, infinite without one
        self._results: dict[str, tuple[float, float]] = {}
        self._probes: dict[str, asyncio.Task[bool]] = {}

    async def usable(self, servers: tuple[IceServer, ...]) -> list[RTCIceServer]:
        """Return the address server and the relay to use, as far as any answers."""
        address_servers, regions = _split(servers)
        probes = [self._probed(server) for server in address_servers]
        relay = await self._first(await self._nearest(regions))
        # An address server needs one round trip, a relay two or more: one that is silent until then
        # will not answer.
        await _wait_for_one(probes, HEAD_START if relay else None)
        address_server = _first_of(address_servers, probes)
        return [server for server in (address_server, relay) if server is not None]

    def doubt(self) -> None:
        """Forget the results: one seems to be out of date."""
        self._results.clear()

    async def _nearest(self, regions: list[list[RTCIceServer]]) -> list[RTCIceServer]:
        if len(regions) < 2:
            return [relay for region in regions for relay in region]
        await _wait_for_one([self._probed(relay) for region in regions for relay in region], None)
        return min(regions, key=lambda region: min(map(self._seconds, region)))

    def _seconds(self, relay: RTCIceServer) -> float:
        return self._results.get(relay.urls[0], (0.0, float("inf")))[1]

    async def _first(self, relays: list[RTCIceServer]) -> RTCIceServer | None:
        probes = [self._probed(relay) for relay in relays]
        await _wait_for_one(probes, None)
        quickest = next((index for index, task in enumerate(probes) if _succeeded(task)), 0)
        await _wait_for_one(probes[:quickest], HEAD_START)
        return _first_of(relays, probes)

    def _probed(self, server: RTCIceServer) -> "asyncio.Task[bool]":
        url = server.urls[0]
        running = self._probes.get(url)
        if running is None:
            running = self._probes[url] = asyncio.ensure_future(self._is_reachable(server))
            running.add_done_callback(lambda _: self._probes.pop(url, None))
        return running

    async def _is_reachable(self, server: RTCIceServer) -> bool:
        url, began = server.urls[0], self._clock()
        when, seconds = self._results.get(url, (float("-inf"), float("inf")))
        if began - when > (FAILURE_HOLDS if seconds == float("inf") else HOLDS):
            reachable, now = await self._probe(server), self._clock()
            seconds = now - began if reachable else float("inf")
            self._results[url] = (now, seconds)
        return seconds < float("inf")


def _succeeded(task: "asyncio.Task[bool]") -> bool:
    return task.done() and task.result()


def _first_of(
    servers: list[RTCIceServer], probes: list["asyncio.Task[bool]"]
) -> RTCIceServer | None:
    return next((s for s, task in zip(servers, probes, strict=True) if _succeeded(task)), None)


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
    address_servers: list[RTCIceServer] = []
    regions: list[list[RTCIceServer]] = []
    for server in servers:
        relays: list[RTCIceServer] = []
        for url in server.urls:
            one = RTCIceServer(
                urls=[url], username=server.username or None, credential=server.credential or None
            )
            (relays if url.startswith(("turn:", "turns:")) else address_servers).append(one)
        if relays:
            regions.append(relays)
    return address_servers, regions
