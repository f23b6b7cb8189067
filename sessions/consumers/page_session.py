"""One page's part in a session: taking the robot, watching, leaving, and the session's end."""

import asyncio
import time
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any

import msgspec
import structlog
from django.db import DatabaseError, InterfaceError
from django.utils import timezone

from accounts.models import User
from robots.api.errors import Rejection
from robots.api.messages import Bye, Lease, Message, SdpOffer, Stay
from robots.bridge.bridge import Bridge
from robots.bridge.delivery import ReceivedMessage
from robots.bridge.known import KnownRobot
from robots.ice import ice_servers
from robots.models import Robot
from sessions import protocol
from sessions.audience.audience import Audience
from sessions.consumers import queries
from sessions.consumers.authorization import Authorization
from sessions.consumers.database import query
from sessions.consumers.last_seen import last_seen_batcher
from sessions.consumers.peers import Peers
from sessions.consumers.relay import Outgoing
from sessions.consumers.sender import Sender
from sessions.leases import store
from sessions.leases.terms import Terms
from sessions.models import Session
from sessions.sfu.broadcast import ToSfu, broadcast_of, has_sfu

log = structlog.stdlib.get_logger(__name__)
MAX_WAITING_VERBS = 5  # of one page
VERDICT_SECONDS = 1.0  # timeout of the query whether a page may watch a private drive
ROOM_SECONDS = 2.0  # between two `room` messages to a page that watches through the SFU


