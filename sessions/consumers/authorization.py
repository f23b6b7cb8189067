"""What one page may send to a robot: pure.

A page is a guest, waits or drives, and may watch unless it drives. The role, session, epoch and
peer in its messages are replaced by those that the server knows: the peer that the server made, the
session and epoch of the grant, and the lease in force. A frame ends in one effect: a message to
publish, a verb for the database, a report for the record, or a refusal, which is counted and sent
to the page but never raised.
"""

import collections
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from robots.api import codec, topics
from robots.api.errors import Rejection
from robots.api.messages import (
    Action,
    Bye,
    Call,
    Cancel,
    Candidate,
    ClearEStop,
    CommandHeartbeat,
    EStop,
    IceServer,
    Knock,
    Lease,
    Message,
    Photo,
    PictureRequest,
    PointCommand,
    Relocalize,
    ResendStates,
    RouteRequest,
    Say,
    SdpAnswer,
    SdpOffer,
    Stop,
    VelocityCommand,
)
from sessions import protocol
from sessions.consumers.rate_limits import Allowance

PageRole = Literal["guest", "waiting", "driver"]
Operator = Literal["owner", "staff"]
# Actions that an operator of the robot may request without driving it.
OPERATORS_OWN: tuple[type[Action], ...] = (ClearEStop, Photo, Relocalize, Cancel)
# Actions that a visitor may request while a hidden operator drives.
OF_A_VISITOR: tuple[type[Action], ...] = (Photo, Say, Call, Knock)
REPEAT_SECONDS = 1.0


@dataclass(frozen=True)
class Publish:
    """Send a message to the robot; if a `wanted` one cannot be sent, the page receives `denied`."""

    suffix: str
    message: Message
    wanted: bool = True


@dataclass(frozen=True)
class PublishAsOperator:
    """Send an operator's action to the robot if the database confirms the page's rights."""

    suffix: str
    message: Action


@dataclass(frozen=True)
class Halt:
    """Send a stop or e-stop to the robot, with retries."""

    message: Stop | EStop


@dataclass(frozen=True)
class Verb:
    """Carry out a message that needs the database, such as Take, Observe or Leave."""

    suffix: str
    message: Message


@dataclass(frozen=True)
class Write:
    """Send a chat message to the people at a robot without a driver (waiting_chat.py)."""

    message: Say


@dataclass(frozen=True)
class ReportFrame:
    """Send a report to the session manager, for the record."""

    message: protocol.PageReport


@dataclass(frozen=True)
class ToSfu:
    """Send a signalling message to the SFU."""

    message: protocol.WantOffer | SdpAnswer | Candidate | Bye


@dataclass(frozen=True)
class TellAudience:
    """Change the raised hands and questions of the robot's audience."""

    suffix: str
    message: protocol.ToAudience


@dataclass(frozen=True)
class SkipDirect:
    """Skip telemetry that the page receives directly from its robot, or send it again."""

    direct: bool


@dataclass(frozen=True)
class DenyFrame:
    """Report to the page that its frame was refused."""

    suffix: str
    reason: str


@dataclass(frozen=True)
class Close:
    """End the connection."""

    code: int


Effect = (
    Publish
    | PublishAsOperator
    | Halt
    | Verb
    | Write
    | ReportFrame
    | ToSfu
    | TellAudience
    | SkipDirect
    | DenyFrame
    | Close
)


class FrameRefused(Exception):
    """A frame that this page may not send now; the message is the reason in one word."""


