"""The effects of time on sessions: connected, lost, reconnected, turn over, next in the queue. Only
the session manager calls this, with plain snapshots.

Rules, all in seconds unless stated otherwise:

- A granted session that is not connected after `start` ends as connection_refused.
- A driving session becomes reconnecting when the robot has received no heartbeat of its visitor for
  HEARTBEAT_SILENCE, and ends as connection_lost after `grace`. A closed page alone has no effect
  while heartbeats arrive over the data channel; when the robot is silent, too, the page decides.
- A session ends as robot_fault when its robot is silent for ROBOT_SILENCE, and when, after `start`
  or `grace`, the robot does not know the session although its page is open: the agent has
  restarted. While the robot is silent, no connection counts as lost.
- A session whose stored terms this version cannot read ends as stopped_by_operator.
- `turn` and `grace` are the robot's, or those of the session's terms (sessions/leases/terms.py).
- A turn is limited only while another visitor waits with an open page, or always if the terms
  require it. It ends `turn` after the grant, but not before `warning` after the moment from which
  another visitor waited. When no visitor waits any more, the limit is lifted.
- The site's maintenance ends every drive when it begins, as stopped_by_operator; drivers are warned
  from its announcement on.
- A driver who does nothing for `idle` is asked to confirm presence. Without a sign within
  ANSWER_SECONDS, plus ROUND_TRIP_MARGIN_S for question and answer to arrive, the session ends as if
  its turn were over. Driving, a touch of the page, a call, autonomous motion of the robot and an
  active emergency stop are signs. A lost connection is none of this; a driver who reconnects is
  asked again.
- A free robot that is ready is offered to the first session in the queue whose page is open, once
  the robot also meets that session's terms. Until then no later session gets it, but an operator
  may take it. The offer lapses after `start`: its session is cancelled, and the next one gets an
  offer. A waiting session whose page is closed keeps its place for `grace`.

No deadline counts from before `RobotLink.since`, when the session manager began to receive
messages, or its clock jumped: visitors do not pay for the server's absence.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from sessions.leases.fault_side import TERMS_UNREADABLE
from sessions.leases.policy import (
    MAINTENANCE,
    ActiveSession,
    Hold,
    Rules,
    Scene,
    State,
    offer_alive,
    ready,
    turn_end,
)
from sessions.protocol import Ended, Offered, PresenceAsked, PresenceConfirmed, TurnWarning

HEARTBEAT_SILENCE = 2.0
STATE_SILENCE = 3.0
ROBOT_SILENCE = 30.0
ANSWER_SECONDS = 30.0
ROUND_TRIP_MARGIN_S = 5.0
IDLE = "idle"  # the reason of a session whose driver did not confirm presence


@dataclass(frozen=True)
class RobotLink:
    """What the robot last sent: any message at `last_received_at`; its newest state at `state_at`,
    with these of its fields.

    `since` is when the session manager began to receive, `silence` State.visitor_silence, and
    `moved` whether a command of this session and epoch has ever moved the robot. `active_at` is the
    robot's last sign of its driver, `signs` the last sign of each page by its session (the event
    loop adds to it at any time), `asked` the session that was last asked for a sign, and when.
    """

    since: float = 0.0
    last_received_at: float | None = None
    state_at: float | None = None
    session: str | None = None
    epoch: int = 0
    silence: float | None = None
    moved: bool = False
    active_at: float | None = None
    asked: tuple[str, float] | None = None
    signs: Mapping[str, float] = field(default_factory=dict, compare=False)


@dataclass(frozen=True)
class ReleaseLease:
    """The lease names a session that is over: release it."""

    epoch: int


@dataclass(frozen=True)
class SetState:
    """The session changes to `state`; `lost_at` is None when it is connected."""

    session: str
    state: State
    lost_at: float | None = None


@dataclass(frozen=True)
class FirstMotion:
    """The visitor has moved the robot for the first time."""

    session: str


@dataclass(frozen=True)
class TurnLimited:
    """The turn ends at `ends_at`, Unix seconds."""

    session: str
    ends_at: float


@dataclass(frozen=True)
class TurnUnlimited:
    """No other visitor waits any more: the turn has no end."""

    session: str


@dataclass(frozen=True)
class WithdrawOffer:
    """The offer is withdrawn, and made again later."""

    session: str


@dataclass(frozen=True)
class MarkLost:
    """A waiting session's page has been gone, unnoticed by its web process, since `lost_at`."""

    session: str
    lost_at: float


