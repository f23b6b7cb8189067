"""A client of Janus' own protocol: one WebSocket, one session, and handles of plug-ins in it.

https://janus.conf.meetecho.com/docs/rest.html and websockets.html: a request has a transaction,
which its answer repeats; an asynchronous request gets `ack` at once and `event` when it is done.
When the WebSocket closes, Janus ends the session and every handle in it.
"""

import asyncio
import contextlib
import secrets
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

ANSWER_SECONDS = 5.0
MAX_ANSWER = 256 * 1024  # bytes
# Events of a handle: its peer connection is up, has ended, or the handle itself has.
UP, HANGUP, DETACHED = "webrtcup", "hangup", "detached"
OnEvent = Callable[[str, str], None]


class JanusError(Exception):
    """Janus, or a plug-in of it, refused a request; `code` is theirs."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(f"{reason} ({code})")
        self.code = code


class JanusLostError(Exception):
    """Janus cannot be reached, closed the connection, or does not answer."""


@dataclass(frozen=True)
class PluginAnswer:
    """The answer of a plug-in, with its session description, if any."""

    data: dict[str, Any]
    sdp: str | None = None


@dataclass(frozen=True)
class Handle:
    """One attachment to a plug-in, with at most one peer connection."""

    session: "JanusSession"
    number: int

    async def ask(
        self, body: dict[str, Any], *, kind: str = "answer", sdp: str | None = None
    ) -> PluginAnswer:
        """Send the plug-in a request, optionally with a session description of `kind`.

        Raises:
            JanusError: it is refused.
            JanusLostError: there is no answer.
        """
        jsep = {} if sdp is None else {"jsep": {"type": kind, "sdp": sdp}}
        answer = await self.session.request("message", self.number, body=body, **jsep)
        data = answer.get("plugindata", {}).get("data", {})
        if "error_code" in data:
            raise JanusError(data["error_code"], str(data.get("error", "")))
        return PluginAnswer(data, answer.get("jsep", {}).get("sdp"))

    async def trickle(self, candidate: dict[str, Any]) -> None:
        """Send a candidate of the other peer, without waiting for Janus' acknowledgement.

        Raises:
            JanusLostError: the connection is gone.
        """
        await self.session.send("trickle", self.number, candidate=candidate)

    async def detach(self) -> None:
        """Detach, which ends the peer connection; a handle that has ended is no error."""
        self.session.forget(self)
        with contextlib.suppress(JanusError, JanusLostError):
            await self.session.request("detach", self.number)


class JanusSession:
    """A session, which lives as long as its WebSocket; made by `open_session`."""

    def __init__(self, socket: ClientConnection, secret: str) -> None:
        self.closed = asyncio.Event()
        self._socket = socket
        self._fields: dict[str, Any] = {"apisecret": secret} if secret else {}
        self._answers: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._on_event: dict[int, OnEvent] = {}

    async def request(self, verb: str, handle: int | None = None, **fields: Any) -> dict[str, Any]:
        """Send a request and return its answer.

        Raises:
            JanusError: it is refused.
            JanusLostError: there is no answer.
        """
        transaction = secrets.token_hex(8)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._answers[transaction] = answer
        try:
            async with asyncio.timeout(ANSWER_SECONDS):
                await self.send(verb, handle, transaction=transaction, **fields)
                return await answer
        except TimeoutError as error:
            raise JanusLostError(f"no answer to {verb}") from error
        finally:
            self._answers.pop(transaction, None)

    async def send(self, verb: str, handle: int | None = None, **fields: Any) -> None:
        """Send a request without waiting for its answer.

        Raises:
            JanusLostError: the connection is gone.
        """
        message = {"janus": verb, "transaction": secrets.token_hex(8), **self._fields, **fields}
        if handle is not None:
            message["handle_id"] = handle
        try:
            if self.closed.is_set():
                raise JanusLostError("the connection is closed")
            await self._socket.send(msgspec.json.encode(message).decode())
        except (OSError, WebSocketException) as error:
            raise JanusLostError(f"{verb}: {error!r}") from error

    async def begin(self) -> None:
        """Create the session."""
        created = await self.request("create")
        self._fields["session_id"] = created["data"]["id"]

    async def attach(self, plugin: str, on_event: OnEvent | None = None) -> Handle:
        """Attach to a plug-in; `on_event` is called with (UP, HANGUP or DETACHED, the reason)."""
        attached = await self.request("attach", plugin=f"janus.plugin.{plugin}")
        handle = Handle(self, attached["data"]["id"])
        if on_event is not None:
            self._on_event[handle.number] = on_event
        return handle

    def forget(self, handle: Handle) -> None:
        """Stop reporting events of a handle."""
        self._on_event.pop(handle.number, None)

    async def listen(self) -> None:
        """Receive messages until the connection ends."""
        try:
            async for frame in self._socket:
                self._take(msgspec.json.decode(frame))
        except (OSError, WebSocketException, msgspec.DecodeError):
            pass  # ends the connection, like an orderly close
        finally:
            self.closed.set()
            for answer in self._answers.values():
                if not answer.done():
                    answer.set_exception(JanusLostError("the connection was lost"))

    def _take(self, message: dict[str, Any]) -> None:
        answer = self._answers.get(message.get("transaction", ""))
        kind = message["janus"]
        if answer is not None and kind != "ack" and not answer.done():
            if kind == "error":
                error = message["error"]
                answer.set_exception(JanusError(error["code"], error["reason"]))
            else:
                answer.set_result(message)
        elif kind in {UP, HANGUP, DETACHED}:
            on_event = self._on_event.get(message.get("sender", 0))
            if on_event is not None:
                on_event(kind, str(message.get("reason", "")))


@contextlib.asynccontextmanager
async def open_session(url: str, secret: str) -> AsyncIterator[JanusSession]:
    """Connect to Janus and create a session, which ends with the block.

    Raises:
        JanusLostError: it cannot be reached.
        JanusError: it refuses, for instance the secret.
    """
    try:
        socket = await connect(
            url,
            subprotocols=[Subprotocol("janus-protocol")],
            open_timeout=ANSWER_SECONDS,
            close_timeout=1.0,
            max_size=MAX_ANSWER,
        )
    except (OSError, TimeoutError, WebSocketException) as error:
        raise JanusLostError(f"{url}: {error!r}") from error
    session = JanusSession(socket, secret)
    listening = asyncio.ensure_future(session.listen())
    try:
        await session.begin()
        yield session
    finally:
        await socket.close()
        await listening