@dataclass(eq=False)
class PageSession:
    """One page's session at one robot; also a member of the robot's peers, and a follower of the
    session's notices.

    Verbs run one after another, under `turn`. Frames that need no database do not wait for them.
    """

    robot: Robot
    user: User
    session_key: str | None
    device: dict[str, Any]
    may_observe: bool
    authorization: Authorization
    known: KnownRobot
    bridge: Bridge
    peers: Peers
    audience: Audience
    sender: Sender
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    waiting_verbs: int = 0
    described: protocol.RoomState | None = None
    described_at: float = 0.0
    audience_seen: tuple[int, bool, bool] = (-1, False, False)
    checked_private: str = ""  # the private session for which `may_watch_private` was queried
    misses: bool = False  # it would watch if the present drive were not private
    audience_sent: protocol.AudienceState | None = None  # None until the page watches or drives

    # --- verbs ------------------------------------------------------------------------------------

    async def do(self, verb: Message) -> None:
        """Carry out a Take, Observe, Leave or Assist, after those before it.

        Raises:
            DatabaseError: or InterfaceError or LeaseContention; no answer was sent to the page.
        """
        self.waiting_verbs += 1
        async with self.turn:
            self.waiting_verbs -= 1
            if not self.sender.closed and await self.still_welcome():
                await self._do(verb)
        self.peers.changed()

    async def _do(self, verb: Message) -> None:
        match verb:
            case protocol.Take():
                await self._take(verb)
            case protocol.Observe():
                self._observe()
            case protocol.Leave():
                await self._leave(verb)
            case protocol.Assist():
                await self._choose_assist(verb)
        await self.read_peers()

    async def _take(self, ask: protocol.Take) -> None:
        taken = await query(
            queries.take,
            self.robot,
            self.user,
            self.authorization.peer,
            session=ask.session,
            old_peer=ask.peer,
            takeover=ask.takeover,
            device=self.device,
            now=timezone.now(),
        )
        match taken:
            case store.TakeGranted():
                self._granted(taken)
            case protocol.Queued(session=session):
                self._follow(session)
                self.authorization.wait(session)
                self.sender.notify(taken)
            case protocol.Refused(reason="ended", session=session):
                outcome = await self._how_it_ended(session)
                self.sender.post("session/refused", msgspec.structs.replace(taken, outcome=outcome))
            case protocol.Refused():
                self.sender.post("session/refused", taken)

    async def _how_it_ended(self, session: str | None) -> str:
        """Return the outcome of a session that ended while its page was disconnected; empty when
        it is not this visitor's.
        """
        if session is None or not await query(queries.is_of, session, self.user):
            return ""
        outcome, _reason = await query(queries.outcome_of, session)
        return outcome

    def _granted(self, granted: store.TakeGranted) -> None:
        """Make this page the driver's, in this order: its own commands pass first, then the robot
        receives the lease, then the page is notified and sends its offer to the robot.
        """
        self._follow(granted.session)
        self._leave_sfu()
        self.authorization.drive(granted.session, granted.epoch, granted.peer)
        if granted.resumed:
            self.peers.replace(granted.peer, self)
        self.bridge.publish_lease(self.robot.name, granted.lease)
        message = protocol.Granted(
            session=granted.session,
            epoch=granted.epoch,
            peer=granted.peer,
            resumed=granted.resumed,
            turn_seconds=granted.turn_seconds,
            ice_servers=self._ice_servers(),
            limits=granted.lease.limits,
            terms=_sent_terms(granted.terms),
        )
        self.sender.post("session/granted", message)
        if granted.shown:
            task = protocol.task_of(granted.session, granted.shown, time.time())
            if task is not None:
                self.sender.notify(task)

    async def _choose_assist(self, verb: protocol.Assist) -> None:
        session, chosen = self.authorization.session, None
        if session is not None and self.authorization.role == "driver":
            chosen = await query(
                queries.choose_assist,
                session,
                verb.level,
                peer=self.authorization.peer,
                now=timezone.now(),
            )
        if isinstance(chosen, Lease):
            self.bridge.publish_lease(self.robot.name, chosen)
        else:
            self.sender.post(
                "denied", protocol.Denied(suffix="session/assist", reason=chosen or "not_driver")
            )

    def _observe(self) -> None:
        if not self.may_observe:
            self.sender.post("session/refused", protocol.Refused(reason="not_allowed"))
            return
        self.misses = self.authorization.is_shut_out(self.known.lease)
        if self.misses:
            self.sender.post("session/refused", protocol.Refused(reason="private"))
            return
        by_sfu = self.authorization.by_sfu
        if not self.authorization.watches:
            operates = self.authorization.operator is not None
            sfu = has_sfu()
            by_sfu = sfu and not self.peers.has_place_beside_sfu(self.known, operates=operates)
            if not sfu and not self.peers.has_place(self.known):
                self.sender.post("session/refused", protocol.Refused(reason="observers_full"))
                return
        self._watch(by_sfu=by_sfu)

    def _watch(self, *, by_sfu: bool) -> None:
        self.authorization.observe(by_sfu=by_sfu)
        if by_sfu:
            broadcast = broadcast_of(self.robot.name, self.bridge)
            broadcast.join(self.authorization.peer, self._tell_of_sfu)
        observing = protocol.Observing(ice_servers=self._ice_servers(), sfu=by_sfu)
        self.sender.post("session/observing", observing)

    def moves_to_sfu(self, inbound: ReceivedMessage) -> bool:
        """Switch to the SFU if the robot reports that it has no place: this process does not know
        the viewers of other processes.
        """
        page, reply = self.authorization, inbound.message
        if not (isinstance(reply, Bye) and reply.reason == "full"):
            return False
        is_ours = inbound.suffix == f"{protocol.SIGNAL}/{page.peer}/reply"
        if not is_ours or not page.watches or page.by_sfu:
            return False
        if has_sfu():
            self._watch(by_sfu=True)
        return page.by_sfu

    def tell_sfu(self, message: ToSfu) -> None:
        """Pass a message of the page to the SFU."""
        broadcast = broadcast_of(self.robot.name, self.bridge)
        # it may be newer than the one that the page joined
        broadcast.join(self.authorization.peer, self._tell_of_sfu)
        broadcast.take(self.authorization.peer, message)

    def _tell_of_sfu(self, message: SdpOffer | Bye) -> None:
        self.sender.post("signal/reply", message)

    def _leave_sfu(self) -> None:
        if self.authorization.by_sfu:
            broadcast = broadcast_of(self.robot.name, self.bridge)
            broadcast.leave(self.authorization.peer)

    async def _leave(self, verb: protocol.Leave) -> None:
        session, drove = self.authorization.session, self.authorization.role == "driver"
        if session is None and verb.session is not None:
            await self._leave_late(verb.session, verb.peer or "")
            return
        if session is None:
            self.hang_up()
            self.authorization.leave()
            return
        left, ended = await self._end(session, self.authorization.peer)
        self._over(ended)
        if left:
            self._send_ended(ended, drove=drove)

    async def _end(self, session: str, peer: str) -> tuple[bool, protocol.Ended]:
        """End a session of this peer; return whether it lived until then, and how it ended."""
        left = await query(store.leave, session, peer=peer, now=timezone.now())
        outcome, reason = await query(queries.outcome_of, session)
        return left, protocol.Ended(session=session, outcome=outcome or "moved", reason=reason)

    async def _leave_late(self, session: str, peer: str) -> None:
        """End a session that the visitor left while the page was disconnected, unless it has moved
        to another page or is another visitor's.
        """
        if not await query(queries.is_of, session, self.user):
            self.sender.post("denied", protocol.Denied(suffix="session/leave", reason="not_yours"))
            return
        left, ended = await self._end(session, peer)
        self.sender.notify(ended)
        if left:
            self._send_ended(ended, drove=ended.reason != store.LEFT_QUEUE)

    def _send_ended(self, ended: protocol.Ended, *, drove: bool) -> None:
        if drove:
            self.bridge.publish_lease(self.robot.name, None)
        self.bridge.publish_notice(ended.session, protocol.notice_frame(ended))

    # --- notices and leases -----------------------------------------------------------------------

    def handle_notice(self, frame: str) -> None:
        """Pass a notice of the session to the page, and act on the session's end."""
        try:
            notice = protocol.decode_notice(frame)
        except Rejection as rejection:
            log.error("notice_rejected", robot=self.robot.name, reason=str(rejection))
            return
        if isinstance(notice, protocol.Ended):
            self._over(notice)
            self.peers.changed()
        else:
            self.sender.put(Outgoing(frame))

    def lost_lease(self, lease: Lease | None) -> bool:
        """Act on a lease that is no longer this page's; True when only the database knows why."""
        if (
            self.authorization.role != "driver"
            or self.authorization.holds(lease)
            or (lease is not None and lease.epoch < self.authorization.epoch)
        ):
            return False
        if lease is not None and lease.session == self.authorization.session:
            self._over(protocol.Ended(session=lease.session, outcome="moved"))
            return False
        return True

    async def confirm(self) -> None:
        """Read the status of this page's session, when the broker may have lost or reordered
        messages.
        """
        async with self.turn:
            session = self.authorization.session
            if session is None or self.sender.closed:
                return
            status = await query(
                queries.session_status_of,
                self.robot,
                session,
                epoch=self.authorization.epoch,
                peer=self.authorization.peer,
                now=timezone.now(),
            )
            if session == self.authorization.session:
                self._apply_status(status, session)

    def _apply_status(self, status: queries.SessionStatus, session: str) -> None:
        driving = self.authorization.role == "driver"
        if status.state == "ended":
            self._over(
                protocol.Ended(session=session, outcome=status.outcome, reason=status.reason)
            )
        elif driving and status.moved:
            self._over(protocol.Ended(session=session, outcome="moved"))
        elif driving and status.lease is not None:
            self.bridge.publish_lease(self.robot.name, _ahead(status.lease, self.known))
        elif not driving and status.seconds is not None:
            self.sender.notify(protocol.Offered(session=session, seconds=status.seconds))

    def note_private(self, drive: queries.PrivateDrive | None) -> None:
        """Note the private drive at the robot, by the database."""
        if drive is None:
            self.authorization.note_private("", may_watch=False)
        else:
            self.authorization.note_private(drive.session, may_watch=drive.may_watch)

    def privacy_changed(self) -> Coroutine[Any, Any, None] | None:
        """Return the work that a lease requires because the present drive has become private, or is
        no longer.
        """
        lease = self.known.lease
        self.authorization.private = ""  # from now on the lease decides
        if not self.authorization.is_shut_out(lease):
            # a visitor who waits watches again
            again = self.misses and self.authorization.role == "waiting"
            self.misses = False
            return self.do(protocol.Observe()) if again else None
        assert lease is not None
        if lease.session == self.checked_private:
            return None
        self.checked_private = lease.session
        return self._check_private(lease.session)

    async def _check_private(self, session: str) -> None:
        """Stop the page from watching a private drive, unless the database answers in time that it
        may. Until then none of the robot's messages are relayed.
        """
        try:
            async with asyncio.timeout(VERDICT_SECONDS):
                if await query(queries.may_watch_private, self.user, session):
                    self.authorization.watchable = session
        except (DatabaseError, InterfaceError, TimeoutError) as error:
            log.warning("private_drive_not_checked", robot=self.robot.name, reason=str(error))
        self._shut_out()

    def _shut_out(self) -> None:
        """Stop a page from watching a private drive that it may not see."""
        if self.authorization.watches and self.authorization.is_shut_out(self.known.lease):
            self.misses = True
            self.stop_watching()
            self.sender.post("session/refused", protocol.Refused(reason="private"))
        self.peers.changed()

    # --- regular work -----------------------------------------------------------------------------

    async def read_peers(self) -> None:
        """Read the length of the queue and why the robot is not ready, and notify all pages. If the
        database is away, the last values remain: they are only shown.
        """
        try:
            self.peers.waiting, self.peers.pause = await query(
                queries.queue_at, self.robot, timezone.now()
            )
        except (DatabaseError, InterfaceError) as error:
            log.warning("peers_not_read", robot=self.robot.name, reason=str(error))
            return
        self.peers.changed()

    async def say_seen(self) -> None:
        """Store that this page is open."""
        session = self.authorization.session
        if session is not None and not await last_seen_batcher.seen(session):
            await self.confirm()

    async def still_welcome(self) -> bool:
        """Tell whether the visitor is still signed in and allowed here, and update the page's
        permissions; otherwise end its session and its connection. The caller holds `turn`.
        """
        welcome = await query(queries.welcome, self.session_key, self.user, self.robot)
        answer = welcome.answer
        if answer == "welcome" and welcome.user is not None:
            self.user = welcome.user
            self.may_observe, self.authorization.operator = welcome.may_observe, welcome.operator
            had_lease = not self.authorization.private
            self.note_private(welcome.private)
            if had_lease:
                self.authorization.private = ""  # the lease is newer than the database's answer
            self._shut_out()
            if self.authorization.watches and not self.may_observe:
                self.stop_watching()
                self.sender.post("session/refused", protocol.Refused(reason="not_allowed"))
            return True
        log.warning("page_dismissed", robot=self.robot.name, reason=answer)
        session, drove = self.authorization.session, self.authorization.role == "driver"
        self.hang_up()
        if session is not None:
            self.forget()
            outcome = Session.Outcome.STOPPED_BY_OPERATOR if drove else Session.Outcome.CANCELLED
            if await query(store.end, session, outcome, answer, timezone.now()):
                ended = protocol.Ended(session=session, outcome=outcome, reason=answer)
                self._send_ended(ended, drove=drove)
        self.sender.end(protocol.SIGNED_OUT if answer == "signed_out" else protocol.NOT_ALLOWED)
        return False

    async def page_closed(self, code: int) -> None:
        """Store after any running verb that the page's socket has closed with `code`. The session
        continues until the session manager ends it.
        """
        async with self.turn:
            session, peer = self.authorization.session, self.authorization.peer
            waited = self.authorization.role == "waiting"
            if session is not None:
                self.forget()
                await last_seen_batcher.forget(session)
                await query(store.page_closed, session, peer, timezone.now(), code)
            if waited:
                await self.read_peers()

    # --- small steps ------------------------------------------------------------------------------

    def peers_changed(self) -> None:
        """Send the page its peers, if they have changed."""
        self.audience_changed()
        now = time.monotonic()
        if self.authorization.by_sfu and now - self.described_at < ROOM_SECONDS:
            return  # each of a thousand pages that join would notify all others
        self.described_at = now
        described = self.peers.describe(self.known, now)
        if self.authorization.is_shut_out(self.known.lease):
            described = msgspec.structs.replace(described, driver="", private=True)
        if described != self.described:
            self.described = described
            self.sender.post("room", described)

    def audience_changed(self) -> None:
        """Send the page the hands and questions that it may see, if they have changed; take down
        the hand of a page that stops watching.
        """
        page, audience = self.authorization, self.audience
        if not page.watches:
            audience.leave(self)
        moderates = page.moderates(self.known.lease)
        seen = audience.board.version, page.watches, moderates
        if seen == self.audience_seen:
            return
        self.audience_seen = seen
        state = None if self.audience_sent is None else protocol.AudienceState()
        if page.watches or moderates:
            state = audience.board.view(str(self.user.pk), moderates=moderates)
        if state is not None and state != self.audience_sent:
            self.audience_sent = state
            self.sender.post("audience", state)

    def tell_audience(self, message: protocol.ToAudience) -> str:
        """Carry out a request about the audience; return why it is refused, or nothing."""
        return self.audience.take(message, self, str(self.user.pk), self.authorization.who)

    def replaced(self) -> None:
        """Give up this socket for a newer one of the same page: this one must neither stop the
        robot nor report the page closed.
        """
        self._leave_sfu()
        self.forget()
        self.sender.end(protocol.REPLACED)

    def handle_message(self, inbound: Any) -> None:
        """Handle a notice of the followed session."""
        self.handle_notice(str(inbound.frame))

    def _follow(self, session: str) -> None:
        if self.authorization.session not in {None, session}:
            self.bridge.unfollow(str(self.authorization.session), self)
        self.bridge.follow(session, self)

    def forget(self) -> None:
        """Detach this page from its session."""
        if self.authorization.session is not None:
            self.bridge.unfollow(self.authorization.session, self)
        self.authorization.leave()

    def _over(self, ended: protocol.Ended) -> None:
        self.hang_up()
        self.forget()
        self.sender.notify(ended)

    def hang_up(self) -> None:
        """End the page's connection to the robot or to the SFU."""
        if self.authorization.by_sfu:
            self.stop_watching()
        elif self.authorization.watches or self.authorization.role == "driver":
            self._signal(Bye(reason="left"))

    def stop_watching(self) -> None:
        """End the page's video when it watches. A driver's connection works without the server, and
        ends with the lease.
        """
        if not self.authorization.watches:
            return
        if self.authorization.by_sfu:
            self._leave_sfu()
        else:
            self._signal(Bye(reason="left"))
        self.authorization.look_away()

    def vouch(self) -> None:
        """Confirm to the robot that this page may still watch."""
        if self.authorization.watches and not self.authorization.by_sfu:
            self._signal(Stay())

    def _signal(self, signal: Bye | Stay) -> None:
        self.bridge.send(self.robot.name, f"{protocol.SIGNAL}/{self.authorization.peer}", signal)

    def _ice_servers(self) -> Any:
        return ice_servers(str(self.user.pk), time.time())


def _sent_terms(fixed: Terms) -> protocol.GrantedTerms | None:
    """Return the terms as the page receives them; None when they restrict nothing."""
    sent = protocol.GrantedTerms(
        label=fixed.label[:120],
        controllers=fixed.controllers,  # type: ignore[arg-type]
        actions=fixed.actions,
        assist=fixed.assist,
        control_way=fixed.control_way,
        interface=fixed.interface,
    )
    return None if sent == protocol.GrantedTerms() else sent


def _ahead(lease: Lease, known: KnownRobot) -> Lease:
    """Return a copy of the lease that the robot accepts: the robot's renewal number may be ahead of
    the database's, and a lease after an empty one needs a greater number.
    """
    if known.epoch != lease.epoch:
        return lease
    return msgspec.structs.replace(
        lease, renewal=max(lease.renewal, known.renewal + (known.lease is None))
    )
