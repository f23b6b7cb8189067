"""What the session manager does in the database twice a second: all that is due, and collecting
what is to be published.

Synchronous; all of it runs in one thread of the session manager. What it decides stands in the
database before anybody is told, and what is to be told waits in `outbox` until the loop has
published it, so that an error half-way loses nothing.
"""

import datetime
import math
import random
from collections import deque
from dataclasses import dataclass, replace
from typing import Any, Literal

import msgspec
import structlog
from django.conf import settings
from django.db import DatabaseError
from django.dispatch import Signal

from robots import log_ids
from robots.api import codec, topics
from robots.models import Robot
from sessions import protocol, signals, system_log
from sessions.disk_full import is_disk_full
from sessions.leases import expiry, store, terms
from sessions.leases.absences import WebAbsences
from sessions.leases.policy import PAGE_GONE_SECONDS, Scene, minutes_until_turn, place_in_queue
from sessions.leases.store import (
    LIVE,
    count_renewal,
    hold_of,
    lease_message,
    load_scene,
    load_scenes,
    rules_of,
)
from sessions.leases.transitions import (
    ANSWER_SECONDS,
    Act,
    FirstMotion,
    Move,
    RobotLink,
    TurnLimited,
    TurnUnlimited,
)
from sessions.models import Lease, Session, SessionEvent
from sessions.protocol import AskedThere, Ended, FoundThere, Notice, Offered, TurnWarning
from sessions.recording.items import CloseItem
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import EVERYTHING, Ownership

logger = structlog.stdlib.get_logger(__name__)

CLOSE_AGAIN_SECONDS = 5.0
# for which a robot is not as the next session needs it before anybody is called: one that has just
# come says how it is
CALL_SECONDS = 5.0
NEVER = (-1, 0.0)  # epoch and time of a lease that was not published yet
UNREAD = (
    "presence__report",
    "doors",
    "description",
)  # of a robot, which nobody needs here twice a second


@dataclass(frozen=True)
class ManagerMessage:
    """Something to publish at QoS 1; `retain` for leases."""

    topic: str
    payload: bytes
    retain: bool = False


def _robot_of(outbound: ManagerMessage) -> str:
    return (topics.parse(outbound.topic) or ("",))[0]


def notice_message(notice: Notice) -> ManagerMessage:
    """Return what web processes hand on to the session's page."""
    frame = protocol.notice_frame(notice)
    return ManagerMessage(topics.session_notices(notice.session), frame.encode())


