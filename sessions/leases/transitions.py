"""What time does to sessions: connected, lost, back, turn over, next in the queue. Only the session
manager asks.

Rules, all in seconds unless said otherwise:

- A granted session that is not connected after `start` ends as connection_refused.
- A driving visitor whose heartbeat the robot has not heard for HEARTBEAT_SILENCE is reconnecting,
  and after `grace` the session ends as connection_lost. A closed page alone means nothing while the
  heartbeat lives on the data channel; when the robot says nothing either, the page is all there is
  to go by.
- A robot that is not heard of for ROBOT_SILENCE ends the session as robot_fault, and so does one
  that, when one of these times is over, does not know of the session while its page is there: it
  has died and begun anew. While the robot is silent nobody's connection is taken for lost.
- A session whose stored terms this version cannot read ends as stopped_by_operator.
- `turn` and `grace` are the robot's, or what the terms of the session say
  (sessions/leases/terms.py).
- A turn is a limit only while somebody waits whose page is open, or where the terms say that it
  always is. It then ends `turn` after the grant, but never earlier than `warning` after the moment
  from which somebody waited. When nobody waits any more, the limit is lifted.
- A driver who does nothing for `idle` is asked whether anybody is there, and without a sign after
  ANSWER_SECONDS, and ON_THE_WAY for question and answer to arrive, the session ends as if its turn
  were over. Driving, a touch of the page, a call and what the robot does by itself are signs,
  and so is an emergency stop that is on; a lost connection is another matter, and who comes back
  from one is asked anew.
- A free and ready robot is offered to the first session in the queue whose page is open, once the
  robot also meets that session's terms. Until it does, later sessions wait as well; only those who
  operate the robot may take it. An offer lapses after `start`: that session is cancelled, and the
  next one gets an offer. A session whose page is closed keeps its place for `grace`.

Decided on plain snapshots. No deadline counts from before `RobotLink.since`, when the session
manager began to hear robots, or its clock made a step: nobody is punished for its own absence.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from sessions.leases.fault_side import TERMS_UNREADABLE
from sessions.leases.policy import (
    ActiveSession,
    Hold,
    Rules,
    Scene,
    State,
    offer_alive,
    ready,
    turn_end,
)
from sessions.protocol import AskedThere, Ended, FoundThere, Offered, TurnWarning

HEARTBEAT_SILENCE = 2.0
STATE_SILENCE = 3.0
ROBOT_SILENCE = 30.0
ANSWER_SECONDS = 30.0
ON_THE_WAY = 5.0
IDLE = "idle"  # the reason of a session whose driver gave no sign any more


@dataclass(frozen=True)
class RobotLink:
    """What was last heard of the robot: anything at all at `last_received_at`; the newest state at
    `state_at`, with these of its fields.

    `since` is when the session manager began to listen, `silence` State.visitor_silence, and
    `moved` says whether a command of this session and epoch has ever moved the robot. `active_at`
    is when the robot last showed a sign of its driver, `signs` when pages gave one, by their
    sessions (it may grow while it is looked at), `asked` which session was last asked for one, and
    when.
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
class Free:
    """The lease names a session that is over: give it up."""

    epoch: int


@dataclass(frozen=True)
class Move:
    """The session now stands at `state`; `lost_at` is None when it is connected."""

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
    """Nobody waits any more: the turn has no end."""

    session: str


@dataclass(frozen=True)
class Withdraw:
    """The robot went away: the offer is taken back and made again later."""

    session: str


@dataclass(frozen=True)
class Lose:
    """A waiting session's page has been gone, unnoticed by its web process, since `lost_at`."""

    session: str
    lost_at: float


# What is told to the session's page is the notice itself. TurnWarning comes at every tick of the
# last minutes, for the shell to say once.
Act = (
    Free
    | Move
    | FirstMotion
    | TurnLimited
    | TurnUnlimited
    | Withdraw
    | Lose
    | TurnWarning
    | AskedThere
    | FoundThere
    | Offered
    | Ended
)


def decide_tick(scene: Scene, link: RobotLink, rules: Rules, now: float) -> tuple[Act, ...]:
    """Return what is to be done now, in order; nothing when all is well."""
    unreadable = [session for session in scene.sessions if not session.is_readable]
    if unreadable:  # the others of this robot come at the next tick
        return tuple(
            Ended(session=session.id, outcome="stopped_by_operator", reason=TERMS_UNREADABLE)
            for session in unreadable
        )
    acts = [*_orphans(scene), *_waiting(scene, link, rules, now)]
    holder = scene.holder
    if holder is not None:
        acts += _driver(scene, holder, link, rules, now)
    elif scene.hold.session is not None:
        acts.append(Free(scene.hold.epoch))
    else:
        acts += _offers(scene, rules, now)
    return tuple(acts)


