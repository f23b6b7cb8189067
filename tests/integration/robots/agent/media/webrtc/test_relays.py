"""Which relay and which address server a robot uses: decisions, and a real coturn."""

import asyncio
import contextlib
import socket

import pytest
from aiortc import RTCConfiguration, RTCIceServer, RTCPeerConnection

from robots.agent.broker_link.broker_discovery import tls_context
from robots.agent.media.webrtc import signalling
from robots.agent.media.webrtc.relays import FAILURE_HOLDS, HOLDS, Relays, answers
from robots.agent.media.webrtc.signalling import PageConnection
from robots.api.messages import IceServer, SdpOffer
from tests.support.programs.coturn import Coturn
from tests.support.sessions.site import free_port
from tests.support.virtual_time import on_virtual_time

pytestmark = pytest.mark.broker
STUN = IceServer(urls=("stun:near.example.org", "stun:far.example.org"))
TURN = IceServer(
    urls=("turn:a?transport=udp", "turn:a?transport=tcp", "turns:a"), username="u", credential="c"
)


class World:
    """Answers each transport after a delay in seconds, or never; `asked` are the probed ones."""

    def __init__(self, **delays: float) -> None:
        self.delays = {"udp": None, "tcp": None, "tls": None, "near": None, "far": None} | delays
        self.asked: list[str] = []
        self.now = 0.0

    async def probe(self, server: RTCIceServer) -> bool:
        scheme, _, rest = server.urls[0].partition(":")
        transport = {"turns": "tls", "turn": rest[-3:], "stun": rest.partition(".")[0]}[scheme]
        self.asked.append(transport)
        delay = self.delays[transport]
        await asyncio.sleep(0.6 if delay is None else delay)
        return delay is not None

    def relays(self) -> Relays:
        return Relays(self.probe, lambda: self.now)


async def urls(relays: Relays, *servers: IceServer) -> list[str]:
    return [server.urls[0] for server in await relays.usable(servers)]


@pytest.mark.parametrize(
    ("delays", "wanted"),
    [
        ({"udp": 0.05, "tcp": 0.0, "tls": 0.0}, "turn:a?transport=udp"),
        ({"tcp": 0.1, "tls": 0.0}, "turn:a?transport=tcp"),
        ({"tls": 0.1}, "turns:a"),
        ({}, None),
    ],
)
async def test_first_relay_that_answers_is_used_with_a_preference_for_udp(delays, wanted):
    world = World(**delays)
    turn = await world.relays().usable((TURN,))
    assert [server.urls for server in turn] == ([[wanted]] if wanted else [])
    assert all(server.username == "u" and server.credential == "c" for server in turn)
    assert sorted(world.asked) == ["tcp", "tls", "udp"]


async def test_probed_relays_are_cached_for_a_while():
    world = World(tcp=0.0)
    relays = world.relays()
    for moment, asked in ((0.0, 3), (1.0, 3), (FAILURE_HOLDS + 1.0, 5), (HOLDS + FAILURE_HOLDS, 8)):
        world.now = moment
        assert await urls(relays, TURN) == ["turn:a?transport=tcp"]
        await asyncio.gather(*relays._probes.values())
        assert len(world.asked) == asked, f"after {moment} s"


async def test_concurrent_visitors_share_a_probe():
    world = World(udp=0.1)
    relays = world.relays()
    await asyncio.gather(relays.usable((TURN,)), relays.usable((TURN,)))
    assert len(world.asked) == 3


@pytest.mark.parametrize(
    ("delays", "wanted"),
    [
        ({"near": 0.0, "far": 0.0, "tcp": 0.0}, ["stun:near.example.org", "turn:a?transport=tcp"]),
        ({"far": 0.0}, ["stun:far.example.org"]),
        # UDP is blocked: aiortc would wait for the address server until the page gives up
        ({"tcp": 0.0}, ["turn:a?transport=tcp"]),
        ({}, []),
    ],
)
async def test_silent_address_servers_are_left_out(delays, wanted):
    assert await urls(World(**delays).relays(), STUN, TURN) == wanted


async def test_silent_or_missing_relay_is_left_out():
    one = IceServer(urls=("turn:a?transport=tcp",), username="u", credential="c")
    assert await urls(World().relays(), one) == []
    assert await urls(World(tcp=0.0).relays(), one) == ["turn:a?transport=tcp"]
    assert await urls(World().relays()) == []


REGIONS = tuple(
    IceServer(urls=(f"turn:{name}?transport=udp", f"turns:{name}"), username="u", credential="c")
    for name in ("eu", "us")
)


