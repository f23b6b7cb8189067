"""Requests that are refused before they reach Django."""

import asyncio
from types import SimpleNamespace

import pytest

from telepresence_site.web.asgi_limits import (
    CONNECTS_AT_ONCE,
    BodyLimit,
    ConnectLimit,
    OpenLimit,
    SameOrigin,
    address_of,
    is_same,
    user_of,
)


async def sends(limit: int, parts: list[bytes], headers: tuple = ()) -> tuple[list[dict], int]:
    """Post parts of a body; return the answer and how many bytes the application has read."""
    sent, read = [], 0
    waiting = [
        {"type": "http.request", "body": part, "more_body": n + 1 < len(parts)}
        for n, part in enumerate(parts)
    ]

    async def application(_scope, receive, send):
        nonlocal read
        while True:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            read += len(message["body"])
            if not message["more_body"]:
                await send({"type": "http.response.start", "status": 200})
                return

    async def receive():
        return waiting.pop(0)

    async def send(message):
        sent.append(message)

    await BodyLimit(application, limit)({"type": "http", "headers": headers}, receive, send)
    return sent, read


async def test_a_body_that_fits_is_read_to_its_end():
    sent, read = await sends(10, [b"12345", b"67890"])
    assert (sent[0]["status"], read) == (200, 10)


async def test_a_body_with_too_large_a_content_length_is_refused_unread():
    sent, read = await sends(10, [b"1"], headers=((b"Content-Length", b"11"),))
    assert (sent[0]["status"], read) == (413, 0)


async def test_a_body_that_grows_too_large_is_refused_once_and_read_no_further():
    sent, read = await sends(10, [b"12345678", b"9012", b"3"])
    assert [message.get("status") for message in sent] == [413, None]
    assert read == 8


async def test_an_invalid_content_length_does_not_evade_the_limit():
    sent, read = await sends(4, [b"12345"], headers=((b"content-length", b"-1"),))
    assert (sent[0]["status"], read) == (413, 0)


async def opens(
    origin: bytes | None,
    host: bytes = b"robots.example",
    trusted: tuple[str, ...] = (),
    *,
    secure_only: bool = False,
) -> bool:
    """Tell whether a page of this origin may open a WebSocket."""
    opened = []

    async def application(_scope, _receive, _send):
        opened.append(True)

    async def send(_message):
        pass

    headers = [(b"host", host), *([(b"origin", origin)] if origin is not None else [])]
    await SameOrigin(application, list(trusted), secure_only=secure_only)(
        {"type": "websocket", "headers": headers}, None, send
    )
    return bool(opened)


async def test_a_page_of_the_same_host_and_port_opens_a_socket():
    assert await opens(b"https://robots.example")
    assert await opens(b"HTTPS://Robots.Example", b"robots.example:443")
    assert await opens(b"http://127.0.0.1:8000", b"127.0.0.1:8000")


@pytest.mark.parametrize(
    "origin",
    [
        None,
        b"",
        b"null",
        b"https://robots.example:8443",
        b"http://robots.example:8000",
        b"https://evil.example",
        b"https://robots.example.evil.example",
        b"https://evil.example#robots.example",
        b"file://",
        b"https://robots.example:port",
    ],
)
async def test_a_page_of_another_origin_or_port_opens_no_socket(origin):
    assert not await opens(origin)


async def test_a_trusted_origin_opens_a_socket():
    assert await opens(b"https://other.example", trusted=("https://other.example",))


async def test_a_site_with_https_only_refuses_pages_from_plain_http():
    assert await opens(b"https://robots.example", secure_only=True)
    assert await opens(b"HTTPS://127.0.0.1:8443", b"127.0.0.1:8443", secure_only=True)
    assert not await opens(b"http://robots.example", secure_only=True)
    assert not await opens(b"http://robots.example:8443", b"robots.example:8443", secure_only=True)
    assert await opens(b"http://other.example", trusted=("http://other.example",), secure_only=True)
    assert await opens(b"http://robots.example")