def _orphans(scene: Scene) -> Iterator[Act]:
    """A session that drives without the lease cannot come about while every process finishes what
    it began; one may have been killed.
    """
    for session in scene.sessions:
        if session.state != "waiting" and session.id != scene.hold.session:
            yield Ended(session=session.id, outcome="connection_lost", reason="lease_gone")


def _waiting(scene: Scene, link: RobotLink, rules: Rules, now: float) -> Iterator[Act]:
    for session in scene.queue:
        # An offer that nobody could take does not lapse: it is withdrawn.
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
                yield Lose(session.id, now)
            if session.offered_at is not None:
                yield Withdraw(session.id)  # who has no page cannot take a turn; the place is kept


def _driver(
    scene: Scene, holder: ActiveSession, link: RobotLink, rules: Rules, now: float
) -> Iterator[Act]:
    fault = _fault(scene, holder, link, now)
    if fault is not None:
        yield fault
        return
    if link.moved and not holder.drove and _speaks_of(link, holder, scene.hold):
        yield FirstMotion(holder.id)
    moved_on = _connection(scene.hold, holder, link, rules.of(holder), now)
    if moved_on is not None:
        yield moved_on
    idle = (
        _idle(holder, link, rules.of(holder), now)
        if holder.state == "driving" and moved_on is None
        else None
    )
    if idle is not None:
        yield idle
    if not isinstance(moved_on, Ended) and not isinstance(idle, Ended):
        yield from _turn(scene, holder, link, rules, now)


def _fault(scene: Scene, holder: ActiveSession, link: RobotLink, now: float) -> Ended | None:
    if not scene.enabled:
        return Ended(session=holder.id, outcome="stopped_by_operator", reason="robot_disabled")
    # While a web process is about to grant it, the session has no time of that yet.
    granted_at = holder.granted_at or scene.changed_at
    heard = max(link.since, link.last_received_at or 0.0, granted_at)
    if now - heard > ROBOT_SILENCE:
        return Ended(session=holder.id, outcome="robot_fault", reason="robot_offline")
    return None


def visitor_here(hold: Hold, holder: ActiveSession, link: RobotLink, now: float) -> bool | None:
    """Tell whether the driver is connected to the robot; None when the robot's silence leaves it
    open.
    """
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
) -> Move | Ended | None:
    if holder.state == "waiting":  # the process that granted the lease did not live to say so
        return Move(holder.id, "connecting")
    here = visitor_here(hold, holder, link, now)
    if holder.state == "driving":
        return Move(holder.id, "reconnecting", now) if here is False else None
    if here:
        return Move(holder.id, "driving")
    if here is None:
        return None  # a silent robot says nothing about its visitor, and is itself ended by _fault
    if holder.state == "connecting":
        is_over = now - max(holder.granted_at or now, link.since) > rules.start
    else:
        is_over = now - max(holder.lost_at or now, link.since) > rules.grace
    return _broken_off(hold, holder, link, now) if is_over else None


def _broken_off(hold: Hold, holder: ActiveSession, link: RobotLink, now: float) -> Ended:
    """End a session whose page and robot are not connected: by the robot where the page is there
    and the robot knows nothing of the session, because it began anew or heard of no lease.
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
) -> AskedThere | FoundThere | Ended | None:
    still_since = max(
        link.since, link.active_at or 0.0, link.signs.get(holder.id, 0.0), holder.granted_at or 0.0
    )
    asked_at = link.asked[1] if link.asked is not None and link.asked[0] == holder.id else None
    if rules.idle <= 0.0 or now - still_since < rules.idle:
        return FoundThere(session=holder.id) if asked_at is not None else None
    if asked_at is None or asked_at < still_since:
        return AskedThere(session=holder.id, seconds=ANSWER_SECONDS)
    return (
        Ended(session=holder.id, outcome="timed_out", reason=IDLE)
        if now - asked_at >= ANSWER_SECONDS + ON_THE_WAY
        else None
    )


def _turn(
    scene: Scene, holder: ActiveSession, link: RobotLink, rules: Rules, now: float
) -> Iterator[Act]:
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


def _offers(scene: Scene, rules: Rules, now: float) -> Iterator[Act]:
    offered = [session for session in scene.queue if session.offered_at is not None]
    unready = [session for session in offered if session.not_ready or not scene.ready]
    if unready or not scene.ready:
        yield from (Withdraw(session.id) for session in unready)
    elif not any(offer_alive(session, rules, now) for session in offered):
        first = next((session for session in scene.queue if ready(session, now)), None)
        if first is not None and not first.not_ready:
            yield Offered(session=first.id, seconds=rules.start)
