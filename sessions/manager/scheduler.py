"""The session manager's work in the database, twice a second: everything that is due, and the
messages to publish.

Synchronous, in one thread of the session manager. Each decision is stored before it is published,
and messages stay in `outbox` until the loop has published them, so that an error half-way loses
nothing.
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
from django.db.models import Q
from django.dispatch import Signal

from accounts import audit
from accounts.interventions import SITE_CHANGED
from accounts.models import AuditEntry
from robots.api import codec, topics
from robots.models import Robot
from robots.process import log_ids
from sessions import protocol, signals, system_log
from sessions.disk_full import is_disk_full
from sessions.leases import expiry, store, terms
from sessions.leases.absences import WebAbsences
from sessions.leases.policy import (
    PAGE_GONE_SECONDS,
    ActiveSession,
    Scene,
    minutes_until_turn,
    place_in_queue,
)
from sessions.leases.store import (
    LIVE,
    count_renewal,
    load_scene,
    load_scenes,
    message_of,
    rules_of,
)
from sessions.leases.transitions import (
    ANSWER_SECONDS,
    FirstMotion,
    RobotLink,
    SetState,
    Transition,
    TurnLimited,
    TurnUnlimited,
)
from sessions.models import Lease, Session, SessionEvent
from sessions.protocol import Ended, Notice, Offered, PresenceAsked, PresenceConfirmed, TurnWarning
from sessions.recording.items import CloseItem
from sessions.safety_test import course
from sessions.shards.ownership import EVERYTHING, Ownership, ShardChanges

logger = structlog.stdlib.get_logger(__name__)

CLOSE_AGAIN_SECONDS = 5.0
# How long a robot must fail to meet the next session's terms before its staff is called: a robot
# that has just connected may only not have reported yet.
CALL_SECONDS = 5.0
NEVER = (-1, 0.0)  # epoch and time of a lease that has not been published
UNREAD = ("presence__report", "doors", "description")  # columns of a robot that are not needed here


@dataclass(frozen=True)
class ManagerMessage:
    """A message to publish at QoS 1; leases are retained."""

    topic: str
    payload: bytes
    retain: bool = False


def _robot_of(outbound: ManagerMessage) -> str:
    return (topics.parse(outbound.topic) or ("",))[0]


def notice_message(notice: Notice) -> ManagerMessage:
    """Return the message by which a notice reaches the web process of its page."""
    frame = protocol.notice_frame(notice)
    return ManagerMessage(topics.session_notices(notice.session), frame.encode())


class Scheduler:
    """The session manager's memory between two ticks; everything else is in the database. Robots
    that are not ours belong to another session manager.
    """

    def __init__(self, ownership: Ownership = EVERYTHING) -> None:
        self._ownership, self._changes = ownership, ShardChanges(ownership)
        self._gained: dict[str, float] = {}  # robot: when it became ours while we ran
        self.outbox: deque[ManagerMessage] = deque()
        self._leases: dict[str, tuple[int, float]] = {}  # robot: epoch, when renewed
        self._counted: dict[str, tuple[int, int]] = {}  # robot: epoch, number of the newest copy
        # session: the last notice to its waiting page: place, whole minutes, reason; or the offer
        self._last_notice: dict[str, tuple[int, int, str] | Literal["offered"]] = {}
        self._warned: dict[str, int] = {}  # session: the end of its turn in the last warning
        # robot: which session was asked for a sign, and when
        self._asked: dict[str, tuple[str, float]] = {}
        self._web_absences = WebAbsences()
        # When the clock last jumped (Unix seconds). Until pages are seen again, it is not known how
        # long they have been away.
        self.stepped_at = -math.inf
        # session: why the robot does not meet its terms, and since when
        self._unready: dict[str, tuple[str, float]] = {}
        self._published: set[str] = set()
        self._closing: dict[str, float] = {}

    def begin(self) -> None:
        """Forget what was published, so that a new or restarted broker gets everything again.

        The broker may still have a lease of any robot from before a crash. The next renewal
        therefore publishes a lease for each robot, empty if it has no driver, and reads the leases
        itself: any that were read here could be out of date by then.
        """
        for outbound in [outbound for outbound in self.outbox if outbound.retain]:
            self.outbox.remove(outbound)
        names = Robot.objects.values_list("name", flat=True)
        self._leases = dict.fromkeys(filter(self._ownership.owns, names), NEVER)
        self._last_notice, self._warned = {}, {}
        if self._ownership.owns_site:
            _note_version(settings.VERSION)

    def _follow_changes(self, now: datetime.datetime) -> None:
        """Forget robots that have moved to another session manager. For newly acquired robots,
        publish everything again and wait for their first state.
        """
        if not self._changes:
            return
        names = list(Robot.objects.values_list("name", flat=True))  # may be refused: before `take`
        gained, lost = self._changes.take(names)
        for name in gained:
            self._gained[name] = now.timestamp()
            self._leases[name] = NEVER
        for name in lost:
            self._forget(name)

    def _forget(self, name: str) -> None:
        for known in (self._leases, self._counted, self._asked, self._gained):
            known.pop(name, None)
        for outbound in [one for one in self.outbox if one.retain and _robot_of(one) == name]:
            self.outbox.remove(outbound)  # its new owner publishes all of it

    def tick(
        self, links: dict[str, RobotLink], default: RobotLink, now: datetime.datetime
    ) -> list[CloseItem]:
        """Do everything that is due; return the sessions whose record can be closed.

        Args:
            links: the last messages of each robot, by name.
            default: for a robot that has sent none.
            now: aware.
        """
        self._follow_changes(now)
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
                due = expiry.tick(robot, link, now, scenes[robot.pk])
                for transition in due:
                    self._publish(transition, robot, now)
                self._withdraw_warning(scenes[robot.pk].holder, due)
                if robot.pk in queues:
                    self._publish_places(robot, now)
        return self._finish(now)

    def _busy_robots(self) -> list[Robot]:
        """Return those of our robots that have a session; only their rows are read in full."""
        living = Session.objects.filter(state__in=LIVE).values_list("robot_id", "robot__name")
        held = Lease.objects.filter(session__isnull=False).values_list("robot_id", "robot__name")
        ours = {key for key, name in {*living, *held} if self._ownership.owns(name)}
        if not ours:
            return []
        return list(Robot.objects.filter(pk__in=ours).defer(*UNREAD).order_by("name"))

    # --- notices ----------------------------------------------------------------------------------

    def _publish(self, transition: Transition, robot: Robot, now: datetime.datetime) -> None:
        match transition:
            case SetState():
                self._publish_state(transition, robot, now)
            case Offered() | PresenceAsked() | PresenceConfirmed():
                self._publish_recorded(transition, robot, now)
            case TurnWarning():
                self._warn(transition, now)
            case FirstMotion(session):
                self._note(session, "first_motion", now)
            case TurnLimited(session):
                self._note(session, "turn_limited", now)
            case TurnUnlimited(session):
                self._note(session, "turn_unlimited", now)
            case Ended(outcome="robot_fault" | "stopped_by_operator"):
                system_log.log(
                    "session_broken_off",
                    "warning",
                    robot=robot,
                    session=transition.session,
                    at=now,
                    outcome=transition.outcome,
                    reason=transition.reason,
                )

    def _publish_state(self, change: SetState, robot: Robot, now: datetime.datetime) -> None:
        self._note(change.session, change.state, now)
        if change.state == "driving" and change.session == self._asked.get(robot.name, ("",))[0]:
            # The visitor was disconnected and could not answer.
            asked = PresenceAsked(session=change.session, seconds=ANSWER_SECONDS)
            self._publish_recorded(asked, robot, now)

    def _publish_recorded(
        self,
        notice: Offered | PresenceAsked | PresenceConfirmed,
        robot: Robot,
        now: datetime.datetime,
    ) -> None:
        self._record(notice, now)
        self._send(notice)
        match notice:  # last, so that the next tick repeats what the database refused to record
            case Offered():
                self._last_notice[notice.session] = "offered"
            case PresenceAsked():
                self._asked[robot.name] = notice.session, now.timestamp()
            case PresenceConfirmed():
                del self._asked[robot.name]

    def _warn(self, warning: TurnWarning, now: datetime.datetime) -> None:
        session, at = warning.session, now.timestamp()
        remaining = warning.remaining or 0.0
        ends_at = round(at + remaining)
        if abs(self._warned.get(session, 0) - ends_at) > 1:
            rounded = msgspec.structs.replace(warning, remaining=round(remaining, 1))
            if not _is_warned(session, ends_at):
                self._record(rounded, now)
            self._send(rounded)
            self._warned = {one: end for one, end in self._warned.items() if end > at}
            self._warned[session] = ends_at

    def _withdraw_warning(self, holder: ActiveSession | None, due: tuple[Transition, ...]) -> None:
        """Tell a driver who was warned, and is not any more, that the turn has no end."""
        still = any(isinstance(each, TurnWarning | Ended) for each in due)
        if holder is not None and not still and self._warned.pop(holder.id, None) is not None:
            self._send(TurnWarning(session=holder.id, remaining=None))

    def _publish_places(self, robot: Robot, now: datetime.datetime) -> None:
        scene, rules = load_scene(robot, now), rules_of(robot)
        for session in scene.queue:
            if session.offered_at is not None:
                self._offer_again(session.id, session.offered_at + rules.start - now.timestamp())
                continue
            place = place_in_queue(scene, session.id, now.timestamp())
            minutes = minutes_until_turn(scene, place, rules, now.timestamp())
            published = (place, round(minutes), scene.waits_for)
            if self._last_notice.get(session.id) != published:
                self._last_notice[session.id] = published
                queued = protocol.Queued(
                    session=session.id, place=place, minutes=minutes, reason=scene.waits_for
                )
                self._send(queued)
        self._publish_unready(robot, scene, now)

    def _offer_again(self, session: str, seconds: float) -> None:
        """Send an offer again if a previous session manager or broker may have died before the page
        received it: a visitor without the notice loses the turn.
        """
        if self._last_notice.get(session) != "offered":
            self._last_notice[session] = "offered"
            self._send(Offered(session=session, seconds=max(0.0, seconds)))

    def _publish_unready(self, robot: Robot, scene: Scene, now: datetime.datetime) -> None:
        """Record which sessions a free robot is not ready for; send it to its dock if that helps,
        and call its staff after CALL_SECONDS.
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
        """Call the staff once for each session and reason, across restarts of this process."""
        called = SessionEvent.server_events(session, "staff_called").values_list("data", flat=True)
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
        SessionEvent.of_server(session, kind, now, data).save(force_insert=True)

    # --- leases -----------------------------------------------------------------------------------

    def renew(self, now: datetime.datetime) -> bool:
        """Publish every lease that is new or due, and an empty one for each robot that has lost its
        driver; tell whether there was any.

        A session may end after its lease is read here and before it is published, so that the robot
        receives the end first and the lease after it. Renewal is therefore separate from the tick,
        which takes longer, and the caller repeats it until there is nothing to publish.
        """
        self._follow_changes(now)
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
            if self._ownership.owns(name):  # a new owner publishes its lease
                self._publish_lease(name, b"")
        due = {}
        for name, (key, epoch, state) in held.items():
            if state == Session.State.WAITING:
                continue  # it is being granted: its terms are not fixed yet
            known, renewed = self._leases.get(name, NEVER)
            if known != epoch:
                # Spreads later renewals of robots that were taken together, as by a class.
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
        """Publish a lease; its next renewal is due `early` seconds sooner."""
        if self._count_renewal(lease):
            self._leases[lease.robot.name] = (lease.epoch, now.timestamp() - early)
            self._publish_lease(lease.robot.name, codec.encode(message_of(lease, now)))
            if (order := course.order_of(lease, now)) is not None:
                topic = topics.of(lease.robot.name, "command/action")
                self.outbox.append(ManagerMessage(topic, codec.encode(order)))

    def _count_renewal(self, lease: Lease) -> bool:
        """Give the next copy its number; False when the lease has changed since it was read.

        A full disk stores no numbers, and for the same reason no other process can change the
        lease: until there is room, the numbers are counted in memory.
        """
        epoch, counted = self._counted.get(lease.robot.name, (lease.epoch, 0))
        renewal: int = max(lease.renewal, counted if epoch == lease.epoch else 0) + 1
        try:
            ours = self._ownership.condition(lease.robot.name)
            if not count_renewal(lease, renewal, ours):
                return False
        except DatabaseError as error:
            if not is_disk_full(error):
                raise
            lease.renewal = renewal
        self._counted[lease.robot.name] = (lease.epoch, renewal)
        return True

    def _publish_lease(self, robot: str, payload: bytes) -> None:
        # Before all other messages: a driver without a lease would continue while those are sent.
        self.outbox.appendleft(ManagerMessage(topics.of(robot, "lease"), payload, retain=True))

    # --- ends -------------------------------------------------------------------------------------

    def _finish(self, now: datetime.datetime) -> list[CloseItem]:
        """Publish the end of sessions, by any process; return the records to close."""
        items, published, closing = [], self._published, self._closing
        self._published, self._closing = set(), {}  # forgets closed ones
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
        for known in (self._last_notice, self._unready):
            known.pop(str(session.pk), None)
        if SessionEvent.server_events(session, "ended").exists():
            return  # by a previous session manager
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


