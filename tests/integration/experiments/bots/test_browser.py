"""WebSockets of a bot's browser."""

import urllib.request
from email.message import Message
from types import SimpleNamespace

import pytest
from websockets.asyncio.server import serve
from websockets.exceptions import InvalidStatus
from websockets.frames import CloseCode

from experiments.bots.browser import AGENT, Browser


async def served(handler, **options):
    server = await serve(handler, "127.0.0.1", 0, **options)
    return server, Browser(f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}")


async def test_handshake_has_origin_cookies_and_agent_of_the_browser():
    async def tell(socket):
        headers = socket.request.headers
        await socket.send("\n".join(headers[name] for name in ("Origin", "User-Agent", "Cookie")))

    server, browser = await served(tell)
    with_cookie = Message()
    with_cookie["Set-Cookie"] = "sessionid=abc"
    answer = SimpleNamespace(info=lambda: with_cookie)
    browser.jar.extract_cookies(answer, urllib.request.Request(browser.site))
    async with server:
        socket = await browser.websocket("/ws/")
        assert await socket.recv() == f"{browser.site}\n{AGENT}\nsessionid=abc"
        await socket.close()


async def test_refused_connection_raises_another_error_than_an_unreachable_site():
    server, browser = await served(
        None, process_request=lambda connection, _request: connection.respond(403, "no")
    )
    async with server:
        with pytest.raises(InvalidStatus, match="403"):
            await browser.websocket("/ws/")
    with pytest.raises(OSError):
        await browser.websocket("/ws/")


async def test_an_aborted_connection_sends_no_close_frame():
    codes = []

    async def listen(socket):
        await socket.wait_closed()
        codes.append(socket.close_code)

    server, browser = await served(listen)
    socket = await browser.websocket("/ws/")
    socket.transport.abort()
    server.close()
    await server.wait_closed()
    assert codes == [CloseCode.ABNORMAL_CLOSURE]
