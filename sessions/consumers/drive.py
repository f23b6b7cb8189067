"""The page's WebSocket: decode, ask, perform. The rules are in authorization.py, the session's part
in page_session.py.
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

from robots import log_ids
from robots.api import picture
from robots.api.messages import Action, ActionStatus, Message, Say
from robots.bridge.delivery import LINK, ReceivedMessage
from robots.ice import IceCredentials
from sessions import page_channel, protocol
from sessions.audience.audience import audience_of
from sessions.consumers import queries, relay, waiting_chat
from sessions.consumers.authorization import (
    Authorization,
    Effect,
    Publish,
    ReportFrame,
    Spare,
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
    """One page at one robot. Until the page is let in there is no visit, and whatever it says is
    ignored.
    """

    page_session: PageSession | None = None

    # --- coming and going -------------------------------------------------------------------------

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
        self.sparing = relay.Sparing()
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
        self._launch(self._keep_time(self.page_session))
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
        """Leave without ending the visit: its drive may live on the data channel."""
        if self.page_session is None:
            return
        stop = self.authorization.parting_stop(
            uuid.uuid4().hex, time.time(), self.known.lease, time.monotonic()
        )
        if stop is not None:
            self.bridge.send_stop(self.name, stop)
        self._stop_listening()
        await self.page_session.page_gone(code)
        log.info(
            "page_left",
            robot=self.name,
            code=code,
            refused=dict(self.authorization.refused),
            dropped=self.sender.queue.dropped,
        )

    async def _gone(self) -> None:
        await super()._gone()
        if self.page_session is not None:
            self.page_session.forget()

    def _stop_listening(self) -> None:
        super()._stop_listening()
        if self.page_session is not None:
            # a connection to the robot lives without this socket, and nobody would look after it
            self.page_session.stop_watching()
            part(self.name, self.page_session)
            self.page_session.audience.part(self.page_session)
            self.peers.changed()

    # --- what the page says -----------------------------------------------------------------------

    def _do(self, effect: Effect) -> None:
        assert self.page_session is not None
        match effect:
            case ReportFrame(message):
                self.bridge.report(protocol.page_reports(message.session), message)
            case ToSfu(message):
                self.page_session.tell_sfu(message)
            case Spare(direct):
                self.sparing.direct = direct
            case Write(message):
                self._launch(self._write(message), "command/action")
            case TellAudience():
                self._tell_audience(effect)

    async def _write(self, action: Say) -> None:
        """Bring what the first in the queue of a stopped robot writes to the people there."""
        session, first = self.authorization.session, None
        if waiting_chat.is_open(self.known, time.monotonic()):
            first = await query(waiting_chat.first_waiting, self.name, timezone.now())
        if session is None or first is None or first[0] != session:
            denied = self.authorization.deny("command/action", "not_driver", time.monotonic())
            self._perform(denied)
            return
        who = self.authorization.who
        await waiting_chat.write(self.name, session, action, by="driver", who=who)
        done = ActionStatus(
            action_id=action.action_id, status="FINISHED", stamp=time.time(), type="say"
        )
        self.sender.post("action", done)

    def _tell_audience(self, effect: TellAudience) -> None:
        by_operator = isinstance(effect.message, protocol.MarkQuestion | protocol.LowerHands)
        if by_operator and not self.authorization.holds(self.known.lease):
            self._launch(
                self._do_as_operator(
                    effect.suffix,
                    lambda: self.authorization.moderates(self.known.lease),
                    lambda: self._change_audience(effect),
                ),
                effect.suffix,
            )
        else:
            self._change_audience(effect)

    def _change_audience(self, effect: TellAudience) -> None:
        assert self.page_session is not None
        if reason := self.page_session.tell_audience(effect.message):
            self._perform(self.authorization.deny(effect.suffix, reason, time.monotonic()))

    def _publish(self, publish: Publish) -> None:
        match publish:
            case Publish(message=Action(role="owner" | "staff")):
                self._launch(
                    self._do_as_operator(
                        publish.suffix,
                        lambda: self.authorization.operator is not None,
                        functools.partial(super()._publish, publish),
                    ),
                    publish.suffix,
                )
            case _:
                super()._publish(publish)

    async def _do_as_operator(
        self, suffix: str, may: Callable[[], bool], do: Callable[[], None]
    ) -> None:
        """Do what somebody asks who operates the robot, if they still may: that may be over since
        the page came.
        """
        assert self.page_session is not None
        async with self.page_session.turn:
            if await self.page_session.still_welcome() and may():
                do()
            else:
                self._perform(self.authorization.deny(suffix, "not_allowed", time.monotonic()))

    def _ask(self, suffix: str, verb: Message) -> None:
        assert self.page_session is not None
        if self.page_session.waiting_verbs < MAX_WAITING_VERBS:
            self._launch(self.page_session.do(verb), suffix)
        else:
            self._perform(self.authorization.deny(suffix, "busy", time.monotonic()))

    # --- what the robot says ----------------------------------------------------------------------

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Take a message of the bridge, with this page's ids in the lines of the log."""
        token = log_ids.bind(self.ids)
        try:
            self._handle_message(inbound)
        finally:
            log_ids.unbind(token)

    def _handle_message(self, inbound: ReceivedMessage) -> None:
        assert self.page_session is not None
        unsure = False
        if inbound.suffix == "lease":
            unsure = self.page_session.lost_lease(inbound.message)
            if (work := self.page_session.privacy_changed()) is not None:
                self._launch(work)
        elif self._tells_connection(inbound):
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
        assert self.page_session is not None
        if self.authorization.is_shut_out(self.known.lease):
            return
        if self.page_session.moves_to_sfu(inbound):
            return
        now, by_sfu = time.monotonic(), self.authorization.by_sfu
        if (out := relay.for_driver(inbound, self.known.lease)) is not None:
            # What visitor and people at the robot write to each other, and where they point, is no
            # business of those who watch.
            if self.authorization.holds(self.known.lease) and self.sparing.passes(
                inbound.suffix, now
            ):
                self.sender.put(out)
        elif (
            self.sparing.passes(inbound.suffix, now, by_sfu=by_sfu)
            and (out := relay.relayed(inbound, self.authorization.peer)) is not None
        ):
            self.sender.put(out)

    # --- what Django code says --------------------------------------------------------------------

    def _take_event(self, event: page_channel.Event) -> None:
        assert self.page_session is not None
        if event.get("session") not in {None, self.authorization.session}:
            return
        if event["type"] == page_channel.NOTICE:
            self.page_session.handle_notice(event["frame"])
        elif event["type"] == page_channel.WORDS:
            self.sender.put(relay.Outgoing(event["frame"]))
        else:
            at_once = event.get("session") is not None or self.authorization.session is not None
            self._launch(self._look_again(0.0 if at_once else random.random() * SPREAD_SECONDS))

    async def _look_again(self, pause: float) -> None:
        """Find out whether the page may stay, and where its session stands; those who only watch a
        robot do not ask all at once.
        """
        assert self.page_session is not None
        await asyncio.sleep(pause)
        async with self.page_session.turn:
            welcome = await self.page_session.still_welcome()
        if welcome:
            await self.page_session.confirm()

    # --- what time brings -------------------------------------------------------------------------

    async def _keep_time(self, page_session: PageSession) -> None:
        """Say every few seconds that the page is open, and every minute ask whether it may stay."""
        # Pages that came together do not ask together from then on.
        asked = time.monotonic() - random.random() * WELCOME_EVERY / 2
        pause = random.random() * PAGE_SEEN_EVERY
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
