"""What a page's connection does with its session: takes, watches, leaves, learns that it is over.
Asks the database, tells everybody.
"""

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
MAX_WAITING_VERBS = 5  # that one page may ask for while earlier ones are being done
VERDICT_SECONDS = 1.0  # in which the database must say that a page may watch a private drive
ROOM_SECONDS = 2.0  # between two looks at who is here, for a page that watches through the SFU


@dataclass(eq=False)
class PageSession:
    """One page's session at one robot; also a member of the robot's peers, and a follower of the
    session's notices.

    Verbs run one after another, under `turn`; frames that need no database go on passing meanwhile.
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
    asked_about: str = ""  # the private session of which the database was asked
    misses: bool = False  # it would watch if the drive under way were not private
    audience_told: protocol.AudienceState | None = None  # nothing before it watches or drives

    # --- verbs ------------------------------------------------------------------------------------

    async def do(self, verb: Message) -> None:
        """Carry out a Take, Observe, Leave or Assist, after those before it.

        Raises:
            DatabaseError: or InterfaceError or LeaseContention; the page is not answered yet.
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
        """Return the outcome of a session whose page was not there to hear it; empty when it is not
        this visitor's.
        """
        if session is None or not await query(queries.is_of, session, self.user):
            return ""
        outcome, _reason = await query(queries.outcome_of, session)
        return outcome

    def _granted(self, granted: store.TakeGranted) -> None:
        self._follow(granted.session)
        self._leave_sfu()
        self.authorization.drive(granted.session, granted.epoch, granted.peer)
        if granted.resumed:
            self.peers.replace(granted.peer, self)
        # Before the page hears of it, so that the robot knows the driver when the offer comes.
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
        if session is not None and self.authorization.standing == "driver":
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
        """Watch through the SFU from now on if the robot says that it has no place: this process
        does not know who watches it through others.
        """
        page, reply = self.authorization, inbound.message
        if not (isinstance(reply, Bye) and reply.reason == "full"):
            return False  # as of nearly all that a robot says
        is_ours = inbound.suffix == f"{protocol.SIGNAL}/{page.peer}/reply"
        if not is_ours or not page.watches or page.by_sfu:
            return False
        if has_sfu():
            self._watch(by_sfu=True)
        return page.by_sfu

    def tell_sfu(self, message: ToSfu) -> None:
        """Tell the SFU what the page says to it."""
        broadcast = broadcast_of(self.robot.name, self.bridge)
        # it may be another one than that which the page came to
        broadcast.join(self.authorization.peer, self._tell_of_sfu)
        broadcast.take(self.authorization.peer, message)

    def _tell_of_sfu(self, message: SdpOffer | Bye) -> None:
        self.sender.post("signal/reply", message)

    def _leave_sfu(self) -> None:
        if self.authorization.by_sfu:
            broadcast = broadcast_of(self.robot.name, self.bridge)
            broadcast.leave(self.authorization.peer)

    async def _leave(self, verb: protocol.Leave) -> None:
        session, drove = self.authorization.session, self.authorization.standing == "driver"
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
            self._send_ended(session, ended.outcome, ended.reason, drove=drove)

    async def _end(self, session: str, peer: str) -> tuple[bool, protocol.Ended]:
        """End a session of this peer's; tell whether it lived until then, and how it ended."""
        left = await query(store.leave, session, peer=peer, now=timezone.now())
        outcome, reason = await query(queries.outcome_of, session)
        return left, protocol.Ended(session=session, outcome=outcome or "moved", reason=reason)

    async def _leave_late(self, session: str, peer: str) -> None:
        """End what the visitor left while the page could not say so; what has moved to another
        page, or is another's, stays.
        """
        if not await query(queries.is_of, session, self.user):
            self.sender.post("denied", protocol.Denied(suffix="session/leave", reason="not_yours"))
            return
        left, ended = await self._end(session, peer)
        self.sender.notify(ended)
        if left:
            drove = ended.reason != store.LEFT_QUEUE
            self._send_ended(session, ended.outcome, ended.reason, drove=drove)

    def _send_ended(self, session: str, outcome: str, reason: str, *, drove: bool) -> None:
        if drove:
            self.bridge.publish_lease(self.robot.name, None)
        ended = protocol.Ended(session=session, outcome=outcome, reason=reason)
        self.bridge.publish_notice(session, protocol.notice_frame(ended))

    # --- what is heard ----------------------------------------------------------------------------

    def handle_notice(self, frame: str) -> None:
        """Hand a notice of the page's session on, and act on its end."""
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
        """Act on a lease that is not this page's any more; True when only the
        database knows why.
        """
        if (
            self.authorization.standing != "driver"
            or self.authorization.holds(lease)
            or (lease is not None and lease.epoch < self.authorization.epoch)
        ):
            return False
        if lease is not None and lease.session == self.authorization.session:
            self._over(protocol.Ended(session=lease.session, outcome="moved"))
            return False
        return True

    async def confirm(self) -> None:
        """Ask the database where this page's session stands, when the broker may have forgotten or
        mixed up something.
        """
        async with self.turn:
            session = self.authorization.session
            if session is None or self.sender.closed:
                return
            standing = await query(
                queries.session_status_of,
                self.robot,
                session,
                epoch=self.authorization.epoch,
                peer=self.authorization.peer,
                now=timezone.now(),
            )
            if session == self.authorization.session:
                self._stand(standing, session)

    def _stand(self, standing: queries.SessionStatus, session: str) -> None:
        driving = self.authorization.standing == "driver"
        if standing.state == "ended":
            self._over(
                protocol.Ended(session=session, outcome=standing.outcome, reason=standing.reason)
            )
        elif driving and standing.moved:
            self._over(protocol.Ended(session=session, outcome="moved"))
        elif driving and standing.lease is not None:
            self.bridge.publish_lease(self.robot.name, _ahead(standing.lease, self.known))
        elif not driving and standing.seconds is not None:
            self.sender.notify(protocol.Offered(session=session, seconds=standing.seconds))

    def note_private(self, drive: queries.PrivateDrive | None) -> None:
        """Note what the database says of a private drive at the robot."""
        if drive is None:
            self.authorization.note_private("", may_watch=False)
        else:
            self.authorization.note_private(drive.session, may_watch=drive.may_watch)

    def privacy_changed(self) -> Coroutine[Any, Any, None] | None:
        """Act on a lease: return what is to be done now that the drive under way is private, or is
        so no longer.
        """
        lease = self.known.lease
        self.authorization.private = ""  # what the lease says counts from now on
        if not self.authorization.is_shut_out(lease):
            # whoever waited without a picture gets one again
            again = self.misses and self.authorization.standing == "waiting"
            self.misses = False
            return self.do(protocol.Observe()) if again else None
        assert lease is not None
        if lease.session == self.asked_about:
            return None
        self.asked_about = lease.session
        return self._look_at_private(lease.session)

    async def _look_at_private(self, session: str) -> None:
        """End what the page sees of a private drive, unless the database says in time that it may
        watch it. Meanwhile nothing of the robot's is passed on.
        """
        try:
            async with asyncio.timeout(VERDICT_SECONDS):
                if await query(queries.may_watch_private, self.user, session):
                    self.authorization.watchable = session
        except (DatabaseError, InterfaceError, TimeoutError) as error:
            log.warning("private_drive_not_checked", robot=self.robot.name, reason=str(error))
        self._shut_out()

    def _shut_out(self) -> None:
        """Show a page that watches no more of a drive that is none of its business."""
        if self.authorization.watches and self.authorization.is_shut_out(self.known.lease):
            self.misses = True
            self.stop_watching()
            self.sender.post("session/refused", protocol.Refused(reason="private"))
        self.peers.changed()

    # --- what time brings -------------------------------------------------------------------------

    async def read_peers(self) -> None:
        """Read how many wait, and what the robot does when nobody drives it; say so to all. If the
        database is away, what was read last stands: it decides nothing.
        """
        try:
            found = await query(queries.between_visits_at, self.robot, timezone.now())
        except (DatabaseError, InterfaceError) as error:
            log.warning("peers_not_read", robot=self.robot.name, reason=str(error))
            return
        self.peers.waiting, self.peers.pause = found
        self.peers.changed()

    async def say_seen(self) -> None:
        """Note in the database that this page is open."""
        session = self.authorization.session
        if session is not None and not await last_seen_batcher.seen(session):
            await self.confirm()

    async def still_welcome(self) -> bool:
        """Tell whether the visitor is still signed in and allowed here; otherwise end what the page
        does, and its connection.

        What the visitor may do here besides is looked at anew as well. The caller holds `turn`.
        """
        welcome = await query(queries.welcome, self.session_key, self.user, self.robot)
        answer = welcome.answer
        if answer == "welcome" and welcome.user is not None:
            self.user = welcome.user
            self.may_observe, self.authorization.operator = welcome.may_observe, welcome.operator
            told_before = not self.authorization.private
            self.note_private(welcome.private)
            if told_before:
                self.authorization.private = ""  # a lease was heard of, which is newer
            self._shut_out()
            if self.authorization.watches and not self.may_observe:
                self.stop_watching()
                self.sender.post("session/refused", protocol.Refused(reason="not_allowed"))
            return True
        log.warning("page_dismissed", robot=self.robot.name, reason=answer)
        session, drove = self.authorization.session, self.authorization.standing == "driver"
        self.hang_up()
        if session is not None:
            self.forget()
            outcome = Session.Outcome.STOPPED_BY_OPERATOR if drove else Session.Outcome.CANCELLED
            if await query(store.end, session, outcome, answer, timezone.now()):
                self._send_ended(session, outcome, answer, drove=drove)
        self.sender.end(protocol.SIGNED_OUT if answer == "signed_out" else protocol.NOT_ALLOWED)
        return False

    async def page_gone(self, code: int) -> None:
        """Note that the page's socket has closed, when what was begun is done, with the code of its
        end. The visit goes on: its time is the session manager's.
        """
        async with self.turn:
            session, peer = self.authorization.session, self.authorization.peer
            waited = self.authorization.standing == "waiting"
            if session is not None:
                self.forget()
                await last_seen_batcher.forget(session)
                await query(store.page_gone, session, peer, timezone.now(), code)
            if waited:
                await self.read_peers()

    # --- small steps ------------------------------------------------------------------------------

    def peers_changed(self) -> None:
        """Tell the page who is here, if that is news."""
        self.audience_changed()
        now = time.monotonic()
        if self.authorization.by_sfu and now - self.described_at < ROOM_SECONDS:
            return  # of a thousand who come one after the other, a thousand hear now and then
        self.described_at = now
        described = self.peers.describe(self.known, now)
        if self.authorization.is_shut_out(self.known.lease):
            described = msgspec.structs.replace(described, driver="", private=True)
        if described != self.described:
            self.described = described
            self.sender.post("room", described)

    def audience_changed(self) -> None:
        """Tell the page what it may see of hands and questions, if that is news; the hand of one
        that watches no more is down.
        """
        page, audience = self.authorization, self.audience
        if not page.watches:
            audience.leave(self)
        moderates = page.moderates(self.known.lease)
        seen = audience.board.version, page.watches, moderates
        if seen == self.audience_seen:
            return
        self.audience_seen = seen
        told = None if self.audience_told is None else protocol.AudienceState()
        if page.watches or moderates:
            told = audience.board.view(str(self.user.pk), moderates=moderates)
        if told is not None and told != self.audience_told:
            self.audience_told = told
            self.sender.post("audience", told)

    def tell_audience(self, message: protocol.ToAudience) -> str:
        """Do what the page asks of its audience, or as a part of one; return why not, or
        nothing.
        """
        return self.audience.take(message, self, str(self.user.pk), self.authorization.who)

    def replaced(self) -> None:
        """Another socket of this page has come: this one is dead, and must neither stop the robot
        nor report the page gone.
        """
        self._leave_sfu()
        self.forget()
        self.sender.end(protocol.REPLACED)

    def handle_message(self, inbound: Any) -> None:
        """Take a notice of the session that is followed."""
        self.handle_notice(str(inbound.frame))

    def _follow(self, session: str) -> None:
        if self.authorization.session not in {None, session}:
            self.bridge.unfollow(str(self.authorization.session), self)
        self.bridge.follow(session, self)

    def forget(self) -> None:
        """Have nothing to do with the session any more."""
        if self.authorization.session is not None:
            self.bridge.unfollow(self.authorization.session, self)
        self.authorization.leave()

    def _over(self, ended: protocol.Ended) -> None:
        self.hang_up()
        self.forget()
        self.sender.notify(ended)

    def hang_up(self) -> None:
        """Tell the robot that this page wants no more pictures, and must get none."""
        if self.authorization.by_sfu:
            self.stop_watching()
        elif self.authorization.watches or self.authorization.standing == "driver":
            self._signal(Bye(reason="left"))

    def stop_watching(self) -> None:
        """End the page's pictures when it watches; whoever drives may do so without the server, and
        is ended by the lease.
        """
        if not self.authorization.watches:
            return
        if self.authorization.by_sfu:
            self._leave_sfu()
        else:
            self._signal(Bye(reason="left"))
        self.authorization.look_away()

    def vouch(self) -> None:
        """Tell the robot that this page may go on watching."""
        if self.authorization.watches and not self.authorization.by_sfu:
            self._signal(Stay())

    def _signal(self, signal: Bye | Stay) -> None:
        self.bridge.send(self.robot.name, f"{protocol.SIGNAL}/{self.authorization.peer}", signal)

    def _ice_servers(self) -> Any:
        return ice_servers(str(self.user.pk), time.time())


def _sent_terms(fixed: Terms) -> protocol.GrantedTerms | None:
    """Return what the page is told of the terms of its visit; None when they leave everything to
    the visitor.
    """
    sent = protocol.GrantedTerms(
        label=fixed.label[:120],
        controllers=fixed.controllers,
        actions=fixed.actions,
        assist=fixed.assist,  # type: ignore[arg-type]
        control_way=fixed.control_way,
        interface=fixed.interface,
    )
    return None if sent == protocol.GrantedTerms() else sent


def _ahead(lease: Lease, known: KnownRobot) -> Lease:
    """Return the copy that the robot takes: its renewal may be ahead of the database's, and one
    after an empty lease must be newer.
    """
    if known.epoch != lease.epoch:
        return lease
    return msgspec.structs.replace(
        lease, renewal=max(lease.renewal, known.renewal + (known.lease is None))
    )
