"""Taking, keeping and giving up the robot: the decisions of sessions/leases/policy.py carried out
in the database.

Any process may call these at any time, on any of the supported databases. Correctness rests on two
things alone, never on a transaction: a lease changes only where its epoch is still the one that was
read, and `live_key` is unique, so that a visitor has one living session at a robot.

What a consumer calls, each through consumers/database.py:

- `take` for `session/take`. On `TakeGranted` publish `granted.lease` (retained) at once; the
  session manager renews it.
- `seen`, through consumers/last_seen.py, every `leases.PAGE_SEEN_EVERY` seconds while the page's
  socket is open with a session; `take` says it, too;
- `page_gone` when the socket closes: the session goes on for as long as its heartbeat or its grace
  period lasts;
- `leave` for `session/leave`. On True publish an empty retained lease if the page was driving, and
  the news `ended`.

Sessions are always read before the lease and changed before it is released: whoever reads in
between sees a lease that names an ended session, which counts as free, and never a session that
seems to have lost its lease.
"""

import datetime
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
from django.conf import settings
from django.db import IntegrityError, transaction
from django.db.models import Q

from accounts.models import User
from robots.access import may_operate
from robots.api import messages as m
from robots.models import Robot, RobotPresence
from robots.presence.report import standstill_of
from sessions.leases import terms
from sessions.leases.absences import note_page_closed
from sessions.leases.policy import (
    PAGE_GONE_SECONDS,
    ActiveSession,
    Ask,
    Grant,
    Hold,
    Resume,
    Rules,
    Scene,
    Wait,
    decide_take,
    turn_end,
)
from sessions.leases.readiness import STOPPED
from sessions.leases.terms import FREE, Terms, UnreadableTerms
from sessions.models import AT_THE_WHEEL, Lease, Session
from sessions.protocol import Queued, Refused

LIVE = (Session.State.WAITING, *AT_THE_WHEEL)
# Every failed attempt means that another process changed the lease in between, so that this bound
# is never met by chance.
ATTEMPTS = 200
# the reason of a session that ended because the visitor began another one, on somebody's terms
BEGINS_ANEW = "begins_anew"
CLOSED = 1001  # the code of a page that was closed or left
REASON_LENGTH = 300  # of robots.api.messages.Reason
HELD = "held"  # of a robot whose visits somebody has paused
LEFT_QUEUE = "left_queue"  # the reason of a session that ended before it had the robot


class LeaseContention(RuntimeError):
    """The lease changed under every attempt to take it."""


@dataclass(frozen=True)
class TakeGranted:
    """The page drives. `resumed`: epoch and peer are those of before; `turn_seconds` is None while
    nobody else waits.

    `terms` are those of the session, `shown` what there is to see of its task
    (sessions/leases/terms.py).
    """

    session: str
    epoch: int
    peer: str
    resumed: bool
    turn_seconds: float | None
    lease: m.Lease
    terms: Terms = FREE
    shown: dict[str, Any] = field(default_factory=dict)


Taken = TakeGranted | Queued | Refused


def is_study(session: str) -> bool:
    """Tell whether a session belongs to a study."""
    row = Session.objects.filter(pk=session).first()
    return row is not None and bool(terms.of(row).study)


def take(  # noqa: D417 -- the rest is what the page said
    robot: Robot,
    visitor: User,
    peer: str,
    *,
    session: str | None = None,
    old_peer: str | None = None,
    takeover: bool = False,
    device: dict[str, Any] | None = None,
    now: datetime.datetime,
) -> Taken:
    """Give the robot to a page, put it in the queue, or say why not.

    Whether this visitor may drive this robot at all was asked before (robots/access.py).

    Args:
        robot: freshly read, because presence and limits are taken from it.
        visitor: who asks.
        peer: the id that the server made for this page's connection.
        device: what sessions.devices.device_of said, kept with a new session.
        now: aware.

    Raises:
        LeaseContention: the lease changed under every attempt.
    """
    asker = _Asker(robot, visitor, peer, device or {}, now)
    Lease.objects.get_or_create(robot=robot, defaults={"changed_at": now})
    for _ in range(ATTEMPTS):
        scene = load_scene(robot, now)
        ask = Ask(
            visitor=str(visitor.pk),
            peer=peer,
            session=session,
            old_peer=old_peer,
            takeover=takeover,
            operator=(robot.presence.turnaround != Robot.Turnaround.READY or bool(scene.waits_for))
            and bool(may_operate(visitor, robot)),
            not_ready=terms.not_ready(visitor, robot, now) if scene.holder is None else "",
        )
        taken = _carry_out(decide_take(scene, ask, rules_of(robot), now.timestamp()), scene, asker)
        if taken is not None:
            return taken
    raise LeaseContention(robot.name)


