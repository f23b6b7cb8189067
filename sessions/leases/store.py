"""Taking, keeping and giving up the robot: the decisions of sessions/leases/policy.py carried out
in the database.

Any process may call these at any time, on any of the supported databases. Correctness rests on two
things alone, never on a transaction: a lease changes only where its epoch is still the one that was
read, and `live_key` is unique, so that a visitor has one living session at a robot.

What a consumer calls, each through consumers/database.py:

- `take` for `session/take`. On `TakeGranted` publish `granted.lease` (retained) at once; the
  session manager renews it.
- `seen`, through consumers/last_seen.py, every `policy.PAGE_SEEN_EVERY` seconds while the page's
  socket is open with a session; `take` calls it, too.
- `page_closed` when the socket closes: the session continues for as long as its heartbeat or its
  grace period lasts.
- `leave` for `session/leave`. On True publish an empty retained lease if the page was driving, and
  the notice `ended`.

Sessions are always read before the lease and changed before it is released. A reader in between
therefore sees a lease that names an ended session, which counts as free, and never a session that
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
    MAINTENANCE,
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
from sessions.models import HOLDING_STATES, Lease, Maintenance, Session
from sessions.protocol import Queued, Refused

LIVE = (Session.State.WAITING, *HOLDING_STATES)
# Every failed attempt means that another process changed the lease in between, so that this bound
# is never reached by chance.
ATTEMPTS = 200
CLOSED = 1001  # the close code of a page that was closed or left
REASON_LENGTH = 300  # of robots.api.messages.Reason
HELD = "held"  # the pause of a robot that its owner has reserved
# Reasons of ended sessions: the visitor began another one on a study's terms; the session ended
# before it had the robot.
BEGINS_ANEW = "begins_anew"
LEFT_QUEUE = "left_queue"


class LeaseContention(RuntimeError):
    """The lease changed under every attempt to take it."""


@dataclass(frozen=True)
class TakeGranted:
    """The page drives. `resumed`: epoch and peer are unchanged; `turn_seconds` is None while no
    other visitor waits. For `terms` and `shown`, the task's data, see sessions/leases/terms.py.
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


