"""Whether a socket takes what it is sent, as Twisted's transports know it."""

import functools
from types import SimpleNamespace

import pytest

from sessions.backpressure import IS_FULL, Backpressure


class Server:
    """daphne: its `send` is a partial of the server's method with the protocol in front
    (daphne/server.py, create_application), whose transport has another one beneath it with TLS.
    """

    def __init__(self, *, tls):
        self.network = SimpleNamespace(producerPaused=False)
        # twisted.protocols.tls.TLSMemoryBIOProtocol has a transport and no such flag
        transport = SimpleNamespace(transport=self.network) if tls else self.network
        self.send = functools.partial(self.handle_reply, SimpleNamespace(transport=transport))

    async def handle_reply(self, protocol, message):
        raise NotImplementedError


async def is_full_behind(send):
    scopes = []

    async def application(scope, _receive, _send):
        scopes.append(scope)

    await Backpressure(application)({"type": "websocket"}, None, send)
    assert scopes[0]["type"] == "websocket"
    return scopes[0][IS_FULL]


@pytest.mark.parametrize("tls", [False, True])
async def test_a_page_with_a_blocked_network_is_reported_until_it_receives_again(tls):
    server = Server(tls=tls)
    is_full = await is_full_behind(server.send)
    assert not is_full()
    server.network.producerPaused = True
    assert is_full()
    server.network.producerPaused = False
    assert not is_full()


async def test_behind_another_server_nothing_is_full():
    async def send(_message):
        raise NotImplementedError

    assert not (await is_full_behind(send))()