# Some are the notice that the session's page receives. TurnWarning comes at every tick of the last
# minutes; the scheduler sends it once.
Transition = (
    ReleaseLease
    | SetState
    | FirstMotion
    | TurnLimited
    | TurnUnlimited
    | WithdrawOffer
    | MarkLost
    | TurnWarning
    | PresenceAsked
    | PresenceConfirmed
    | Offered
    | Ended
)


def decide_tick(scene: Scene, link: RobotLink, rules: Rules, now: float) -> tuple[Transition, ...]:
    """Return the transitions that are due, in order."""
    unreadable = [session for session in scene.sessions if not session.is_readable]
    if unreadable:  # the others of this robot come at the next tick
        return tuple(
            Ended(session=session.id, outcome="stopped_by_operator", reason=TERMS_UNREADABLE)
            for session in unreadable
        )
    due = [*_orphans(scene), *_waiting(scene, link, rules, now)]
    holder = scene.holder
    if holder is not None:
        due += _driver(scene, holder, link, rules, now)
    elif scene.hold.session is not None:
        due.append(ReleaseLease(scene.hold.epoch))
    else:
        due += _offers(scene, rules, now)
    return tuple(due)


def _orphans(scene: Scene) -> Iterator[Transition]:
    """End sessions that drive without the lease, after a process was killed half-way."""
    for session in scene.sessions:
        if session.state != "waiting" and session.id != scene.hold.session:
            yield Ended(session=session.id, outcome="connection_lost", reason="lease_gone")


def _waiting(scene: Scene, link: RobotLink, rules: Rules, now: float) -> Iterator[Transition]:
    """End waiting sessions whose offer or grace period is over, and mark lost pages.

    Times count from `link.since` at the earliest, when this session manager began to observe the
    robot: visitors do not pay for its absence.
    """
    for session in scene.queue:
        # An offer that could not be taken does not lapse: it is withdrawn.
        if (
            scene.ready
            and session.page_open(now)
            and not session.not_ready
            and session.offered_at is not None
            and now - max(session.offered_at, link.since) >= rules.start
        ):
            yield Ended(session=session.id, outcome="cancelled", reason="turn_not_taken")
        elif session.page_open(now):
            continue
        elif session.lost_at is not None and now - max(session.lost_at, link.since) > rules.grace:
            yield Ended(session=session.id, outcome="cancelled", reason="page_gone")
        else:
            if session.lost_at is None:
                yield MarkLost(session.id, now)
            if session.offered_at is not None:
                yield WithdrawOffer(session.id)  # no page can take the turn; the place is kept


def _driver(
    scene: Scene, holder: ActiveSession, link: RobotLink, rules: Rules, now: float
) -> Iterator[Transition]:
    """Yield the transitions of the session that has the robot. At most one of them ends it: a fault
    of the robot first, then a lost connection, idleness and the end of the turn.
    """
    fault = _fault(scene, holder, link, now)
    if fault is not None:
        yield fault
        return
    if link.moved and not holder.drove and _speaks_of(link, holder, scene.hold):
        yield FirstMotion(holder.id)
    changed = _connection(scene.hold, holder, link, rules.of(holder), now)
    if changed is not None:
        yield changed
    idle = (
        _idle(holder, link, rules.of(holder), now)
        if holder.state == "driving" and changed is None
        else None
    )
    if idle is not None:
        yield idle
    if not isinstance(changed, Ended) and not isinstance(idle, Ended):
        yield from _until_maintenance(scene, holder, _turn(scene, holder, link, rules, now), now)


def _fault(scene: Scene, holder: ActiveSession, link: RobotLink, now: float) -> Ended | None:
    if not scene.enabled:
        return Ended(session=holder.id, outcome="stopped_by_operator", reason="robot_disabled")
    # While a web process grants it, the session has no granted_at yet.
    granted_at = holder.granted_at or scene.changed_at
    silent_since = max(link.since, link.last_received_at or 0.0, granted_at)
    if now - silent_since > ROBOT_SILENCE:
        return Ended(session=holder.id, outcome="robot_fault", reason="robot_offline")
    return None


def visitor_here(hold: Hold, holder: ActiveSession, link: RobotLink, now: float) -> bool | None:
    """Tell whether the driver is connected; None while the robot is silent, the page open."""
    if link.state_at is None or now - link.state_at > STATE_SILENCE:
        return None if holder.page_open(now) else False
    return (
        _speaks_of(link, holder, hold)
        and link.silence is not None
        and link.silence <= HEARTBEAT_SILENCE
    )


def _speaks_of(link: RobotLink, holder: ActiveSession, hold: Hold) -> bool:
    return link.session == holder.id and link.epoch == hold.epoch


