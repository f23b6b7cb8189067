"""A WebSocket as a client has it (RFC 6455), in as many lines as a bot needs: no extension, whole
messages, nothing to install.
"""

import asyncio
import base64
import contextlib
import hashlib
import secrets
import urllib.parse
from collections.abc import Mapping

GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10
FINAL, MASKED, LENGTH = 0x80, 0x80, 0x7F
TWO_BYTES, EIGHT_BYTES = 126, 127
LARGEST = 4 * 1024 * 1024
OPEN_SECONDS = 30.0
SWITCHING = b" 101 "


class SocketClosed(Exception):
    """The connection is over; `code` is what the server said, 1006 when it said nothing."""

    def __init__(self, code: int, reason: str = "") -> None:
        super().__init__(f"{code} {reason}".strip())
        self.code = code


class Socket:
    """One open connection. `send` does not wait; `receive` returns text or bytes."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @classmethod
    async def connect(cls, url: str, headers: Mapping[str, str]) -> "Socket":
        """Open a connection to `http://host:port/path` or `https://…`.

        Raises:
            SocketClosed: the server does not want it.
            OSError: it cannot be reached.
        """
        parts = urllib.parse.urlsplit(url)
        secure = parts.scheme in {"https", "wss"}
        port = parts.port or (443 if secure else 80)
        async with asyncio.timeout(OPEN_SECONDS):
            reader, writer = await asyncio.open_connection(
                parts.hostname, port, ssl=secure or None, limit=LARGEST
            )
            socket = cls(reader, writer)
            with contextlib.ExitStack() as unless_open:
                unless_open.callback(writer.close)
                await socket._shake_hands(parts.netloc, parts.path or "/", headers)
                unless_open.pop_all()
        return socket

    async def _shake_hands(self, host: str, path: str, headers: Mapping[str, str]) -> None:
        key = base64.b64encode(secrets.token_bytes(16))
        lines = [
            f"GET {path} HTTP/1.1",
            f"Host: {host}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
        ]
        lines += [
            f"Sec-WebSocket-Key: {key.decode()}",
            *(f"{name}: {value}" for name, value in headers.items() if value),
            "",
            "",
        ]
        self._writer.write("\r\n".join(lines).encode())
        try:
            head = await self._reader.readuntil(b"\r\n\r\n")
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            raise SocketClosed(1006, "no handshake") from error
        digest = hashlib.sha1(key + GUID).digest()  # noqa: S324 -- RFC 6455, section 4.2.2
        accept = base64.b64encode(digest)
        if SWITCHING not in head.split(b"\r\n")[0] + b" " or accept not in head:
            raise SocketClosed(1006, head.split(b"\r\n")[0].decode(errors="replace"))

    def send(self, text: str) -> None:
        """Send a message of text; one that cannot go any more is lost, as on any page that is being
        closed.
        """
        if not self._writer.is_closing():
            self._writer.write(_frame(TEXT, text.encode()))

    async def receive(self) -> str | bytes:
        """Return the next message; pings are answered meanwhile.

        Raises:
            SocketClosed: there will be none.
        """
        kind, whole = 0, b""
        while True:
            try:
                code, final, payload = await self._read()
            except (asyncio.IncompleteReadError, ConnectionError) as error:
                raise SocketClosed(1006) from error
            if code == CLOSE:
                self._writer.close()
                raise SocketClosed(
                    int.from_bytes(payload[:2], "big") if payload else 1005,
                    payload[2:].decode(errors="replace"),
                )
            if code == PING:
                self._writer.write(_frame(PONG, payload))
            elif code != PONG:
                kind, whole = code or kind, whole + payload
                if final:
                    return whole.decode() if kind == TEXT else whole

    async def _read(self) -> tuple[int, bool, bytes]:
        first, second = await self._reader.readexactly(2)
        length = second & LENGTH
        if length == TWO_BYTES:
            length = int.from_bytes(await self._reader.readexactly(2), "big")
        elif length == EIGHT_BYTES:
            length = int.from_bytes(await self._reader.readexactly(8), "big")
        if length > LARGEST:
            raise SocketClosed(1009, "too large")
        return first & 0x0F, bool(first & FINAL), await self._reader.readexactly(length)

    def abort(self) -> None:
        """Be gone without a word, as a network that is cut."""
        self._writer.transport.abort()

    async def close(self) -> None:
        """Say goodbye."""
        if not self._writer.is_closing():
            self._writer.write(_frame(CLOSE, (1001).to_bytes(2, "big")))
            self._writer.close()
        with contextlib.suppress(OSError):
            await self._writer.wait_closed()


def _frame(code: int, payload: bytes) -> bytes:
    """Return a frame of a client, which masks what it says (section 5.3)."""
    mask = secrets.token_bytes(4)
    size = len(payload)
    if size < TWO_BYTES:
        head = bytes([FINAL | code, MASKED | size])
    elif size < 1 << 16:
        head = bytes([FINAL | code, MASKED | TWO_BYTES]) + size.to_bytes(2, "big")
    else:
        head = bytes([FINAL | code, MASKED | EIGHT_BYTES]) + size.to_bytes(8, "big")
    stream = mask * (size // 4 + 1)
    masked = (int.from_bytes(payload, "big") ^ int.from_bytes(stream[:size], "big")).to_bytes(
        size, "big"
    )
    return head + mask + masked