@dataclass(frozen=True)
class _Asker:
    """The page that asks, with everything that carrying out an answer needs."""

    robot: Robot
    visitor: User
    peer: str
    device: dict[str, Any]
    now: datetime.datetime


def _carry_out(
    decision: Grant | Resume | Wait | Refused, scene: Scene, asker: _Asker
) -> Taken | None:
    """Return what the page is told, or None when another process was quicker and the question must
    be asked again.
    """
    match decision:
        case Refused(reason="elsewhere", session=session):
            own = Session.objects.filter(pk=session).first()
            return msgspec.structs.replace(decision, since=began(own))
        case Refused():
            return decision
        case Resume(session):
            seen({session}, asker.now)
            return _granted(scene, scene.hold, asker, resumed=True)
        case Wait(waiting, place, minutes, reason):
            session = _join(asker) if waiting is None else waiting
            if session is None:
                return None
            seen({session}, asker.now)
            return Queued(session=session, place=place, minutes=minutes, reason=reason)
        case Grant():
            return _grant(decision, scene, asker)


def _join(asker: _Asker) -> str | None:
    """Make a waiting session, or return None when the visitor has got one meanwhile, from another
    tab.
    """
    key = live_key(asker.robot, asker.visitor)
    try:
        # only so that PostgreSQL survives the refusal within a caller's transaction
        with transaction.atomic():
            made = Session.objects.create(
                robot=asker.robot,
                visitor=asker.visitor,
                live_key=key,
                queued_at=asker.now,
                seen_at=asker.now,
                device=asker.device,
            )
    except IntegrityError:
        return None
    return str(made.pk)


def _grant(grant: Grant, scene: Scene, asker: _Asker) -> TakeGranted | Refused | None:
    session = _join(asker) if grant.session is None else grant.session
    if session is None:
        return None
    hold = replace(scene.hold, epoch=scene.hold.epoch + 1, session=session, peer=asker.peer)
    if not grant.returning:
        hold = replace(hold, wizard_peer="")
    if not change_lease(
        asker.robot,
        scene.hold.epoch,
        session=session,
        peer=asker.peer,
        now=asker.now,
        wizard_stays=grant.returning,
    ):
        return None
    try:
        fix_terms(session, asker.now)
    except terms.NotGranted as refusal:
        end(session, Session.Outcome.CANCELLED, str(refusal), asker.now)
        return Refused(reason=str(refusal), session=session)  # type: ignore[arg-type]
    changes: dict[str, Any] = {
        "state": grant.state,
        "seen_at": asker.now,
        "lost_at": asker.now if grant.state == "reconnecting" else None,
    }
    if not grant.returning:
        changes |= {
            "granted_at": max(asker.now, _moment(scene.changed_at)),
            "offered_at": None,
            "turn_ends_at": None,
        }
    if not Session.objects.filter(pk=session, state__in=LIVE).update(**changes):
        # it was ended from another tab meanwhile
        change_lease(asker.robot, hold.epoch, session=None, peer="", now=asker.now)
        return None
    return _granted(scene, hold, asker, resumed=False)


def fix_terms(session: str, now: datetime.datetime) -> None:
    """Store the terms of a session that has just got the robot. Before its state says so: until
    then no renewed lease tells the robot of it.

    Asked for again until the session has moved the robot, for whoever asked first may not have
    lived to store them.

    Raises:
        NotGranted: there are none on which it could go.
    """
    row = Session.objects.select_related("robot", "visitor").get(pk=session)
    if row.terms or row.first_motion_at is not None:
        return
    fixed = terms.of_granted(row, now)
    changes: dict[str, Any] = {}
    if fixed != FREE:
        changes["terms"] = terms.stored(fixed)
    if fixed.assist is None and not fixed.study and (level := _assistance_to_begin_with(row)):
        changes["assist"] = level
    if changes:
        Session.objects.filter(pk=session).update(**changes)


