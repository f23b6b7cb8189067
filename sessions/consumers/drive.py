"""The drive page's WebSocket: decode, authorize (authorization.py), perform. page_session.py has
what needs the session.
"""

import asyncio
import functools
import random
import secrets
import time
import uuid
from collections.abc import Callable

import structlog
from django.conf import settings
from django.utils import timezone

from robots.api import picture
from robots.api.messages import ActionStatus, Message, Say
from robots.bridge.delivery import LINK, ReceivedMessage
from robots.ice import IceCredentials
from robots.process import log_ids
from sessions import page_channel, protocol
from sessions.audience.audience import audience_of
from sessions.consumers import queries, relay, waiting_chat
from sessions.consumers.authorization import (
    Authorization,
    Effect,
    Publish,
    PublishAsOperator,
    ReportFrame,
    SkipDirect,
    TellAudience,
    ToSfu,
    Write,
)
from sessions.consumers.database import query
from sessions.consumers.page_session import MAX_WAITING_VERBS, PageSession
from sessions.consumers.peers import part, peers_of
from sessions.consumers.robot_page import WELCOME_EVERY, RobotPageConsumer
from sessions.devices import device_of, headers_of_scope
from sessions.leases.policy import PAGE_SEEN_EVERY

log = structlog.stdlib.get_logger(__name__)

SPREAD_SECONDS = 2.0