def test_ipv6_hosts_are_compared():
    assert is_same("http://[::1]:8000", "[::1]:8000")
    assert not is_same("http://[::1]:8000", "[::2]:8000")


async def test_an_address_that_opens_too_many_sockets_is_refused_for_a_while_and_no_other():
    accepted = []
    clock = [0.0]

    async def application(scope, _receive, _send):
        accepted.append(scope["client"][0])

    async def send(_message):
        pass

    async def connect(address: str, times: int = 1, forwarded: str = "") -> int:
        """Return how many connections are accepted."""
        accepted.clear()
        headers = [(b"x-forwarded-for", forwarded.encode())] if forwarded else []
        scope = {"type": "websocket", "client": (address, 1), "headers": headers}
        for _ in range(times):
            await limit(scope, None, send)
        return len(accepted)

    limit = ConnectLimit(application, ["10.0.0.1"], now=lambda: clock[0])
    most = int(CONNECTS_AT_ONCE)
    assert await connect("198.51.100.7", most + 50) == most
    assert await connect("198.51.100.7", forwarded="198.51.100.8") == 0, "the client's own claim"
    assert await connect("198.51.100.8") == 1
    assert await connect("10.0.0.1", forwarded="198.51.100.7") == 0, "a trusted proxy's header"
    assert await connect("10.0.0.1", forwarded="198.51.100.9") == 1
    clock[0] = 2.0
    assert await connect("198.51.100.7", 50) == 10


class Sockets:
    """Sockets that stay open until `ends` are set."""

    def __init__(self, who, limit=2):
        self.door = OpenLimit(self._stay, limit, who)
        self.tasks, self.refused, self.ends = [], [], []

    async def _stay(self, _scope, _receive, _send):
        self.ends.append(asyncio.get_running_loop().create_future())
        await self.ends[-1]

    async def _send(self, message):
        self.refused.append(message["code"])

    async def connect(self, **scope) -> bool:
        """Open one more and tell whether it was accepted."""
        before = len(self.ends)
        self.tasks.append(
            asyncio.create_task(self.door({"type": "websocket", **scope}, None, self._send))
        )
        await asyncio.sleep(0)
        return len(self.ends) > before


async def test_an_address_may_have_a_number_of_open_sockets():
    sockets = Sockets(lambda scope: address_of(scope, ["10.0.0.1"]))
    here, there = (
        {"client": (address, 1), "headers": []} for address in ("198.51.100.7", "198.51.100.8")
    )
    proxied = {"client": ("10.0.0.1", 1), "headers": [(b"x-forwarded-for", b"198.51.100.7")]}
    asked = [await sockets.connect(**scope) for scope in (here, proxied, here, proxied)]
    assert asked == [True, True, False, False]
    assert sockets.refused == [1013, 1013]
    assert await sockets.connect(**there)
    sockets.ends[0].set_exception(ConnectionError())
    sockets.tasks[1].cancel()
    await asyncio.wait(sockets.tasks[:2])
    assert [await sockets.connect(**here) for _ in range(3)] == [True, True, False]
    for end in sockets.ends[2:]:
        end.set_result(None)
    await asyncio.gather(*sockets.tasks, return_exceptions=True)
    assert not sockets.door._open


async def test_a_user_may_have_a_number_of_open_sockets_and_guests_are_not_counted():
    sockets = Sockets(user_of)
    ada, bob, guest = (SimpleNamespace(pk=pk, is_authenticated=pk > 0) for pk in (1, 2, 0))
    assert [await sockets.connect(user=ada) for _ in range(3)] == [True, True, False]
    assert await sockets.connect(user=bob)
    assert [await sockets.connect(user=guest) for _ in range(5)] == [True] * 5
    for task in sockets.tasks:
        task.cancel()
    await asyncio.gather(*sockets.tasks, return_exceptions=True)