def _assistance_to_begin_with(row: Session) -> str:
    """Return the assistance that a visitor has who has not chosen any yet, on a robot that could
    assist and by itself does not: the one that they had last, and at first one that stops at
    obstacles. Empty for the robot's own level.
    """
    robot = row.robot
    can_assist = "assist" in (robot.presence.factsheet or {}).get("capabilities", ())
    if row.assist or robot.assist != Robot.DriveAssist.OFF or not can_assist:
        return ""
    driven = Session.objects.filter(visitor=row.visitor, first_motion_at__isnull=False)
    had = driven.exclude(assist="").order_by("first_motion_at").values_list("assist", flat=True)
    return had.last() or ("" if driven.exists() else Robot.DriveAssist.SLOW)


def _granted(scene: Scene, hold: Hold, asker: _Asker, *, resumed: bool) -> TakeGranted:
    assert hold.session is not None
    session, now, key = Session.objects.get(pk=hold.session), asker.now.timestamp(), hold.session
    fixed = terms.of(session)
    before = next((each for each in scene.sessions if each.id == key and each.granted_at), None)
    holder = before or ActiveSession(
        key, str(asker.visitor.pk), "connecting", now, granted_at=now, turn=fixed.turn_seconds
    )
    limited = fixed.turn_always or any(waiting.id != key for waiting in scene.queue)
    turn_seconds = max(0.0, turn_end(holder, rules_of(asker.robot), now) - now) if limited else None
    renewal = (
        Lease.objects.values_list("renewal", flat=True).get(robot=asker.robot) if resumed else 0
    )
    who = asker.visitor.sent_name
    lease = lease_message(
        asker.robot, who, hold, renewal=renewal, stamp=now, assist=session.assist, fixed=fixed
    )
    return TakeGranted(
        key, hold.epoch, hold.peer, resumed, turn_seconds, lease, fixed, terms.shown(key)
    )


def set_assist(session: str, level: str, *, peer: str) -> tuple[Hold, int] | None:
    """Note what the driver chose, and return the lease and its next renewal; None when this page
    does not drive any more.

    Whether the driver has a choice was asked before (sessions/consumers/queries.py).
    """
    drives = Lease.objects.filter(session_id=session, peer=peer)
    if not drives.exists():
        return None
    if not Session.objects.filter(pk=session, state__in=LIVE).update(assist=level):
        return None
    while (lease := drives.first()) is not None:
        if renewal := count_renewal(lease, lease.renewal + 1):
            return hold_of(lease), renewal
    return None


def count_renewal(lease: Lease, renewal: int, *only_if: Q) -> int | None:
    """Store the number of the next copy of a lease and return it; None when the lease has changed
    since it was read. No two copies get one number: of two, the robot ignores what came last.
    """
    same = Lease.objects.filter(
        *only_if, robot=lease.robot_id, epoch=lease.epoch, renewal=lease.renewal
    )
    return renewal if same.update(renewal=renewal) else None


def seen(sessions: Collection[str], now: datetime.datetime) -> set[str]:
    """Note that a page of each of these sessions is open; return those that have not ended."""
    found = list(
        Session.objects.filter(pk__in=sessions, state__in=LIVE).values_list(
            "pk", "state", "lost_at"
        )
    )
    live = [key for key, _, _ in found]
    # A waiting session has no other sign of life: its page is what was lost, and is back.
    if back := [
        key
        for key, state, lost_at in found
        if state == Session.State.WAITING and lost_at is not None
    ]:
        Session.objects.filter(pk__in=back, state=Session.State.WAITING).update(lost_at=None)
    if live:
        Session.objects.filter(pk__in=live, state__in=LIVE).update(seen_at=now)
    return {str(key) for key in live}


