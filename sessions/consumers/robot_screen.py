"""The WebSocket of a robot's own display; its permissions are in screen_authorization.py."""

import asyncio
import secrets
import time

import structlog
from django.utils import timezone

from robots.api.messages import Bye, Say
from robots.bridge.delivery import ReceivedMessage
from robots.ice import IceCredentials
from robots.process import log_ids
from robots.screens import cookie_of, screen_of
from sessions import page_channel, protocol
from sessions.audience.audience import audience_of
from sessions.consumers import relay, waiting_chat
from sessions.consumers.authorization import Publish
from sessions.consumers.database import query
from sessions.consumers.robot_page import RobotPageConsumer
from sessions.consumers.screen_authorization import ScreenAuthorization
from sessions.leases import store

log = structlog.stdlib.get_logger(__name__)


class ScreenConsumer(RobotPageConsumer):
    """One display of one robot, admitted by its key."""

    authorization: ScreenAuthorization

    async def _enter(self) -> int | None:
        self.name = self.scope["url_route"]["kwargs"]["robot"]
        log_ids.bind(lambda: {"robot": self.name})  # until the end of this socket's own task
        self.key = self.scope.get("cookies", {}).get(cookie_of(self.name), "")
        self.robot = await query(screen_of, self.name, self.key)
        return protocol.NOT_ALLOWED if self.robot is None else None

    def _register(self) -> None:
        robot = self.robot
        assert robot is not None
        self.title, self.titles = robot.title or robot.name, robot.titles
        self._join(needs=False)  # a display is always open, also at an idle robot
        self.authorization = ScreenAuthorization(
            secrets.token_urlsafe(12), self.title, ice_servers=IceCredentials(self.name)
        )
        self.shown: protocol.Screen | None = None
        self.asked = protocol.AudienceState()
        self.audience = audience_of(self.name, self.bridge)
        self.study = ("", False)
        # session and name of the first visitor who waits for a stopped robot
        self.waiting: tuple[str, str] | None = None
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
        self.audience.join(self)
        self.visitor_changed.set()
        look, welcome = self._send_to_visitor, self._is_welcome
        self._launch(self._keep_looking(self.visitor_changed, look, welcome))
        self._launch(page_channel.listen((page_channel.screen_group(self.name),), self._take_words))
        log.info("screen_joined", robot=self.name)

    async def _clean_up(self) -> None:
        # the connection to the robot would outlive this socket
        self._signal(Bye(reason="left"))
        await super()._clean_up()
        self.audience.part(self)
        log.info("screen_left", robot=self.name, refused=dict(self.authorization.refused))

    def _publish(self, publish: Publish) -> None:
        if isinstance(publish.message, Say) and self.waiting is not None:
            words = waiting_chat.write(
                self.name, self.waiting[0], publish.message, by="screen", who=self.title
            )
            self._launch(words, "command/action")
        else:
            super()._publish(publish)

    # --- messages to the display ------------------------------------------------------------------

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Handle a message of the bridge."""
        if self._handle_connection(inbound):
            return
        if (shown := relay.for_screen(inbound)) is not None:
            self.sender.put(shown)
        elif inbound.suffix == "lease":
            self.visitor_changed.set()
        elif (
            out := relay.relayed(inbound, self.authorization.peer)
        ) is not None and inbound.suffix.startswith(protocol.SIGNAL):
            self.sender.put(out)

    def _take_words(self, event: page_channel.Event) -> None:
        if self.waiting is not None and event["session"] == self.waiting[0]:
            self.sender.put(relay.Outgoing(event["frame"]))

    def audience_changed(self) -> None:
        """Send the display the question that is being answered, if it has changed."""
        asked = self.audience.board.view("")
        if asked != self.asked:
            self.asked = asked
            self.sender.post("audience", asked)

    async def _is_welcome(self) -> bool:
        """Tell whether the key is still valid."""
        return await query(screen_of, self.name, self.key) is not None

    async def _send_to_visitor(self) -> None:
        lease = self.known.lease_at(time.monotonic())
        if lease is not None and self.study[0] != lease.session:
            self.study = (lease.session, await query(store.is_study, lease.session))
        waiting = None
        if waiting_chat.is_open(self.known, time.monotonic()):
            waiting = await query(waiting_chat.first_waiting, self.name, timezone.now())
        self.waiting = waiting  # set at once: chat is handled during the query
        shown = protocol.Screen(
            title=self.title,
            titles=self.titles,
            session=lease.session if lease else None,
            visitor=lease.who if lease else None,
            waiting=self.waiting[1] if self.waiting is not None else None,
            study=lease is not None and self.study[1],
            ice_servers=self.authorization.ice_servers(),
        )
        if shown != self.shown:
            self.shown = shown
            self.sender.post("screen", shown)