def _note_version(version: str) -> None:
    """Note in the log of interventions that this version serves the site, once."""
    rows = AuditEntry.objects.filter(act=SITE_CHANGED).order_by("-at")
    before = rows.values_list("detail", flat=True).first()
    if before != version:
        audit.note(SITE_CHANGED, role="server", detail=version, data={"version": [before, version]})


def _is_warned(session: str, ends_at: int) -> bool:
    """Tell whether the warning that the turn ends at this time has been recorded."""
    warnings = SessionEvent.server_events(session, protocol.NOTICE_NAMES[TurnWarning])
    ends = (stamp + data["remaining"] for stamp, data in warnings.values_list("stamp", "data"))
    return any(abs(end - ends_at) <= 1 for end in ends)


def needed_robots() -> frozenset[str]:
    """Return the names of the robots that the session manager needs: those with a living session,
    on the way to the next one, or that may still owe states. All others may be idle
    (robots/api/idle.py).
    """
    unclosed = Q(state__in=LIVE) | Q(state=Session.State.ENDED, closed_at=None)
    busy = Session.objects.filter(unclosed).values("robot_id")
    needed = Robot.objects.filter(
        Q(pk__in=busy) | ~Q(presence__turnaround=Robot.Turnaround.READY), enabled=True
    )
    return frozenset(needed.order_by().values_list("name", flat=True))


def send(signal: Signal, **news: Any) -> None:
    """Send a signal; an exception of a receiver is logged and reaches no other."""
    for receiver, answer in signal.send_robust(sender=Session, **news):
        if isinstance(answer, Exception):
            logger.error("signal_receiver_failed", receiver=receiver, exc_info=answer)