class PageAuthorization:
    """Decides about the frames of a page; a subclass has its permissions.

    Args:
        peer: the id that the server made for this connection; a page that resumes gets its old one
            back with the grant.
        who: the visitor's name, or the robot's title, as in messages.
        ice_servers: returns the ICE servers for the robot's side of a connection with this page;
            called for each offer, because credentials expire.
    """

    _protocol: Any = protocol  # decodes messages outside the Robot API

    def __init__(
        self, peer: str, who: str, ice_servers: Callable[[], tuple[IceServer, ...]] = tuple
    ) -> None:
        self.peer = peer
        self.who = who[:120]
        self.ice_servers = ice_servers
        self.refused: collections.Counter[str] = collections.Counter()
        self._allowance = Allowance()
        self._sent: dict[tuple[str, str], float] = {}

    def receive(self, frame: str | bytes, lease: Lease | None, now: float) -> tuple[Effect, ...]:
        """Decide about a frame; `now` is monotonic seconds, `lease` the one in force."""
        suffix = ""
        try:
            suffix, payload = _split(frame)
            # the Robot API has more suffixes, for servers and robots
            message = (
                codec.decode(suffix, payload, "to_robot")
                if suffix in topics.FROM_PAGE
                else self._protocol.decode(suffix, payload)
            )
            if not self._allowance.passes(message, now):
                return self.deny(suffix, "rate", now)
            return (self._effect(suffix, message, lease, now),)
        except Rejection as rejection:
            return self.deny(suffix, rejection.reason, now)
        except FrameRefused as refused:
            return self.deny(suffix, str(refused), now)

    def deny(self, suffix: str, reason: str, now: float) -> tuple[Effect, ...]:
        """Count a refusal; report the same one to the page at most once a second, and close the
        connection of a page that floods.
        """
        self.refused[reason] += 1
        if self._allowance.floods(now):
            return (Close(protocol.FLOODED),)
        key = (suffix if suffix in KNOWN else "", reason)
        if now - self._sent.get(key, float("-inf")) < REPEAT_SECONDS:
            return ()
        self._sent[key] = now
        return (DenyFrame(suffix[:80], reason),)

    def _effect(self, suffix: str, message: Any, lease: Lease | None, now: float) -> Effect:
        """Return what to do with a message; raises FrameRefused when this page may not send it."""
        raise NotImplementedError