def page_gone(session: str, peer: str, now: datetime.datetime, code: int = CLOSED) -> None:
    """Note that a page closed its socket, with the code of its end; ignored when another page of
    the visitor has taken over.
    """
    if Lease.objects.filter(session_id=session).exclude(peer=peer).exists():
        return
    living = Session.objects.filter(pk=session, state__in=LIVE)
    living.update(seen_at=None)
    if living.exclude(state=Session.State.WAITING).exists():
        note_page_closed(session, code, now)
    Session.objects.filter(pk=session, state=Session.State.WAITING).update(lost_at=now)


def leave(session: str, *, peer: str, now: datetime.datetime) -> bool:
    """End a session because its page says so: completed when the robot was driven and its terms ask
    for no more, cancelled otherwise.

    Returns:
        False when nothing was ended: the session is over, or has moved to another page of the
            visitor.
    """
    if Lease.objects.filter(session_id=session).exclude(peer=peer).exists():
        return False
    row = Session.objects.filter(pk=session, state__in=LIVE).first()
    if row is None:
        return False
    if row.state == Session.State.WAITING:
        return end(session, Session.Outcome.CANCELLED, LEFT_QUEUE, now)
    completed = row.first_motion_at is not None and terms.of(row).leaving_completes
    return end(
        session, Session.Outcome.COMPLETED if completed else Session.Outcome.CANCELLED, "left", now
    )


def end(session: str, outcome: str, reason: str, now: datetime.datetime, **only_if: Any) -> bool:
    """End a session, and free the robot if it held it; of several callers one gets True.

    `only_if` are further conditions on the row, of a caller who decided on an earlier reading.
    """
    _send_home(session, now)  # before the robot is free, so that nobody takes it on its way
    ended = (
        Session.objects.filter(pk=session, state__in=LIVE)
        .filter(**only_if)
        .update(
            state=Session.State.ENDED,
            outcome=outcome,
            outcome_reason=reason,
            live_key=str(session),
            ended_at=now,
            turn_ends_at=None,
            offered_at=None,
        )
    )
    if ended:
        for lease in Lease.objects.filter(session_id=session).select_related("robot"):
            change_lease(lease.robot, lease.epoch, session=None, peer="", now=now)
    return bool(ended)


def _send_home(session: str, now: datetime.datetime) -> None:
    """Have the robot that a session holds return before it is anybody's; the session manager undoes
    this for one that is still driven.
    """
    for lease in Lease.objects.filter(session_id=session).select_related("robot"):
        send_home(lease.robot, now)


def send_home(robot: Robot, now: datetime.datetime) -> bool:
    """Have a robot go home before anybody gets it; False when it does not do that, or is on its way
    already.
    """
    if not robot.can_go_home:
        return False
    ready = RobotPresence.objects.filter(robot=robot, turnaround=Robot.Turnaround.READY)
    return bool(
        ready.update(
            turnaround=Robot.Turnaround.RETURNING, turnaround_reason="dock", turnaround_at=now
        )
    )


def change_lease(
    robot: Robot,
    epoch: int,
    *,
    session: str | None,
    peer: str,
    now: datetime.datetime,
    wizard_stays: bool = False,
) -> bool:
    """Change the lease if its epoch is still this one; the only statement that ever does.

    A hidden operator is one of a session: `wizard_stays` when the same session goes on.
    """
    changed = Lease.objects.filter(robot=robot, epoch=epoch)
    wizard: dict[str, Any] = {} if wizard_stays else {"wizard_peer": "", "wizard": None}
    return bool(
        changed.update(
            epoch=epoch + 1, session_id=session, peer=peer, renewal=0, changed_at=now, **wizard
        )
    )


def hold_of(lease: Lease) -> Hold:
    """Return what a lease's row says."""
    return Hold(
        lease.epoch,
        str(lease.session_id) if lease.session_id else None,
        lease.peer,
        lease.wizard_peer,
        lease.wizard_epoch,
    )


def live_key(robot: Robot, visitor: User) -> str:
    """Return what makes a visitor's living session at a robot the only one."""
    return f"{robot.pk}:{visitor.pk}"


