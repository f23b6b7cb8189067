"""The WebSocket of a robot's own display: decode, ask, perform. Its rules stand in
sessions/consumers/screen_authorization.py.
"""

import asyncio
import secrets
import time
from typing import Any

import msgspec
import structlog
from channels.db import database_sync_to_async
from django.db import DatabaseError, InterfaceError

from robots import log_ids
from robots.api.messages import Action, Bye, Stay
from robots.bridge import bridge
from robots.bridge.delivery import LINK, ReceivedMessage
from robots.ice import ice_servers
from robots.models import Robot
from robots.screens import cookie_of, screen_of
from sessions import protocol
from sessions.consumers import relay
from sessions.consumers.authorization import Close, DenyFrame, Effect, Halt, Publish
from sessions.consumers.backpressure import IS_FULL, never_full
from sessions.consumers.base import DirectConsumer
from sessions.consumers.screen_authorization import ScreenAuthorization
from sessions.consumers.sender import Sender
from sessions.leases.terms import of as terms_of
from sessions.models import Session

log = structlog.stdlib.get_logger(__name__)

POLL_INTERVAL_S = 2.0  # s between two looks at a lease that may have run out
WELCOME_EVERY = 60.0  # s between two looks at the key


class ScreenConsumer(DirectConsumer):
    """One display of one robot. Until its key was found right there is no room, and whatever it
    says is ignored.
    """

    authorization: ScreenAuthorization | None = None

    async def connect(self) -> None:
        """Let the display in, or close with the reason: a code can only be told to a page whose
        socket was accepted.
        """
        await self.accept()
        self.name = self.scope["url_route"]["kwargs"]["robot"]
        log_ids.bind(lambda: {"robot": self.name})  # until the end of this socket's own task
        self.key = self.scope.get("cookies", {}).get(cookie_of(self.name), "")
        robot = await database_sync_to_async(screen_of)(self.name, self.key)
        if robot is None:
            await self.close(protocol.NOT_ALLOWED)
            return
        self._register(robot)

    def _register(self, robot: Robot) -> None:
        self.title, self.titles = robot.title or robot.name, robot.titles
        self.bridge = bridge.current()
        # a display is always there: it asks no idle robot to speak more
        self.known = self.bridge.listen(self.name, self, needs=False)
        self.authorization = ScreenAuthorization(
            secrets.token_urlsafe(12), self.title, ice_servers(self.name, time.time())
        )
        self.sender = Sender(self._send_frame, self.close, self.scope.get(IS_FULL, never_full))
        self.shown: protocol.Screen | None = None
        self.study = ("", False)
        self.visitor_changed = asyncio.Event()
        hello = protocol.Hello(
            peer=self.authorization.peer,
            stamp=time.time(),
            robot=self.name,
            online=self.known.online is True,
            may_drive=False,
            may_observe=False,
        )
        self.sender.post("hello", hello)
        self.visitor_changed.set()
        self.looking = asyncio.get_running_loop().create_task(self._tick())
        log.info("screen_joined", robot=self.name)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Live from the first to the last frame, and leave nothing behind however it ends."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            if self.authorization is not None:
                self.looking.cancel()
                self.sender.abandon()
                # a connection to the robot lives without this socket
                self._publish_to_robot(Bye(reason="left"))
                self.bridge.ignore(self.name, self)
                log.info("screen_left", robot=self.name, refused=dict(self.authorization.refused))

    # --- what the display says --------------------------------------------------------------------

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Decide about a frame and do what was decided."""
        if self.authorization is not None and not self.sender.closed:
            frame = text_data if text_data is not None else bytes_data or b""
            self._perform(
                self.authorization, self.authorization.receive(frame, None, time.monotonic())
            )

    def _perform(self, authorization: ScreenAuthorization, effects: tuple[Effect, ...]) -> None:
        for effect in effects:
            match effect:
                case Publish(suffix, message, wanted):
                    # The robot knows the server's clock, and not the display's.
                    stamped = (
                        msgspec.structs.replace(message, stamp=time.time())
                        if isinstance(message, Action)
                        else message
                    )
                    reachable = self.known.online is not False and self.bridge.send(
                        self.name, suffix, stamped
                    )
                    if wanted and not reachable:
                        self._perform(
                            authorization,
                            authorization.deny(suffix, "robot_unreachable", time.monotonic()),
                        )
                case Halt(message):
                    self.bridge.send_stop(self.name, message)
                case DenyFrame(suffix, reason):
                    self.sender.post("denied", protocol.Denied(suffix=suffix, reason=reason))
                case Close(code):
                    self.sender.end(code)

    # --- what the display is told -----------------------------------------------------------------

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Take a letter from the bridge."""
        assert self.authorization is not None
        if inbound.suffix in {LINK, "connection"}:
            presence = relay.presence(
                self.known, link=inbound.message is not False if inbound.suffix == LINK else True
            )
            if presence is not None:
                self.sender.post("robot", presence)
        elif (shown := relay.for_screen(inbound)) is not None:
            self.sender.put(shown)
        elif inbound.suffix == "lease":
            self.visitor_changed.set()
        elif (
            out := relay.relayed(inbound, self.authorization.peer)
        ) is not None and inbound.suffix.startswith(protocol.SIGNAL):
            self.sender.put(out)

    async def _tick(self) -> None:
        """Say who visits whenever that changes, and ask every minute whether the key is still
        right.
        """
        asked = time.monotonic()
        while True:
            try:
                async with asyncio.timeout(POLL_INTERVAL_S):
                    await self.visitor_changed.wait()
            except TimeoutError:
                pass
            self.visitor_changed.clear()
            try:
                await self._send_to_visitor()
                if time.monotonic() - asked >= WELCOME_EVERY:
                    asked = time.monotonic()
                    if await database_sync_to_async(screen_of)(self.name, self.key) is None:
                        self.sender.end(protocol.NOT_ALLOWED)
                    else:
                        self._publish_to_robot(Stay())
            except (DatabaseError, InterfaceError) as error:
                log.warning("screen_not_checked", robot=self.name, reason=str(error))

    def _publish_to_robot(self, signal: Bye | Stay) -> None:
        if self.authorization is not None:
            self.bridge.send(self.name, f"{protocol.SIGNAL}/{self.authorization.peer}", signal)

    async def _send_to_visitor(self) -> None:
        lease = self.known.lease_at(time.monotonic())
        if lease is not None and self.study[0] != lease.session:
            self.study = (lease.session, await database_sync_to_async(_is_study)(lease.session))
        shown = protocol.Screen(
            title=self.title,
            titles=self.titles,
            session=lease.session if lease else None,
            visitor=lease.who if lease else None,
            study=lease is not None and self.study[1],
            ice_servers=self.authorization.ice_servers if self.authorization else (),
        )
        if shown != self.shown:
            self.shown = shown
            self.sender.post("screen", shown)

    async def _send_frame(self, frame: str | bytes) -> None:
        assert isinstance(frame, str)
        await self.send(text_data=frame)


def _is_study(session: str) -> bool:
    """Tell whether a visit belongs to a study, of which the people at the robot are told."""
    row = Session.objects.filter(pk=session).first()
    return row is not None and bool(terms_of(row).study)