def take(  # noqa: D417 -- the rest is what the page sent
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
    """Give the robot to a page, put the page in the queue, or refuse.

    The caller has checked that this visitor may drive this robot at all (robots/access.py).

    Args:
        robot: freshly read, because presence and limits are taken from it.
        visitor: who asks.
        peer: the id that the server made for this page's connection.
        device: from sessions.devices.device_of, saved with a new session.
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
    """The page that asks, with everything that is needed to carry out the answer."""

    robot: Robot
    visitor: User
    peer: str
    device: dict[str, Any]
    now: datetime.datetime


def _carry_out(
    decision: Grant | Resume | Wait | Refused, scene: Scene, asker: _Asker
) -> Taken | None:
    """Return the answer, or None when another process was quicker, to decide again."""
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
    """Create a waiting session; None when another tab of the visitor has just created one."""
    try:
        # so that PostgreSQL survives the refusal within a caller's transaction
        with transaction.atomic():
            made = Session.objects.create(
                robot=asker.robot,
                visitor=asker.visitor,
                live_key=live_key(asker.robot, asker.visitor),
                queued_at=asker.now,
                seen_at=asker.now,
                device=asker.device,
            )
    except IntegrityError:
        return None
    return str(made.pk)


def _grant(grant: Grant, scene: Scene, asker: _Asker) -> TakeGranted | Refused | None:
    """Give the robot to the asking visitor; None when the caller is to read the scene and decide
    again.

    Every step can race with another page or the session manager:

    1. The visitor may have got a session from another tab (`_join`).
    2. The lease may have changed since the scene was read: it is compared and set by its epoch.
    3. The terms may refuse the session, which then ends as cancelled and so frees the robot.
    4. The session may have ended since step 2; the lease that names it is then released again.
    """
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
    if not update_living(session, _fields_of(grant, scene, asker.now)):
        change_lease(asker.robot, hold.epoch, now=asker.now)
        return None
    return _granted(scene, hold, asker, resumed=False)


def _fields_of(grant: Grant, scene: Scene, now: datetime.datetime) -> dict[str, Any]:
    """Return the fields of a session that a grant changes. A new turn begins no earlier than the
    lease's last change, which another machine's clock may have put into our future.
    """
    lost_at = now if grant.state == "reconnecting" else None
    changes: dict[str, Any] = {"state": grant.state, "seen_at": now, "lost_at": lost_at}
    if grant.returning:
        return changes
    changed_at = datetime.datetime.fromtimestamp(scene.changed_at, datetime.UTC)
    return changes | {
        "granted_at": max(now, changed_at),
        "offered_at": None,
        "turn_ends_at": None,
    }


def fix_terms(session: str, now: datetime.datetime) -> None:
    """Store the terms of a session that has just got the robot, before its state changes: until
    then no renewed lease reaches the robot.

    Terms are requested again until the session has moved the robot, because the process that
    requested them first may have died before it stored them.

    Raises:
        NotGranted: the session must not begin.
    """
    row = Session.objects.select_related("robot", "visitor").get(pk=session)
    if row.terms or row.first_motion_at is not None:
        return
    fixed = terms.of_granted(row, now)
    changes: dict[str, Any] = {}
    if fixed != FREE:
        changes["terms"] = terms.stored(fixed)
    if fixed.assist is None and not fixed.study and not row.assist:
        level = Session.assistance_to_begin_with(row.robot, row.visitor)
        changes |= {"assist": level} if level else {}
    if changes:
        Session.objects.filter(pk=session).update(**changes)


def _granted(scene: Scene, hold: Hold, asker: _Asker, *, resumed: bool) -> TakeGranted:
    """Return the grant of a lease that has just been read or set as `hold`. It is not read again:
    another process may have changed it since, and this page would get that one's epoch.
    """
    assert hold.session is not None
    session, now, key = Session.objects.get(pk=hold.session), asker.now.timestamp(), hold.session
    session.visitor, fixed = asker.visitor, terms.of(session)
    before = next((each for each in scene.sessions if each.id == key and each.granted_at), None)
    holder = before or ActiveSession(
        key, str(asker.visitor.pk), "connecting", now, granted_at=now, turn=fixed.turn_seconds
    )
    limited = fixed.turn_always or any(waiting.id != key for waiting in scene.queue)
    turn_seconds = max(0.0, turn_end(holder, rules_of(asker.robot), now) - now) if limited else None
    row = Lease(
        robot=asker.robot,
        session=session,
        epoch=hold.epoch,
        peer=hold.peer,
        wizard_peer=hold.wizard_peer,
        wizard_epoch=hold.wizard_epoch,
    )
    if resumed:
        row.renewal = Lease.objects.values_list("renewal", flat=True).get(robot=asker.robot)
    lease = message_of(row, asker.now)
    return TakeGranted(
        key, hold.epoch, hold.peer, resumed, turn_seconds, lease, fixed, terms.shown(key)
    )


def set_assist(session: str, level: str, *, peer: str) -> Lease | None:
    """Store the driver's choice, and return the lease under its next renewal number; None when this
    page does not drive any more.

    The caller has checked that the driver has a choice (sessions/consumers/queries.py).
    """
    held = Lease.objects.filter(session_id=session, peer=peer)
    if not held.exists() or not update_living(session, {"assist": level}):
        return None
    while (lease := held.select_related("robot", "session__visitor").first()) is not None:
        if count_renewal(lease, lease.renewal + 1):
            return lease
    return None


def count_renewal(lease: Lease, renewal: int, *only_if: Q) -> bool:
    """Store the number of the next copy of a lease; False when the lease has changed since it was
    read. No two copies get one number: the robot would ignore the second.
    """
    same = Lease.objects.filter(
        *only_if, robot=lease.robot_id, epoch=lease.epoch, renewal=lease.renewal
    )
    if not same.update(renewal=renewal):
        return False
    lease.renewal = renewal
    return True


def update_living(session: str, changes: dict[str, Any], **only_if: Any) -> bool:
    """Change a session that has not ended and meets these conditions; False when there is none."""
    living = Session.objects.filter(pk=session, state__in=LIVE, **only_if)
    return bool(living.update(**changes))


def seen(sessions: Collection[str], now: datetime.datetime) -> set[str]:
    """Store that a page of each of these sessions is open; return those that have not ended."""
    living = Session.objects.filter(pk__in=sessions, state__in=LIVE)
    found = list(living.values_list("pk", "state", "lost_at"))
    waiting = Session.State.WAITING
    # The connection of a waiting session is its page, and that is open again.
    if back := [key for key, state, lost_at in found if state == waiting and lost_at is not None]:
        Session.objects.filter(pk__in=back, state=waiting).update(lost_at=None)
    if found:
        living.update(seen_at=now)
    return {str(key) for key, _, _ in found}


def page_closed(session: str, peer: str, now: datetime.datetime, code: int = CLOSED) -> None:
    """Store that a page closed its socket, unless another page has taken over."""
    if Lease.objects.filter(session_id=session).exclude(peer=peer).exists():
        return
    living = Session.objects.filter(pk=session, state__in=LIVE)
    living.update(seen_at=None)
    if living.exclude(state=Session.State.WAITING).exists():
        note_page_closed(session, code, now)
    Session.objects.filter(pk=session, state=Session.State.WAITING).update(lost_at=now)


def leave(session: str, *, peer: str, now: datetime.datetime) -> bool:
    """End a session at the request of its page: completed when the robot was driven and the terms
    require no more, cancelled otherwise.

    Returns:
        False when the session was over, or has moved to another page of the visitor.
    """
    if Lease.objects.filter(session_id=session).exclude(peer=peer).exists():
        return False
    row = Session.objects.filter(pk=session, state__in=LIVE).first()
    if row is None:
        return False
    if row.state == Session.State.WAITING:
        return end(session, Session.Outcome.CANCELLED, LEFT_QUEUE, now)
    completes = row.first_motion_at is not None and terms.of(row).leaving_completes
    outcome = Session.Outcome.COMPLETED if completes else Session.Outcome.CANCELLED
    return end(session, outcome, "left", now)


def end(session: str, outcome: str, reason: str, now: datetime.datetime, **only_if: Any) -> bool:
    """End a session, and free the robot if it held it; of several callers one gets True.

    `only_if` are further conditions on the row, of a caller who decided on an earlier reading.
    """
    # Before the robot is free, so that no visitor takes it on its way to the dock. If the session
    # does not end, the session manager undoes this for a robot that is still driven.
    for lease in Lease.objects.filter(session_id=session).select_related("robot"):
        send_home(lease.robot, now)
    changes = {
        "state": Session.State.ENDED,
        "outcome": outcome,
        "outcome_reason": reason,
        "live_key": str(session),
        "ended_at": now,
        "turn_ends_at": None,
        "offered_at": None,
    }
    if not update_living(session, changes, **only_if):
        return False
    for lease in Lease.objects.filter(session_id=session).select_related("robot"):
        change_lease(lease.robot, lease.epoch, now=now)
    return True


def send_home(robot: Robot, now: datetime.datetime) -> bool:
    """Have a robot return to its dock; False when it never does, or already returns."""
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
    session: str | None = None,
    peer: str = "",
    now: datetime.datetime,
    wizard_stays: bool = False,
) -> bool:
    """Give the lease to a page of a session, or by default release it, if its epoch is still this
    one; no other statement ever does. `wizard_stays` keeps the hidden operator, when the same
    session continues.
    """
    changed = Lease.objects.filter(robot=robot, epoch=epoch)
    wizard: dict[str, Any] = {} if wizard_stays else {"wizard_peer": "", "wizard": None}
    return bool(
        changed.update(
            epoch=epoch + 1, session_id=session, peer=peer, renewal=0, changed_at=now, **wizard
        )
    )


def hold_of(lease: Lease) -> Hold:
    """Return the snapshot of a lease's row."""
    return Hold(
        lease.epoch,
        str(lease.session_id) if lease.session_id else None,
        lease.peer,
        lease.wizard_peer,
        lease.wizard_epoch,
    )


def live_key(robot: Robot, visitor: User) -> str:
    """Return `Session.live_key`: a visitor has one living session at a robot."""
    return f"{robot.pk}:{visitor.pk}"


def rules_of(robot: Robot) -> Rules:
    """Return the durations of this robot, from its own settings and the site's."""
    minutes = robot.turn_minutes if robot.turn_minutes is not None else settings.TURN_MINUTES
    return Rules(
        turn=minutes * 60.0,
        warning=settings.TURN_WARNING_SECONDS,
        start=settings.START_SECONDS,
        grace=settings.GRACE_SECONDS,
        idle=settings.IDLE_SECONDS,
    )


def message_of(lease: Lease, now: datetime.datetime) -> m.Lease:
    """Return the message of a held lease; terms override the robot's and visitor's settings."""
    robot, session = lease.robot, lease.session
    assert session is not None
    fixed = terms.of(session)
    message = m.Lease(
        session=str(session.pk),
        epoch=lease.epoch,
        peer=lease.peer,
        who=session.visitor.sent_name[:120],
        renewal=lease.renewal,
        stamp=now.timestamp(),
        ttl=settings.LEASE_TTL_SECONDS,
        limits=m.LeaseLimits(
            linear=_least(robot.max_linear, fixed.linear),
            angular=_least(robot.max_angular, fixed.angular),
        ),
        assist=fixed.assist or session.assist or None,
        methods=fixed.controllers,  # type: ignore[arg-type]
        ways=None if fixed.control_way == "any" else (fixed.control_way,),
        actions=fixed.actions,
        private=fixed.private,
    )
    return message if fixed.driver == "visitor" else _for_wizard(message, lease)


def _for_wizard(message: m.Lease, lease: Lease) -> m.Lease:
    """Return the lease of a session that a hidden operator drives. Limits and assistance apply to
    the operator, too; input methods and actions are restricted for the visitor alone. The
    operator's commands pass through the server, which records them as script or as deviations.
    """
    return msgspec.structs.replace(
        message,
        kind="wizard",
        wizard=lease.wizard_peer or None,
        wizard_epoch=lease.wizard_epoch,
        methods=None,
        ways=("mqtt",),
        actions=None,
    )


def _least(*limits: float | None) -> float | None:
    return min((limit for limit in limits if limit is not None), default=None)


def load_scene(robot: Robot, now: datetime.datetime) -> Scene:
    """Read the scene of one robot."""
    return load_scenes([robot], now)[robot.pk]


def load_scenes(robots: Sequence[Robot], now: datetime.datetime) -> dict[Any, Scene]:
    """Read scenes by the robots' keys: sessions first, then leases (see the top)."""
    keys = [robot.pk for robot in robots]
    living = Session.objects.filter(robot__in=keys, state__in=LIVE).defer("device", "summary")
    sessions = {session.pk: session for session in living}
    leases = {lease.robot_id: lease for lease in Lease.objects.filter(robot__in=keys)}
    # A session that holds a robot and was not read began after the sessions were read.
    holding = {lease.session_id for lease in leases.values() if lease.session_id}
    if late := holding - sessions.keys():
        newer = Session.objects.filter(pk__in=late, state__in=LIVE)
        sessions |= {session.pk: session for session in newer}
    active: dict[Any, list[ActiveSession]] = {key: [] for key in keys}
    for session in sessions.values():
        active[session.robot_id].append(session_of(session))
    maintenance_at = _maintenance_at()
    pauses = _pauses_of(keys) if maintenance_at is None else dict.fromkeys(keys, MAINTENANCE)
    scenes = {}
    for robot in robots:
        lease = leases.get(robot.pk)
        scene = Scene(
            Hold(0) if lease is None else hold_of(lease),
            tuple(active[robot.pk]),
            robot.enabled,
            robot.is_online(now),
            pauses.get(robot.pk, ""),
            0.0 if lease is None else lease.changed_at.timestamp(),
            maintenance_at,
        )
        scenes[robot.pk] = _with_needs(scene, robot, sessions, now)
    return scenes


def _with_needs(
    scene: Scene, robot: Robot, sessions: dict[Any, Session], now: datetime.datetime
) -> Scene:
    """Add why a free robot does not yet meet the terms of the session that would be next, and of
    those that it is offered to.
    """
    if scene.holder is not None or not scene.ready:
        return scene
    open_now = [each for each in scene.queue if each.page_open(now.timestamp())]
    next_ones = {each.id for each in open_now if each is open_now[0] or each.offered_at is not None}
    why = {
        str(key): terms.not_ready(session.visitor, robot, now)
        for key, session in sessions.items()
        if str(key) in next_ones
    }
    return replace(
        scene,
        sessions=tuple(replace(each, not_ready=why.get(each.id, "")) for each in scene.sessions),
    )


def pause_of(robot: Robot) -> str:
    """Return why a robot is not ready for a session, empty when it is; read from the database,
    because another process may just have sent it to its dock.
    """
    is_paused = _maintenance_at() is not None
    return MAINTENANCE if is_paused else _pauses_of([robot.pk]).get(robot.pk, "")


def _pauses_of(keys: Sequence[Any]) -> dict[Any, str]:
    rows = RobotPresence.objects.filter(robot__in=keys).values_list(
        "robot", "report", "robot__held", "robot__returns_home", "turnaround", "turnaround_reason"
    )
    return {key: _pause(*values) for key, *values in rows}


def _maintenance_at() -> float | None:
    """Return when the announced maintenance begins or began, None if none is announced."""
    return _seconds(Maintenance.objects.values_list("starts_at", flat=True).first())


def _pause(report: Any, held: str, returns: bool, phase: str, reason: str) -> str:
    """Return why a robot is given to no visitor. First what keeps it from driving at all: a visitor
    who is called to such a robot has waited for nothing.
    """
    why = standstill_of(report)
    if why:
        return f"{Robot.Turnaround.PAUSED}: {why}"
    if held:
        return f"{HELD}: {held}"
    # A visitor who takes a robot that was stopped between sessions releases the stop.
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
    """Return the robot's lease if a living session of this visitor holds it."""
    return (
        Lease.objects.filter(robot=robot, session__visitor=visitor, session__state__in=LIVE)
        .select_related("session")
        .first()
    )


def is_free_drive(lease: Lease) -> bool:
    """Tell whether the session that holds a robot has no terms, and has moved it."""
    session = lease.session
    return session is not None and not session.terms and session.first_motion_at is not None


def waits_here(now: datetime.datetime) -> Q:
    """Return the condition of sessions that wait with an open page (ActiveSession.page_open)."""
    since = now - datetime.timedelta(seconds=PAGE_GONE_SECONDS)
    return Q(state=Session.State.WAITING, seen_at__gt=since)


def began(session: Session | None) -> float | None:
    """Return when a session got its robot, Unix time."""
    return None if session is None else _seconds(session.granted_at)


def living_session_of(robot: Robot, visitor: User) -> Session | None:
    """Return the visitor's living session at a robot, None when there is none."""
    return Session.objects.filter(live_key=live_key(robot, visitor)).first()