def rules_of(robot: Robot) -> Rules:
    """Return how long things take at this robot."""
    minutes = robot.turn_minutes if robot.turn_minutes is not None else settings.TURN_MINUTES
    return Rules(
        turn=minutes * 60.0,
        warning=settings.TURN_WARNING_SECONDS,
        start=settings.START_SECONDS,
        grace=settings.GRACE_SECONDS,
        idle=settings.IDLE_SECONDS,
    )


def lease_message(
    robot: Robot,
    who: str,
    hold: Hold,
    *,
    renewal: int,
    stamp: float,
    assist: str = "",
    fixed: Terms = FREE,
) -> m.Lease:
    """Return what the robot is told of a lease that somebody holds.

    `assist` is what the visitor chose, if anything; `fixed` are the terms of the session, which go
    before it.
    """
    assert hold.session is not None
    limits = m.LeaseLimits(
        linear=_least(robot.max_linear, fixed.linear),
        angular=_least(robot.max_angular, fixed.angular),
    )
    lease = m.Lease(
        session=hold.session,
        epoch=hold.epoch,
        peer=hold.peer,
        who=who[:120],
        renewal=renewal,
        stamp=stamp,
        ttl=settings.LEASE_TTL_SECONDS,
        limits=limits,
        assist=fixed.assist or assist or None,
        methods=fixed.controllers,
        ways=None if fixed.control_way == "any" else (fixed.control_way,),
        actions=fixed.actions,
        private=fixed.private,
    )
    return lease if fixed.driver == "visitor" else _for_wizard(lease, hold)


def _for_wizard(lease: m.Lease, hold: Hold) -> m.Lease:
    """Return the lease of a session in which a hidden operator drives: limits and assistance hold
    for them too, what else is fixed is the visitor's. The operator's commands come by the server
    alone, which records them as parts of the script or as deviations.
    """
    return msgspec.structs.replace(
        lease,
        kind="wizard",
        wizard=hold.wizard_peer or None,
        wizard_epoch=hold.wizard_epoch,
        methods=None,
        ways=("mqtt",),
        actions=None,
    )


def _least(*limits: float | None) -> float | None:
    return min((limit for limit in limits if limit is not None), default=None)


def load_scene(robot: Robot, now: datetime.datetime) -> Scene:
    """Read what a decision about the robot looks at."""
    return load_scenes([robot], now)[robot.pk]


def load_scenes(robots: Sequence[Robot], now: datetime.datetime) -> dict[Any, Scene]:
    """Read what decisions about robots look at, by the robots' keys, in as many queries as for one:
    sessions first, then leases (see the top).
    """
    keys = [robot.pk for robot in robots]
    active: dict[Any, dict[str, ActiveSession]] = {key: {} for key in keys}
    sessions: dict[str, Session] = {}
    for session in Session.objects.filter(robot__in=keys, state__in=LIVE).defer(
        "device", "summary"
    ):
        active[session.robot_id][str(session.pk)], sessions[str(session.pk)] = (
            session_of(session),
            session,
        )
    leases = {lease.robot_id: lease for lease in Lease.objects.filter(robot__in=keys)}
    # Whoever has a robot and was not among them perhaps began after they were read.
    late = [
        lease.session_id
        for key, lease in leases.items()
        if lease.session_id and str(lease.session_id) not in active[key]
    ]
    for session in Session.objects.filter(pk__in=late, state__in=LIVE) if late else ():
        active[session.robot_id][str(session.pk)] = session_of(session)
    pauses = _pauses_of(keys)
    scenes = {
        robot.pk: _scene(
            robot,
            leases.get(robot.pk),
            tuple(active[robot.pk].values()),
            pauses.get(robot.pk, ""),
            now,
        )
        for robot in robots
    }
    return {robot.pk: _asked_if_ready(scenes[robot.pk], robot, sessions, now) for robot in robots}


def _asked_if_ready(
    scene: Scene, robot: Robot, sessions: dict[str, Session], now: datetime.datetime
) -> Scene:
    """Ask for whoever would be next whether a free robot is as they need it."""
    if scene.holder is not None or not scene.ready:
        return scene
    open_now = [each for each in scene.queue if each.page_open(now.timestamp())]
    next_ones = {
        each.id
        for each in (*open_now[:1], *(each for each in open_now if each.offered_at is not None))
    }
    why = {
        key: terms.not_ready(sessions[key].visitor, robot, now)
        for key in next_ones
        if key in sessions
    }
    return replace(
        scene,
        sessions=tuple(replace(each, not_ready=why.get(each.id, "")) for each in scene.sessions),
    )