@pytest.mark.parametrize(
    ("delays", "wanted"),
    [
        ({"turn:eu": 0.12, "turns:eu": 0.24, "turn:us": 0.02, "turns:us": 0.04}, "turn:us"),
        ({"turn:eu": 0.03, "turns:eu": 0.06, "turn:us": 0.12, "turns:us": 0.24}, "turn:eu"),
        # UDP is blocked
        ({"turns:eu": 0.24, "turns:us": 0.06}, "turns:us"),
        # the nearest is down
        ({"turn:eu": 0.12}, "turn:eu"),
    ],
)
def test_region_that_answers_first_is_used_and_kept(delays, wanted):
    @on_virtual_time
    async def measure() -> None:
        async def probe(server: RTCIceServer) -> bool:
            delay = delays.get(server.urls[0].split("?")[0])
            await asyncio.sleep(1.5 if delay is None else delay)
            return delay is not None

        relays = Relays(probe, asyncio.get_running_loop().time)
        for _ in range(2):
            (relay,) = await relays.usable(REGIONS)
            assert relay.urls[0].split("?")[0] == wanted
            await asyncio.sleep(2.0)

    measure()


async def test_doubted_relays_are_probed_again():
    world = World(udp=0.0, near=0.0)
    relays = world.relays()
    assert await urls(relays, STUN, TURN) == ["stun:near.example.org", "turn:a?transport=udp"]
    await asyncio.gather(*relays._probes.values())
    world.delays |= {"udp": None, "near": None, "tcp": 0.0}
    relays.doubt()
    assert await urls(relays, STUN, TURN) == ["turn:a?transport=tcp"]


def as_aiortc(server: IceServer) -> RTCIceServer:
    return RTCIceServer(
        urls=list(server.urls), username=server.username, credential=server.credential
    )


@contextlib.asynccontextmanager
async def offering(server: IceServer):
    """Yield a function that answers a page's offer with these relays, on a new connection."""
    page = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    page.createDataChannel("control")
    await page.setLocalDescription(await page.createOffer())
    offer = SdpOffer(sdp=page.localDescription.sdp, ice_servers=(server,))
    nothing = lambda *_: None

    async def answer(relays: Relays) -> str:
        connection = PageConnection("a", None, None, nothing, nothing, nothing, relays=relays)
        sdp = await connection.answer(offer)
        await connection.close()
        return sdp

    yield answer
    await page.close()


async def test_relay_over_tls_is_verified_with_the_agents_certificates(tmp_path):
    with Coturn(tmp_path) as coturn:
        async with offering(coturn.server("tls")) as answer:
            for trust, is_relayed in ((None, False), (tls_context(str(coturn.ca)), True)):
                assert ("typ relay" in await answer(Relays(trust=trust))) is is_relayed


@pytest.mark.parametrize(("long", "probed"), [(-1.0, 2), (1e9, 1)])
async def test_servers_that_delayed_an_answer_are_probed_again_before_the_next_one(
    monkeypatch, long, probed
):
    monkeypatch.setattr(signalling, "LONG_GATHERING", long)
    world = World()
    relays = world.relays()
    async with offering(IceServer(urls=("stun:near.example.org",))) as answer:
        for _ in range(2):
            await answer(relays)
    assert world.asked == ["near"] * probed


async def test_coturn_answers_valid_credentials_by_udp_tcp_and_tls(tmp_path, monkeypatch):
    with Coturn(tmp_path) as coturn:
        coturn.trust(monkeypatch)
        for transport in ("udp", "tcp", "tls"):
            assert await answers(as_aiortc(coturn.server(transport))), transport
        assert not await answers(as_aiortc(coturn.server("tcp", secret="another")))
        closed = RTCIceServer(
            urls=[f"turn:127.0.0.1:{free_port()}?transport=tcp"], username="u", credential="c"
        )
        assert not await answers(closed)
        assert await answers(RTCIceServer(urls=[f"stun:127.0.0.1:{coturn.port}"]))
    for silent in (f"stun:127.0.0.1:{free_port()}", "stun:127.0.0.1", "stuns:127.0.0.1", "nothing"):
        assert not await answers(RTCIceServer(urls=[silent])), silent


async def test_log_contains_why_a_silent_server_is_not_used(caplog):
    caplog.set_level("INFO")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        url = f"stun:127.0.0.1:{silent.getsockname()[1]}"
        assert not await answers(RTCIceServer(urls=[url]))
    assert f"relay_silent address={url} reason=TimeoutError" in caplog.text