def _connection(
    hold: Hold, holder: ActiveSession, link: RobotLink, rules: Rules, now: float
) -> SetState | Ended | None:
    """Return the change of the driver's connection, by the heartbeats that the robot receives:
    connecting → driving ↔ reconnecting, or the end after the time for a start or the grace period.
    """
    if holder.state == "waiting":  # the granting process died before it stored this
        return SetState(holder.id, "connecting")
    here = visitor_here(hold, holder, link, now)
    if holder.state == "driving":
        return SetState(holder.id, "reconnecting", now) if here is False else None
    if here:
        return SetState(holder.id, "driving")
    if here is None:
        return None  # the robot is silent; _fault ends the session if it stays so
    if holder.state == "connecting":
        is_over = now - max(holder.granted_at or now, link.since) > rules.start
    else:
        is_over = now - max(holder.lost_at or now, link.since) > rules.grace
    return _broken_off(hold, holder, link, now) if is_over else None


def _broken_off(hold: Hold, holder: ActiveSession, link: RobotLink, now: float) -> Ended:
    """End a session whose page and robot are not connected. It is the robot's fault when the page
    is open and the robot does not know the session: its agent restarted, or received no lease.
    """
    if holder.page_open(now) and not _speaks_of(link, holder, hold):
        return Ended(session=holder.id, outcome="robot_fault", reason="robot_offline")
    if holder.state == "reconnecting":
        return Ended(session=holder.id, outcome="connection_lost", reason="visitor_silent")
    return Ended(
        session=holder.id,
        outcome="connection_refused",
        reason="never_connected" if holder.page_open(now) else "page_gone",
    )


def _idle(
    holder: ActiveSession, link: RobotLink, rules: Rules, now: float
) -> PresenceAsked | PresenceConfirmed | Ended | None:
    """Ask a driver who has shown no activity for `rules.idle` seconds whether they are present, and
    end the session `ANSWER_SECONDS` later, plus a margin for an answer that is already sent.
    """
    still_since = max(
        link.since, link.active_at or 0.0, link.signs.get(holder.id, 0.0), holder.granted_at or 0.0
    )
    asked_at = link.asked[1] if link.asked is not None and link.asked[0] == holder.id else None
    if rules.idle <= 0.0 or now - still_since < rules.idle:
        return PresenceConfirmed(session=holder.id) if asked_at is not None else None
    if asked_at is None or asked_at < still_since:
        return PresenceAsked(session=holder.id, seconds=ANSWER_SECONDS)
    return (
        Ended(session=holder.id, outcome="timed_out", reason=IDLE)
        if now - asked_at >= ANSWER_SECONDS + ROUND_TRIP_MARGIN_S
        else None
    )


def _turn(
    scene: Scene, holder: ActiveSession, link: RobotLink, rules: Rules, now: float
) -> Iterator[Transition]:
    if not holder.turn_always and not any(ready(session, now) for session in scene.queue):
        if holder.turn_ends_at is not None:
            yield TurnUnlimited(holder.id)
        return
    notice = min(rules.warning, rules.of(holder).turn)
    ends_at = max(turn_end(holder, rules, now), link.since + notice)
    if now >= ends_at:
        yield Ended(session=holder.id, outcome="timed_out", reason="turn_over")
        return
    if holder.turn_ends_at is None:
        yield TurnLimited(holder.id, ends_at)
    if ends_at - now <= rules.warning:
        yield TurnWarning(session=holder.id, remaining=ends_at - now)


def _until_maintenance(
    scene: Scene, holder: ActiveSession, turn: Iterator[Transition], now: float
) -> Iterator[Transition]:
    """Yield the transitions of the turn, unless maintenance ends the session first."""
    left = None if scene.maintenance_at is None else scene.maintenance_at - now
    if left is not None and left <= 0.0:
        yield Ended(session=holder.id, outcome="stopped_by_operator", reason=MAINTENANCE)
        return
    due = list(turn)
    ends = [each for each in due if isinstance(each, TurnWarning | Ended)]
    if left is None or any(
        isinstance(end, Ended) or (end.remaining or 0.0) <= left for end in ends
    ):
        yield from due
        return
    yield from (each for each in due if each not in ends)
    yield TurnWarning(session=holder.id, remaining=left, reason=MAINTENANCE)


def _offers(scene: Scene, rules: Rules, now: float) -> Iterator[Transition]:
    offered = [session for session in scene.queue if session.offered_at is not None]
    unready = [session for session in offered if session.not_ready or not scene.ready]
    if unready or not scene.ready:
        yield from (WithdrawOffer(session.id) for session in unready)
    elif not any(offer_alive(session, rules, now) for session in offered):
        first = next((session for session in scene.queue if ready(session, now)), None)
        if first is not None and not first.not_ready:
            yield Offered(session=first.id, seconds=rules.start)
