"""The WebSocket of a page at one robot: the common part of the drive page, a hidden operator's page
and the robot's own display. Each has its own authorization, which decides about every frame; the
consumer carries out the decision.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import structlog
from django.db import DatabaseError, InterfaceError

from robots.api.messages import Action, Bye, Message, Stay
from robots.bridge import bridge
from robots.bridge.delivery import FAULTS, LINK, ReceivedMessage
from sessions import protocol
from sessions.backpressure import IS_FULL, never_full
from sessions.consumers import relay
from sessions.consumers.authorization import Close, DenyFrame, Effect, Halt, Publish, Verb
from sessions.consumers.base import DirectConsumer
from sessions.consumers.sender import Sender

log = structlog.stdlib.get_logger(__name__)

POLL_INTERVAL_S = 2.0  # of the session at the robot
WELCOME_EVERY = 60.0  # s between two checks whether a page may stay


class RobotPageConsumer(DirectConsumer):
    """One page at one robot. Until it is admitted it has no authorization, and its frames are
    ignored.
    """

    authorization: Any = None  # a PageAuthorization
    name: str

    # --- from connecting to closing ---------------------------------------------------------------

    async def connect(self) -> None:
        """Admit the page, or close with a code, which only an accepted socket can carry.

        The socket is accepted after the database has answered: until then daphne reads no frames.
        """
        try:
            refusal = await self._enter()
        except (DatabaseError, InterfaceError) as error:
            log.warning("page_not_let_in", reason=str(error))
            await self.close()  # as an HTTP response, after which the page retries
            return
        await self.accept()
        if refusal is None:
            self._register()
        else:
            await self.close(refusal)

    async def _enter(self) -> int | None:
        """Read what `_register` needs from the database; return the close code of a page that is
        not admitted.
        """
        raise NotImplementedError

    def _register(self) -> None:
        """Start to serve an admitted page."""
        raise NotImplementedError

    def _join(self, *, needs: bool = True) -> None:
        """Subscribe to the robot; with `needs` it sends at its full rate while the page is open."""
        self.tasks: set[asyncio.Task[Any]] = set()
        self.presence: protocol.RobotPresence | None = None
        self.bridge = bridge.current()
        self.known = self.bridge.listen(self.name, self, needs=needs)
        self.sender = Sender(self._send_frame, self.close, self.scope.get(IS_FULL, never_full))

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve the connection, and clean up however it ends: Channels does not call `disconnect`
        after an exception.
        """
        try:
            await super().__call__(scope, receive, send)
        finally:
            if self.authorization is not None:
                await self._clean_up()

    async def _clean_up(self) -> None:
        """Cancel the page's tasks and subscriptions."""
        for task in self.tasks:
            task.cancel()
        self._stop_listening()

    def _stop_listening(self) -> None:
        self.sender.abandon()
        self.bridge.ignore(self.name, self)

    # --- frames of the page -----------------------------------------------------------------------

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Authorize a frame, and carry out the decision."""
        if self.authorization is None or self.sender.closed:
            return
        frame = text_data if text_data is not None else bytes_data or b""
        suffix = frame.partition("\n")[0][:80] if isinstance(frame, str) else ""
        with self._guarded(suffix):
            effects = self.authorization.receive(frame, self.known.lease, time.monotonic())
            self._perform(effects)
            if any(isinstance(effect, Verb) for effect in effects):
                # starts the verb before the next frame, which may be the last
                await asyncio.sleep(0)

    def _perform(self, effects: tuple[Effect, ...]) -> None:
        for effect in effects:
            match effect:
                case Publish():
                    self._publish(effect)
                case Halt(message):
                    self.bridge.send_stop(self.name, message)
                case Verb(suffix, message):
                    self._ask(suffix, message)
                case DenyFrame(suffix, reason):
                    self.sender.post("denied", protocol.Denied(suffix=suffix, reason=reason))
                case Close(code):
                    self.sender.end(code)
                case _:
                    self._do(effect)

    def _deny(self, suffix: str, reason: str) -> None:
        self._perform(self.authorization.deny(suffix, reason, time.monotonic()))

    def _ask(self, suffix: str, verb: Message) -> None:
        """Carry out a verb."""

    def _do(self, effect: Effect) -> None:
        """Carry out an effect of this kind of page alone."""

    def _publish(self, publish: Publish) -> None:
        message = publish.message
        if isinstance(message, Action) and message.role != "driver":
            # The robot knows the clocks of the driver, by heartbeats, and of the server.
            message = msgspec.structs.replace(message, stamp=time.time())
        reached = self.known.online is not False and self.bridge.send(
            self.name, publish.suffix, message
        )
        if publish.wanted and not reached:
            is_signal = publish.suffix.startswith(protocol.SIGNAL)
            suffix = protocol.SIGNAL if is_signal else publish.suffix
            self._deny(suffix, "robot_unreachable")

    def _signal(self, signal: Bye | Stay) -> None:
        self.bridge.send(self.name, f"{protocol.SIGNAL}/{self.authorization.peer}", signal)

    # --- messages to the page ---------------------------------------------------------------------

    def _handle_connection(self, inbound: ReceivedMessage) -> bool:
        """Report faults, and changes of the robot's presence, to the page; return whether the
        message was about either.
        """
        if inbound.suffix == FAULTS:
            self.sender.put(relay.status(inbound.message, self.known, time.monotonic()))
            return True
        if inbound.suffix not in {LINK, "connection"}:
            return False
        presence = relay.presence(self.known, link=inbound.message is not False)
        if presence is not None and presence != self.presence:
            self.presence = presence
            self.sender.post("robot", presence)
        return True

    async def _send_frame(self, frame: str | bytes) -> None:
        if isinstance(frame, bytes):
            await self.send(bytes_data=frame)
        else:
            await self.send(text_data=frame)

    # --- regular work -----------------------------------------------------------------------------

    async def _keep_looking(
        self,
        changed: asyncio.Event,
        look: Callable[[], Awaitable[None]],
        welcome: Callable[[], Awaitable[bool]],
    ) -> None:
        """Call `look` whenever `changed` is set and every POLL_INTERVAL_S. Every minute check
        whether the page may stay, and confirm it to the robot.
        """
        asked = time.monotonic()
        while True:
            try:
                async with asyncio.timeout(POLL_INTERVAL_S):
                    await changed.wait()
            except TimeoutError:
                pass
            changed.clear()
            with self._guarded():
                await look()
                if time.monotonic() - asked >= WELCOME_EVERY:
                    asked = time.monotonic()
                    if await welcome():
                        self._signal(Stay())
                    else:
                        self.sender.end(protocol.NOT_ALLOWED)

    def _launch(self, work: Coroutine[Any, Any, None], suffix: str = "") -> None:
        """Run `work` concurrently with further frames. If it fails, the page receives `denied` for
        `suffix`.
        """
        task = asyncio.get_running_loop().create_task(self._finish(work, suffix))
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    async def _finish(self, work: Coroutine[Any, Any, None], suffix: str) -> None:
        with self._guarded(suffix):
            await work

    @contextmanager
    def _guarded(self, suffix: str = "") -> Iterator[None]:
        """Log an exception, and send `denied` for the page's `suffix`."""
        try:
            yield
        except (DatabaseError, InterfaceError) as error:
            log.warning("page_failed", robot=self.name, suffix=suffix, reason=str(error))
        except Exception:  # the page's next frame may be a stop
            log.exception("page_failed", robot=self.name, suffix=suffix)
        else:
            return
        if suffix:
            self.sender.post("denied", protocol.Denied(suffix=suffix, reason="unavailable"))