def _scene(
    robot: Robot,
    lease: Lease | None,
    active: tuple[ActiveSession, ...],
    pause: str,
    now: datetime.datetime,
) -> Scene:
    online = robot.is_online(now)
    if lease is None:
        return Scene(Hold(0), active, robot.enabled, online, pause)
    return Scene(hold_of(lease), active, robot.enabled, online, pause, lease.changed_at.timestamp())


def _moment(unix: float) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(unix, datetime.UTC)


def pause_of(robot: Robot) -> str:
    """Return why a robot is not ready for a session, empty when it is; read anew, because another
    process may just have sent it home.
    """
    return _pauses_of([robot.pk]).get(robot.pk, "")


def _pauses_of(keys: Sequence[Any]) -> dict[Any, str]:
    rows = RobotPresence.objects.filter(robot__in=keys).values_list(
        "robot", "report", "robot__held", "robot__returns_home", "turnaround", "turnaround_reason"
    )
    return {key: _pause(*values) for key, *values in rows}


def _pause(report: Any, held: str, returns: bool, phase: str, reason: str) -> str:
    """Say why nobody gets a robot, that nobody can drive as it is first: who is called to one that
    stands still has waited for nothing.
    """
    why = standstill_of(report)
    if why:
        return f"{Robot.Turnaround.PAUSED}: {why}"
    if held:
        return f"{HELD}: {held}"
    # Who takes a robot that was stopped between visits releases the stop.
    may_be_taken = (phase, reason) == (Robot.Turnaround.PAUSED, STOPPED)
    is_away = returns and phase != Robot.Turnaround.READY and not may_be_taken
    return f"{phase}: {reason}"[:REASON_LENGTH] if is_away else ""


def session_of(session: Session) -> ActiveSession:
    """Return the snapshot of a living session."""
    fixed = terms.of(session)
    return ActiveSession(
        id=str(session.pk),
        visitor=str(session.visitor_id),
        state=session.state,
        queued_at=session.queued_at.timestamp(),
        offered_at=_seconds(session.offered_at),
        granted_at=_seconds(session.granted_at),
        lost_at=_seconds(session.lost_at),
        turn_ends_at=_seconds(session.turn_ends_at),
        seen_at=_seconds(session.seen_at),
        drove=session.first_motion_at is not None,
        turn=fixed.turn_seconds,
        grace=fixed.grace_seconds,
        idle=fixed.idle_seconds,
        turn_always=fixed.turn_always,
        is_readable=not isinstance(fixed, UnreadableTerms),
    )


def _seconds(at: datetime.datetime | None) -> float | None:
    return None if at is None else at.timestamp()


def holder_of(robot: Robot, visitor: User) -> Lease | None:
    """Return the robot's lease if it is this visitor's, who may come back to it."""
    return (
        Lease.objects.filter(robot=robot, session__visitor=visitor, session__state__in=LIVE)
        .select_related("session")
        .first()
    )


def is_free_drive(lease: Lease) -> bool:
    """Tell whether the session that holds a robot goes on nobody's terms, and has moved it."""
    session = lease.session
    return session is not None and not session.terms and session.first_motion_at is not None


def waits_here(now: datetime.datetime) -> Q:
    """Return the condition for sessions that wait with an open page, as
    ActiveSession.page_open has it.
    """
    since = now - datetime.timedelta(seconds=PAGE_GONE_SECONDS)
    return Q(state=Session.State.WAITING, seen_at__gt=since)


def began(session: Session | None) -> float | None:
    """Return when a session got its robot, Unix time."""
    return None if session is None else _seconds(session.granted_at)


def living_session_of(robot: Robot, visitor: User) -> Session | None:
    """Return the visitor's living session at a robot, for `hello`'s
    live_elsewhere and for links.
    """
    return Session.objects.filter(live_key=live_key(robot, visitor)).first()