class Authorization(PageAuthorization):
    """The permissions of a visitor's page at a robot.

    Args:
        peer: as of PageAuthorization, like `who` and `ice_servers`.
        operator: whether the visitor operates the robot, and as what.
    """

    def __init__(
        self,
        peer: str,
        who: str,
        operator: Operator | None = None,
        ice_servers: Callable[[], tuple[IceServer, ...]] = tuple,
    ) -> None:
        super().__init__(peer, who, ice_servers)
        self.operator = operator
        self.role: PageRole = "guest"
        self.watches = False
        self.by_sfu = False  # watches, but has no connection to the robot
        # Ids of private sessions: the one that has the robot by the database, until this process
        # receives a lease, and the one that this page may watch.
        self.private = ""
        self.watchable = ""
        self.session: str | None = None
        self.epoch = 0
        self.velocity_seq = 0
        self.velocity_at = float("-inf")
        self.awaits_picture = False

    # --- decisions of the database ----------------------------------------------------------------

    def drive(self, session: str, epoch: int, peer: str) -> None:
        """The page was granted the robot."""
        self.role, self.velocity_seq = "driver", 0
        self.session, self.epoch, self.peer = session, epoch, peer
        self.look_away()

    def wait(self, session: str) -> None:
        """The page waits for the robot, and may watch until it drives."""
        self.role, self.session, self.epoch = "waiting", session, 0

    def observe(self, *, by_sfu: bool = False) -> None:
        """The page watches, the robot itself or through the SFU."""
        self.watches, self.by_sfu = True, by_sfu

    def look_away(self) -> None:
        """The page watches no more."""
        self.watches = self.by_sfu = False

    def leave(self) -> None:
        """The page neither drives nor waits nor watches any more."""
        self.awaits_picture = False
        self.role, self.session, self.epoch = "guest", None, 0
        self.look_away()

    def holds(self, lease: Lease | None) -> bool:
        """Tell whether this page is the one that the lease names."""
        return (
            lease is not None
            and self.role == "driver"
            and (lease.session, lease.epoch, lease.peer) == (self.session, self.epoch, self.peer)
        )

    def note_private(self, session: str, *, may_watch: bool) -> None:
        """Note that by the database this private session, or none (""), has the robot."""
        self.private = session
        if may_watch:
            self.watchable = session
        elif self.watchable == session:
            self.watchable = ""

    def is_shut_out(self, lease: Lease | None) -> bool:
        """Tell whether the present drive is private and this page may not watch it."""
        if self.operator is not None or self.holds(lease):
            return False
        session = self.private if lease is None else lease.session if lease.private else ""
        return session not in {"", self.watchable}

    def drives(self, lease: Lease | None) -> bool:
        """Tell whether this page may move the robot: it holds the lease, and no hidden operator
        drives under it.
        """
        return lease is not None and lease.kind == "visitor" and self.holds(lease)

    def moderates(self, lease: Lease | None) -> bool:
        """Tell whether this page may answer questions of the audience: it drives, or watches for
        an operator of the robot.
        """
        return self.holds(lease) or (self.watches and self.operator is not None)

    def may_see_picture(self, lease: Lease | None) -> bool:
        """Tell whether to send this page a picture of the robot: one for each request.

        The permission is checked again, because the page may have lost the robot since its request.
        """
        asked, self.awaits_picture = self.awaits_picture, False
        return asked and (self.watches or self.holds(lease)) and not self.is_shut_out(lease)

    # --- frames of the page -----------------------------------------------------------------------

    def _effect(self, suffix: str, message: Any, lease: Lease | None, now: float) -> Effect:
        match message:
            case VelocityCommand():
                return self._velocity(message, lease, now)
            case CommandHeartbeat():
                if not self.holds(lease):
                    raise self._not_driving()
                return Publish(
                    suffix, msgspec.structs.replace(message, peer=self.peer), wanted=False
                )
            case Stop() | EStop():
                return Halt(self._stamp_stop(message, lease))
            case Action():
                return self._action(suffix, message, lease)
            case PictureRequest():
                return self._picture(message, lease)
            case PointCommand() | RouteRequest():
                return self._of_driver(suffix, message, lease)
            case protocol.WantOffer() | SdpAnswer() | SdpOffer() | Candidate() | Bye():
                return self._signal(message, lease)
            case protocol.PageEvent() | protocol.PageNetwork():
                return ReportFrame(self._report(suffix, message))
        return self._server_effect(suffix, message, lease)

    def _server_effect(self, suffix: str, message: Any, lease: Lease | None) -> Effect:
        match message:
            case protocol.Direct():
                return SkipDirect(message.direct)
            case protocol.RaiseHand() | protocol.AskQuestion():
                if not self.watches:
                    raise FrameRefused("not_watching")
                return TellAudience(suffix, message)
            case protocol.MarkQuestion() | protocol.LowerHands():
                if not self.moderates(lease):
                    raise FrameRefused("not_allowed")
                return TellAudience(suffix, message)
        return Verb(suffix, message)

    def _not_driving(self) -> FrameRefused:
        return FrameRefused("observer" if self.watches else "not_driver")

    def _velocity(self, command: VelocityCommand, lease: Lease | None, now: float) -> Publish:
        if not self.drives(lease):
            raise self._not_driving()
        assert self.session is not None
        self.velocity_seq, self.velocity_at = max(self.velocity_seq, command.seq), now
        return Publish(
            "command/velocity",
            msgspec.structs.replace(command, session=self.session, epoch=self.epoch),
            wanted=False,
        )

    def _picture(self, request: PictureRequest, lease: Lease | None) -> Publish:
        if self.by_sfu:
            # single frames come from the robot, for which there are too many pages
            raise FrameRefused("sfu")
        if not (self.watches or self.holds(lease)):
            raise FrameRefused("not_driver" if self.role == "driver" else "no_role")
        if self.is_shut_out(lease):
            raise FrameRefused("private")
        self.awaits_picture = True
        return Publish(
            "command/picture", msgspec.structs.replace(request, peer=self.peer), wanted=False
        )

    def _of_driver(
        self, suffix: str, message: PointCommand | RouteRequest, lease: Lease | None
    ) -> Publish:
        if not self.holds(lease):
            raise self._not_driving()
        stamped = msgspec.structs.replace(message, session=self.session, epoch=self.epoch)
        if isinstance(stamped, PointCommand):
            stamped = msgspec.structs.replace(stamped, role="driver", peer=self.peer)
        return Publish(suffix, stamped, wanted=False)

    def _stamp_stop(self, action: Stop | EStop, lease: Lease | None) -> Stop | EStop:
        if self.drives(lease):
            return msgspec.structs.replace(
                action, session=self.session, epoch=self.epoch, role="driver", user=self.who
            )
        # A page stops the robot when its drive ends. Copies of this stop that arrive afterwards
        # still name that drive: without a lease they do not hold the robot, as the stop of another
        # person would. A false claim only weakens the sender's own stop.
        session = None if lease else action.session
        stamped = msgspec.structs.replace(
            action, session=session, epoch=0, role=self.operator or "observer", user=self.who
        )
        # `seq` belongs to the driver's counter: that of another page would void commands that the
        # driver has yet to send.
        return msgspec.structs.replace(stamped, seq=0) if isinstance(stamped, Stop) else stamped

    def _action(self, suffix: str, action: Action, lease: Lease | None) -> Effect:
        if isinstance(action, Say) and self.role == "waiting" and lease is None:
            return Write(action)
        stamped = self.stamp_action(action, lease)
        if stamped.role in {"owner", "staff"}:
            return PublishAsOperator(suffix, stamped)
        return Publish(suffix, stamped)

    def stamp_action(self, action: Action, lease: Lease | None) -> Action:
        """Return an action with the role, session and user of this page.

        Raises:
            FrameRefused: this page may not request it.
        """
        if isinstance(action, ResendStates):
            raise FrameRefused("not_allowed")
        if isinstance(action, ClearEStop) or (
            self.operator and isinstance(action, OPERATORS_OWN) and not self.holds(lease)
        ):
            if self.operator is None:
                raise FrameRefused("not_allowed")
            return msgspec.structs.replace(
                action, session=None, epoch=0, role=self.operator, user=self.who
            )
        is_visitor = lease is not None and lease.kind == "wizard" and self.holds(lease)
        if not (is_visitor and isinstance(action, OF_A_VISITOR)) and not self.drives(lease):
            raise self._not_driving()
        return msgspec.structs.replace(
            action,
            session=self.session,
            epoch=self.epoch,
            role="visitor" if is_visitor else "driver",
            user=self.who,
        )

    def _signal(
        self,
        signal: protocol.WantOffer | SdpAnswer | SdpOffer | Candidate | Bye,
        lease: Lease | None,
    ) -> Publish | ToSfu:
        if self.is_shut_out(lease) and not isinstance(signal, Bye):
            raise FrameRefused("private")
        if self.by_sfu and not isinstance(signal, SdpOffer):
            return ToSfu(signal)
        if self.by_sfu or isinstance(signal, protocol.WantOffer | SdpAnswer):
            raise FrameRefused("no_role")
        return Publish(f"signal/{self.peer}", self._stamp_signal(signal, lease))

    def _stamp_signal(self, signal: SdpOffer | Candidate | Bye, lease: Lease | None) -> Message:
        drives = self.holds(lease)
        if not drives and not self.watches:
            raise FrameRefused("not_driver" if self.role == "driver" else "no_role")
        if not isinstance(signal, SdpOffer):
            return signal
        return SdpOffer(
            sdp=signal.sdp,
            role="driver" if drives else "observer",
            session=self.session if drives else None,
            epoch=self.epoch if drives else 0,
            who=self.who,
            ice_servers=self.ice_servers(),
        )

    def _report(self, suffix: str, message: Message) -> protocol.PageReport:
        if self.session is None:
            raise FrameRefused("no_session")
        assert suffix in {"page/event", "page/network"}
        encoded = codec.encode(message)
        if len(encoded) > protocol.MAX_REPORT:
            raise FrameRefused("oversized")
        return protocol.PageReport(
            suffix=suffix,  # type: ignore[arg-type]
            session=self.session,
            message=msgspec.Raw(encoded),
        )

    def parting_stop(
        self, action_id: str, stamp: float, lease: Lease | None, now: float
    ) -> Stop | None:
        """Return the stop to send when the page's socket has closed; None when no velocity came
        over the socket within REPEAT_SECONDS: the page drives over the data channel, or has
        stopped by itself.
        """
        if now - self.velocity_at > REPEAT_SECONDS:
            return None
        return self.last_stop(action_id, stamp, lease)

    def last_stop(self, action_id: str, stamp: float, lease: Lease | None) -> Stop | None:
        """Return the stop to send for a page that has closed; None when it does not drive."""
        if not self.drives(lease):
            return None
        stop = Stop(action_id=action_id, stamp=stamp, seq=self.velocity_seq)
        stamped = self._stamp_stop(stop, lease)
        assert isinstance(stamped, Stop)
        return stamped


KNOWN = frozenset({*topics.FROM_PAGE, *protocol.TO_SERVER, protocol.SIGNAL})


def _split(frame: str | bytes) -> tuple[str, str]:
    if len(frame) > protocol.MAX_FRAME:
        raise Rejection("oversized", f"{len(frame)} bytes")
    text = frame if isinstance(frame, str) else frame.decode("utf-8", "replace")
    suffix, newline, payload = text.partition("\n")
    if not newline:
        raise Rejection("malformed", "no suffix in front of the message")
    return suffix, payload