class Scheduler:
    """Everything that the session manager remembers between two ticks; the rest is in the
    database. Robots that are not ours are another session manager's.
    """

    def __init__(self, ownership: Ownership = EVERYTHING) -> None:
        self._ownership = ownership
        self._version = ownership.version
        self._shards = frozenset(ownership.epochs)
        self._gained: dict[str, float] = {}  # robot: when it became ours while we ran
        self.outbox: deque[ManagerMessage] = deque()
        self._leases: dict[str, tuple[int, float]] = {}  # robot: epoch, when renewed
        self._counted: dict[str, tuple[int, int]] = {}  # robot: epoch, number of the newest copy
        # what who waits was told last: place, whole minutes, why it is not ready; or of their turn
        self._told: dict[str, tuple[int, int, str] | Literal["offered"]] = {}
        self._warned: dict[str, int] = {}  # session: when its turn ends, as it was last told
        # robot: which session was asked for a sign, and when
        self._asked: dict[str, tuple[str, float]] = {}
        self._web_absences = WebAbsences()
        # When the clock made a step (Unix seconds). Until pages were seen again since then, nothing
        # tells how long they have been away.
        self.stepped_at = -math.inf
        # session: why the robot is not as it needs it, and since when
        self._unready: dict[str, tuple[str, float]] = {}
        self._published: set[str] = set()
        self._closing: dict[str, float] = {}

    def begin(self) -> None:
        """Forget what was published: a new broker, or an old one that has forgotten it too, is told
        everything again.

        The broker may have kept a lease of any robot from before a crash, so that the next renewal
        tells each who drives, or that nobody does: what is read here may be out of date by then.
        """
        for outbound in [outbound for outbound in self.outbox if outbound.retain]:
            self.outbox.remove(outbound)
        names = Robot.objects.values_list("name", flat=True)
        self._leases = dict.fromkeys(filter(self._ownership.owns, names), NEVER)
        self._told, self._warned = {}, {}

    def _follow_ownership(self, now: datetime.datetime) -> None:
        """Forget robots that another session manager has by now; tell those that are ours by now
        everything again, and give them time to say something.
        """
        version, epochs = self._ownership.version, self._ownership.epochs
        if self._version == version:
            return
        names = list(Robot.objects.values_list("name", flat=True))  # first, since it may be refused
        gained = epochs.keys() - self._shards
        self._version, self._shards = version, frozenset(epochs)
        for name in names:
            if shard_of(name) in gained:
                self._gained[name] = now.timestamp()
                self._leases[name] = NEVER
            elif shard_of(name) not in epochs:
                self._forget(name)

    def _forget(self, name: str) -> None:
        for known in (self._leases, self._counted, self._asked, self._gained):
            known.pop(name, None)
        for outbound in [one for one in self.outbox if one.retain and _robot_of(one) == name]:
            self.outbox.remove(outbound)  # its new owner says all of it

    def tick(
        self, links: dict[str, RobotLink], default: RobotLink, now: datetime.datetime
    ) -> list[CloseItem]:
        """Do what is due everywhere; return the sessions whose record can be closed.

        Args:
            links: what was last heard of each robot, by name.
            default: for a robot that was not heard of.
            now: aware.
        """
        self._follow_ownership(now)
        queues = set(
            Session.objects.filter(state=Session.State.WAITING).values_list("robot_id", flat=True)
        )
        robots = self._busy_robots()
        scenes = load_scenes(robots, now)
        for robot in robots:
            link = links.get(robot.name, default)
            if (gained := self._gained.get(robot.name, 0.0)) > now.timestamp():
                # the clock was set back: the robot has as long from now on
                gained = self._gained[robot.name] = now.timestamp()
            since = max(link.since, gained)
            link = replace(link, since=since, asked=self._asked.get(robot.name))
            with log_ids.about(robot=robot.name), self._ownership.about(robot.name):
                if now.timestamp() - self.stepped_at >= PAGE_GONE_SECONDS:
                    self._web_absences.tick(scenes[robot.pk].holder, now)
                for act in expiry.tick(robot, link, now, scenes[robot.pk]):
                    self._publish(act, robot, now)
                if robot.pk in queues:
                    self._publish_places(robot, now)
        return self._finish(now)

    def _busy_robots(self) -> list[Robot]:
        """Return those of our robots that have a session; of others not even the rows are read."""
        living = Session.objects.filter(state__in=LIVE).values_list("robot_id", "robot__name")
        held = Lease.objects.filter(session__isnull=False).values_list("robot_id", "robot__name")
        ours = {key for key, name in {*living, *held} if self._ownership.owns(name)}
        if not ours:
            return []
        return list(Robot.objects.filter(pk__in=ours).defer(*UNREAD).order_by("name"))

    # --- notices ----------------------------------------------------------------------------------

    def _publish(self, act: Act, robot: Robot, now: datetime.datetime) -> None:
        match act:
            case Move():
                self._publish_moved(act, robot, now)
            case Offered() | AskedThere() | FoundThere():
                self._publish_recorded(act, robot, now)
            case TurnWarning():
                self._warn(act, now)
            case FirstMotion(session):
                self._note(session, "first_motion", now)
            case TurnLimited(session):
                self._note(session, "turn_limited", now)
            case TurnUnlimited(session):
                self._note(session, "turn_unlimited", now)
                self._warned.pop(session, None)
            case Ended(outcome="robot_fault" | "stopped_by_operator"):
                system_log.log(
                    "session_broken_off",
                    "warning",
                    robot=robot,
                    session=act.session,
                    at=now,
                    outcome=act.outcome,
                    reason=act.reason,
                )

    def _publish_moved(self, move: Move, robot: Robot, now: datetime.datetime) -> None:
        self._note(move.session, move.state, now)
        if move.state == "driving" and move.session == self._asked.get(robot.name, ("",))[0]:
            # Who was away could not answer, and is asked once more.
            asked = AskedThere(session=move.session, seconds=ANSWER_SECONDS)
            self._publish_recorded(asked, robot, now)

    def _publish_recorded(
        self, notice: Offered | AskedThere | FoundThere, robot: Robot, now: datetime.datetime
    ) -> None:
        self._record(notice, now)
        self._send(notice)
        match notice:  # last: what the database refused to record is said at the next tick
            case Offered():
                self._told[notice.session] = "offered"
            case AskedThere():
                self._asked[robot.name] = notice.session, now.timestamp()
            case FoundThere():
                del self._asked[robot.name]

    def _warn(self, warning: TurnWarning, now: datetime.datetime) -> None:
        session, at = warning.session, now.timestamp()
        ends_at = round(at + warning.remaining)
        if abs(self._warned.get(session, 0) - ends_at) > 1:
            rounded = TurnWarning(session=session, remaining=round(warning.remaining, 1))
            if not _is_warned(session, ends_at):
                self._record(rounded, now)
            self._send(rounded)
            self._warned = {one: end for one, end in self._warned.items() if end > at}
            self._warned[session] = ends_at

    def _publish_places(self, robot: Robot, now: datetime.datetime) -> None:
        scene, rules = load_scene(robot, now), rules_of(robot)
        for session in scene.queue:
            if session.offered_at is not None:
                self._offer_again(session.id, session.offered_at + rules.start - now.timestamp())
                continue
            place = place_in_queue(scene, session.id, now.timestamp())
            minutes = minutes_until_turn(scene, place, rules, now.timestamp())
            published = (place, round(minutes), scene.waits_for)
            if self._told.get(session.id) != published:
                self._told[session.id] = published
                queued = protocol.Queued(
                    session=session.id, place=place, minutes=minutes, reason=scene.waits_for
                )
                self._send(queued)
        self._publish_unready(robot, scene, now)

    def _offer_again(self, session: str, seconds: float) -> None:
        """Say that a turn is offered where a session manager or a broker before this one may have
        died between its decision and the page: a visitor who never hears of it loses the turn.
        """
        if self._told.get(session) != "offered":
            self._told[session] = "offered"
            self._send(Offered(session=session, seconds=max(0.0, seconds)))

    def _publish_unready(self, robot: Robot, scene: Scene, now: datetime.datetime) -> None:
        """Note for whom a free robot is not ready; have it go home if that helps, and after some
        seconds call those who look after it.
        """
        if not scene.ready or scene.holder is not None:
            return
        for session in scene.queue:
            reason = session.not_ready.removeprefix(f"{terms.START}: ")
            before, since = self._unready.get(session.id, ("", now.timestamp()))
            if reason != before:
                if reason == terms.NOT_DOCKED and store.send_home(robot, now):
                    system_log.log(
                        "robot_sent_home", robot=robot, session=session.id, at=now, reason=reason
                    )
                self._note(
                    session.id,
                    "robot_not_ready" if reason else "robot_ready",
                    now,
                    **({"reason": reason} if reason else {}),
                )
                self._unready[session.id] = reason, now.timestamp()
            elif reason and now.timestamp() - since >= CALL_SECONDS:
                self._call_staff(robot, session.id, reason, now)

    def _call_staff(self, robot: Robot, session: str, reason: str, now: datetime.datetime) -> None:
        """Once for each session and reason, whatever a session manager before this one has done."""
        called = _recorded(session, "staff_called").values_list("data", flat=True)
        if reason in {data.get("reason") for data in called}:
            return
        self._note(session, "staff_called", now, reason=reason)
        system_log.log(
            "robot_not_ready", "warning", robot=robot, session=session, at=now, reason=reason
        )
        send(
            signals.not_ready,
            robot=robot,
            session=Session.objects.get(pk=session),
            reason=reason,
            at=now,
        )

    def _send(self, notice: Notice) -> None:
        self.outbox.append(notice_message(notice))

    def _record(self, notice: Notice, now: datetime.datetime) -> None:
        data = msgspec.to_builtins(notice)
        self._note(data.pop("session"), protocol.NOTICE_NAMES[type(notice)], now, **data)

    @staticmethod
    def _note(session: str, kind: str, now: datetime.datetime, **data: Any) -> None:
        SessionEvent.objects.create(
            session_id=session,
            source=SessionEvent.Source.SERVER,
            type=kind,
            stamp=now.timestamp(),
            received_at=now.timestamp(),
            data=data,
        )

    # --- leases -----------------------------------------------------------------------------------

    def renew(self, now: datetime.datetime) -> bool:
        """Publish every lease that is new or due, and that nobody drives where somebody did; tell
        whether there was any.

        A session may end between the reading of its lease and the publishing, and the robot hear of
        its end first. So this is no part of a look, which takes longer, and whoever has published a
        lease asks again at once.
        """
        self._follow_ownership(now)
        before = len(self.outbox)
        rows = Lease.objects.filter(session__state__in=LIVE).values_list(
            "robot__name", "robot_id", "epoch", "session__state"
        )
        held = {
            name: (key, epoch, state)
            for name, key, epoch, state in rows
            if self._ownership.owns(name)
        }
        for name in self._leases.keys() - held.keys():
            del self._leases[name]
            self._counted.pop(name, None)
            if self._ownership.owns(name):  # who got it meanwhile says who drives it
                self._publish_lease(name, b"")
        due = {}
        for name, (key, epoch, state) in held.items():
            if state == Session.State.WAITING:
                continue  # it is being granted: its terms are not fixed yet
            known, renewed = self._leases.get(name, NEVER)
            if known != epoch:
                # Robots that were taken together, as by a class, are not renewed together from then
                # on.
                due[key] = random.random() * settings.LEASE_RENEWAL_SECONDS
            elif now.timestamp() - renewed >= settings.LEASE_RENEWAL_SECONDS:
                due[key] = 0.0
        if due:
            living = Lease.objects.filter(robot__in=due, session__state__in=LIVE).exclude(
                session__state=Session.State.WAITING
            )
            for lease in living.select_related("robot", "session__visitor"):
                self._renew_one(lease, now, due[lease.robot_id])
        return len(self.outbox) > before

    def _renew_one(self, lease: Lease, now: datetime.datetime, early: float) -> None:
        """Publish a lease; the next renewal comes so many seconds sooner."""
        renewal = self._count_renewal(lease)
        if renewal is None:
            return
        self._leases[lease.robot.name] = (lease.epoch, now.timestamp() - early)
        hold = hold_of(lease)
        session = lease.session
        assert session is not None
        fixed, who = terms.of(session), session.visitor.sent_name
        message = lease_message(
            lease.robot,
            who,
            hold,
            renewal=renewal,
            stamp=now.timestamp(),
            assist=session.assist,
            fixed=fixed,
        )
        self._publish_lease(lease.robot.name, codec.encode(message))

    def _count_renewal(self, lease: Lease) -> int | None:
        """Return the number of the next copy, None when the lease has changed meanwhile.

        A full disk takes no numbers, and nobody else can get the lease either: they are counted
        here until there is room.
        """
        epoch, counted = self._counted.get(lease.robot.name, (lease.epoch, 0))
        renewal: int = max(lease.renewal, counted if epoch == lease.epoch else 0) + 1
        try:
            ours = self._ownership.condition(lease.robot.name)
            if count_renewal(lease, renewal, ours) is None:
                return None
        except DatabaseError as error:
            if not is_disk_full(error):
                raise
        self._counted[lease.robot.name] = (lease.epoch, renewal)
        return renewal

    def _publish_lease(self, robot: str, payload: bytes) -> None:
        # Before all news: whoever drives without a lease would go on for as long as those take.
        self.outbox.appendleft(ManagerMessage(topics.of(robot, "lease"), payload, retain=True))

    # --- ends -------------------------------------------------------------------------------------

    def _finish(self, now: datetime.datetime) -> list[CloseItem]:
        """Tell of sessions that have ended, whoever ended them, and ask for their records to be
        closed.
        """
        items, published, closing = [], self._published, self._closing
        self._published, self._closing = set(), {}  # what is closed by now need not be remembered
        for session in Session.objects.filter(
            state=Session.State.ENDED, closed_at=None
        ).select_related("robot"):
            if not self._ownership.owns(session.robot.name):
                continue
            key = str(session.pk)
            if key not in published:
                with self._ownership.about(session.robot.name):
                    self._publish_end(session, now)
            self._published.add(key)
            self._closing[key] = closing.get(key, 0.0)
            if now.timestamp() - self._closing[key] >= CLOSE_AGAIN_SECONDS:
                self._closing[key] = now.timestamp()
                ended_at = (session.ended_at or now).timestamp()
                granted = session.granted_at is not None
                items.append(CloseItem(session.robot.name, key, ended_at, granted))
        return items

    def _publish_end(self, session: Session, now: datetime.datetime) -> None:
        for known in (self._told, self._unready):
            known.pop(str(session.pk), None)
        if _recorded(str(session.pk), "ended").exists():
            return  # by a session manager before this one
        ended = Ended(
            session=str(session.pk), outcome=session.outcome, reason=session.outcome_reason
        )
        self._send(ended)
        send(signals.session_ended, session=session)
        self._record(ended, now)
        system_log.log(
            "session_ended",
            robot=session.robot,
            session=session,
            at=now,
            outcome=session.outcome,
            reason=session.outcome_reason,
        )


def _recorded(session: str, kind: str) -> Any:
    """Return what session managers, this or those before, have recorded of this kind."""
    return SessionEvent.objects.filter(
        session=session, source=SessionEvent.Source.SERVER, type=kind
    )


def _is_warned(session: str, ends_at: int) -> bool:
    """Tell whether the warning that the turn ends at this time has been recorded."""
    warnings = _recorded(session, protocol.NOTICE_NAMES[TurnWarning])
    ends = (stamp + data["remaining"] for stamp, data in warnings.values_list("stamp", "data"))
    return any(abs(end - ends_at) <= 1 for end in ends)


def send(signal: Signal, **news: Any) -> None:
    """Send a signal; what a receiver raises is logged and stops nobody."""
    for receiver, answer in signal.send_robust(sender=Session, **news):
        if isinstance(answer, Exception):
            logger.error("signal_receiver_failed", receiver=receiver, exc_info=answer)