class RobotConsumer(RobotPageConsumer):
    """One page at one robot; its frames are ignored until it is admitted."""

    page_session: PageSession = None  # type: ignore[assignment]  # until `_register`

    # --- from connecting to closing ---------------------------------------------------------------

    async def _enter(self) -> int | None:
        user, name = self.scope["user"], self.scope["url_route"]["kwargs"]["robot"]
        if not user.is_authenticated:
            return protocol.SIGNED_OUT
        self.context = await query(queries.enter, user, name, timezone.now())
        if self.context is None:
            return protocol.NO_SUCH_ROBOT
        return None if self.context.may_enter else protocol.NOT_ALLOWED

    def _register(self) -> None:
        context = self.context
        assert context is not None
        user, self.name = self.scope["user"], context.robot.name
        self._join()
        self.authorization = Authorization(
            secrets.token_urlsafe(12),
            user.sent_name,
            context.operator,
            IceCredentials(self.name),
        )
        self.telemetry = relay.TelemetryFilter()
        self.peers = peers_of(self.name)
        self.peers.waiting, self.peers.pause = context.waiting, context.pause
        client = self.scope.get("client") or ("",)
        self.page_session = PageSession(
            robot=context.robot,
            user=user,
            session_key=self.scope["session"].session_key,
            device=device_of(headers_of_scope(self.scope), client[0], settings.TRUSTED_PROXIES),
            may_observe=bool(context.may_observe),
            authorization=self.authorization,
            known=self.known,
            bridge=self.bridge,
            peers=self.peers,
            audience=audience_of(self.name, self.bridge),
            sender=self.sender,
        )
        # until the end of this socket's own task
        log_ids.bind(lambda: {"robot": self.name, "session": self.authorization.session})
        self.ids = log_ids.captured()
        self.page_session.note_private(context.private)
        self._say_hello(context)
        self.peers.members.add(self.page_session)
        self.page_session.audience.join(self.page_session)
        self.peers.changed()
        self._launch(self._keep_time())
        groups = (page_channel.robot_group(self.name), page_channel.visitor_group(user.pk))
        self._launch(page_channel.listen(groups, self._take_event))

    def _say_hello(self, context: queries.ConnectionContext) -> None:
        online = context.online if self.known.online is None else self.known.online
        self.presence = protocol.RobotPresence(online=online)
        hello = protocol.Hello(
            peer=self.authorization.peer,
            stamp=time.time(),
            robot=self.name,
            online=online,
            may_drive=bool(context.may_drive),
            may_observe=bool(context.may_observe),
            live_elsewhere=context.live_elsewhere,
            live_since=context.live_since,
        )
        self.sender.post("hello", hello)

    async def disconnect(self, code: int) -> None:
        """Leave without ending the session: its drive may continue over the data channel."""
        if self.page_session is None:
            return
        stop = self.authorization.parting_stop(
            uuid.uuid4().hex, time.time(), self.known.lease, time.monotonic()
        )
        if stop is not None:
            self.bridge.send_stop(self.name, stop)
        self._stop_listening()
        await self.page_session.page_closed(code)
        log.info(
            "page_left",
            robot=self.name,
            code=code,
            refused=dict(self.authorization.refused),
            dropped=self.sender.queue.dropped,
        )

    async def _clean_up(self) -> None:
        await super()._clean_up()
        if self.page_session is not None:
            self.page_session.forget()

    def _stop_listening(self) -> None:
        super()._stop_listening()
        if self.page_session is not None:
            # the page's connection to the robot outlives this socket, but not its supervision
            self.page_session.stop_watching()
            part(self.name, self.page_session)
            self.page_session.audience.part(self.page_session)
            self.peers.changed()

    # --- frames of the page -----------------------------------------------------------------------

    def _do(self, effect: Effect) -> None:
        match effect:
            case PublishAsOperator(suffix, action):
                send = functools.partial(self._publish, Publish(suffix, action))
                self._launch(self._do_as_operator(suffix, self._is_operator, send), suffix)
            case ReportFrame(message):
                self.bridge.report(protocol.page_reports(message.session), message)
            case ToSfu(message):
                self.page_session.tell_sfu(message)
            case SkipDirect(direct):
                self.telemetry.direct = direct
            case Write(message):
                self._launch(self._write(message), "command/action")
            case TellAudience():
                self._tell_audience(effect)

    async def _write(self, action: Say) -> None:
        """Send a message of the first in a stopped robot's queue to the people at the robot."""
        session, first = self.authorization.session, None
        if waiting_chat.is_open(self.known, time.monotonic()):
            first = await query(waiting_chat.first_waiting, self.name, timezone.now())
        if session is None or first is None or first[0] != session:
            self._deny("command/action", "not_driver")
            return
        who = self.authorization.who
        await waiting_chat.write(self.name, session, action, by="driver", who=who)
        done = ActionStatus(
            action_id=action.action_id, status="FINISHED", stamp=time.time(), type="say"
        )
        self.sender.post("action", done)

    def _tell_audience(self, effect: TellAudience) -> None:
        by_operator = isinstance(effect.message, protocol.MarkQuestion | protocol.LowerHands)
        change = functools.partial(self._change_audience, effect)
        if by_operator and not self.authorization.holds(self.known.lease):
            doing = self._do_as_operator(effect.suffix, self._may_moderate, change)
            self._launch(doing, effect.suffix)
        else:
            change()

    def _change_audience(self, effect: TellAudience) -> None:
        if reason := self.page_session.tell_audience(effect.message):
            self._deny(effect.suffix, reason)

    def _may_moderate(self) -> bool:
        return self.authorization.moderates(self.known.lease)

    def _is_operator(self) -> bool:
        return self.authorization.operator is not None

    async def _do_as_operator(
        self, suffix: str, may: Callable[[], bool], do: Callable[[], None]
    ) -> None:
        """Carry out an operator's request, if the rights of this page's user still permit it."""
        async with self.page_session.turn:
            if await self.page_session.still_welcome() and may():
                do()
            else:
                self._deny(suffix, "not_allowed")

    def _ask(self, suffix: str, verb: Message) -> None:
        if self.page_session.waiting_verbs < MAX_WAITING_VERBS:
            self._launch(self.page_session.do(verb), suffix)
        else:
            self._deny(suffix, "busy")

    # --- messages of the robot --------------------------------------------------------------------

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Handle a message of the bridge, with this page's ids in its log lines."""
        token = log_ids.bind(self.ids)
        try:
            self._handle_message(inbound)
        finally:
            log_ids.unbind(token)

    def _handle_message(self, inbound: ReceivedMessage) -> None:
        unsure = False
        if inbound.suffix == "lease":
            unsure = self.page_session.lost_lease(inbound.message)
            if (work := self.page_session.privacy_changed()) is not None:
                self._launch(work)
        elif self._handle_connection(inbound):
            unsure = inbound.suffix == LINK and inbound.message
        elif picture.is_picture(inbound.suffix):
            if (
                isinstance(inbound.frame, bytes)
                and picture.is_for(inbound.suffix, self.authorization.peer)
                and self.authorization.may_see_picture(self.known.lease)
            ):
                self.sender.put_picture(inbound.frame)
        else:
            self._relay(inbound)
        if inbound.suffix == "lease" and self.peers.is_to_be_read(self.known, time.monotonic()):
            self._launch(self.page_session.read_peers())
        if inbound.suffix in {"lease", "state"}:
            self.page_session.peers_changed()
        if unsure:
            self._launch(self.page_session.confirm())

    def _relay(self, inbound: ReceivedMessage) -> None:
        if self.authorization.is_shut_out(self.known.lease):
            return
        if self.page_session.moves_to_sfu(inbound):
            return
        now, by_sfu = time.monotonic(), self.authorization.by_sfu
        if (out := relay.for_driver(inbound, self.known.lease)) is not None:
            # Observers do not receive the chat of visitor and people at the robot, nor where they
            # point.
            if self.authorization.holds(self.known.lease) and self.telemetry.passes(
                inbound.suffix, now
            ):
                self.sender.put(out)
        elif (
            self.telemetry.passes(inbound.suffix, now, by_sfu=by_sfu)
            and (out := relay.relayed(inbound, self.authorization.peer)) is not None
        ):
            self.sender.put(out)

    # --- events of Django code --------------------------------------------------------------------

    def _take_event(self, event: page_channel.Event) -> None:
        if event.get("session") not in {None, self.authorization.session}:
            return
        if event["type"] == page_channel.NOTICE:
            self.page_session.handle_notice(event["frame"])
        elif event["type"] == page_channel.WORDS:
            self.sender.put(relay.Outgoing(event["frame"]))
        else:
            at_once = event.get("session") is not None or self.authorization.session is not None
            self._launch(self._check_again(0.0 if at_once else random.random() * SPREAD_SECONDS))

    async def _check_again(self, pause: float) -> None:
        """Check whether the page may stay, and the status of its session, after `pause` seconds,
        which spread the queries of a robot's observers.
        """
        await asyncio.sleep(pause)
        async with self.page_session.turn:
            welcome = await self.page_session.still_welcome()
        if welcome:
            await self.page_session.confirm()

    # --- regular work -----------------------------------------------------------------------------

    async def _keep_time(self) -> None:
        """Store every few seconds that the page is open; check every minute whether it may stay."""
        # Random, so that pages which connected together do not check together.
        asked = time.monotonic() - random.random() * WELCOME_EVERY / 2
        pause, page_session = random.random() * PAGE_SEEN_EVERY, self.page_session
        while True:
            await asyncio.sleep(pause)
            pause = PAGE_SEEN_EVERY
            page_session.peers_changed()
            with self._guarded():
                await page_session.say_seen()
                if self.peers.is_to_be_read(self.known, time.monotonic()):
                    await page_session.read_peers()
                if time.monotonic() - asked >= WELCOME_EVERY:
                    asked = time.monotonic()
                    async with page_session.turn:
                        if await page_session.still_welcome():
                            page_session.vouch()
