"""Who may drive a robot: decisions on plain snapshots, without a clock, a database or a network.

A robot has one lease. To take it, a process reads a `Scene`, calls `decide_take`, and carries the
answer out only if the lease still has the epoch of the scene (sessions/leases/store.py). The epoch
grows with every change of the lease, also with its release, so that no answer can be carried out
twice.

Two rules keep the order: a free robot goes to the first visitor in the queue whose page is open,
and while a turn is offered to one visitor, no other can take it. sessions/leases/transitions.py has
the effects of time.

Times are Unix seconds, durations seconds.
"""

from dataclasses import dataclass, replace
from typing import Literal

from sessions.protocol import Refused

State = Literal["waiting", "connecting", "driving", "reconnecting"]

# A page's web process stores every PAGE_SEEN_EVERY seconds that the page is open; after
# PAGE_GONE_SECONDS without, the page counts as gone.
PAGE_SEEN_EVERY = 10.0
PAGE_GONE_SECONDS = 25.0
MAINTENANCE = "maintenance"  # the pause of all robots, and the reason of the drives that it ends
# Duration of a return to the dock, for estimates only.
RETURN_TO_DOCK_SECONDS = 90.0


@dataclass(frozen=True)
class Rules:
    """Durations at one robot, in seconds. `idle` is how long a driver may do nothing before the
    page asks whether the driver is there; 0: the page never asks.
    """

    turn: float
    warning: float
    start: float
    grace: float
    idle: float = 0.0

    def of(self, session: "ActiveSession") -> "Rules":
        """Return the rules of one session, which its terms may have changed."""
        own = {"turn": session.turn, "grace": session.grace, "idle": session.idle}
        changed = {name: seconds for name, seconds in own.items() if seconds is not None}
        return replace(self, **changed) if changed else self


@dataclass(frozen=True)
class ActiveSession:
    """A session that has not ended. `seen_at` is None when its page has closed its socket, `drove`
    whether it ever moved the robot.

    `turn`, `grace` and `idle` are those of its terms, in seconds, and override the robot's rules;
    `turn_always` is whether the turn is a limit even while no visitor waits, `is_readable` whether
    its terms could be read.
    `not_ready` is why the robot does not yet meet its terms, empty when it does; only the next
    sessions in the queue have it.
    """

    id: str
    visitor: str
    state: State
    queued_at: float
    offered_at: float | None = None
    granted_at: float | None = None
    lost_at: float | None = None
    turn_ends_at: float | None = None
    seen_at: float | None = None
    drove: bool = False
    turn: float | None = None
    grace: float | None = None
    idle: float | None = None
    turn_always: bool = False
    is_readable: bool = True
    not_ready: str = ""

    def page_open(self, now: float) -> bool:
        """Tell whether a page of this session is connected to the server."""
        return self.seen_at is not None and now - self.seen_at < PAGE_GONE_SECONDS

    def is_left(self, now: float) -> bool:
        """Tell whether no page drives it, so that any page of its visitor may resume it. A page
        without a socket may still drive, over its connection to the robot.
        """
        return self.state == "reconnecting" or (not self.page_open(now) and self.state != "driving")


@dataclass(frozen=True)
class Hold:
    """The lease: its epoch, session and page, and the hidden operator's page and epoch."""

    epoch: int
    session: str | None = None
    peer: str = ""
    wizard_peer: str = ""
    wizard_epoch: int = 0


@dataclass(frozen=True)
class Scene:
    """The input of a decision about one robot.

    `pause` is why the robot is not ready for a session (sessions/leases/readiness.py), empty when
    it is. `changed_at` is when the lease changed last: a request that was made earlier and waited
    for this change is granted as of then. `maintenance_at` is when the site's maintenance begins
    or began, None if none is announced.
    """

    hold: Hold
    sessions: tuple[ActiveSession, ...] = ()
    enabled: bool = True
    online: bool = True
    pause: str = ""
    changed_at: float = 0.0
    maintenance_at: float | None = None

    @property
    def waits_for(self) -> str:
        """Why a robot without a driver is given to no visitor; empty when it would be."""
        return self.pause or next(
            (session.not_ready for session in self.queue if session.not_ready), ""
        )

    @property
    def ready(self) -> bool:
        """Tell whether a session could begin."""
        return self.enabled and self.online and not self.pause

    @property
    def holder(self) -> ActiveSession | None:
        """The living session that the lease names, None when there is none."""
        return next((session for session in self.sessions if session.id == self.hold.session), None)

    @property
    def queue(self) -> tuple[ActiveSession, ...]:
        """The waiting sessions, in order."""
        waiting = [
            session
            for session in self.sessions
            if session.state == "waiting" and session.id != self.hold.session
        ]
        return tuple(sorted(waiting, key=lambda session: (session.queued_at, session.id)))


@dataclass(frozen=True)
class Ask:
    """A page asks to drive: `peer` is its own id, `session` and `old_peer` are from an earlier
    grant to this same page.

    An `operator` may take a robot that is not ready, before the visitors who wait for it, in order
    to free it. `not_ready` is as in ActiveSession.
    """

    visitor: str
    peer: str
    session: str | None = None
    old_peer: str | None = None
    takeover: bool = False
    operator: bool = False
    not_ready: str = ""


@dataclass(frozen=True)
class Grant:
    """Give the lease to `session` (None: a new one); `returning`: it held the lease before."""

    session: str | None
    state: Literal["connecting", "reconnecting"] = "connecting"
    returning: bool = False


@dataclass(frozen=True)
class Resume:
    """The same page is back: it keeps epoch and peer, and with them a living data channel."""

    session: str


@dataclass(frozen=True)
class Wait:
    """`session` (None: a new one) waits at `place`, 1 being next, for about `minutes`; `reason` is
    why a free robot is not ready.
    """

    session: str | None
    place: int
    minutes: float
    reason: str = ""


def decide_take(
    scene: Scene, ask: Ask, rules: Rules, now: float
) -> Grant | Resume | Wait | Refused:
    """Answer a page that asks to drive."""
    own = next((session for session in scene.sessions if session.visitor == ask.visitor), None)
    if ask.session is not None and (own is None or own.id != ask.session):
        return Refused(reason="ended", session=ask.session)
    if own is not None and own is scene.holder:
        return _come_back(scene, own, ask, now)
    is_ready = (
        scene.enabled and scene.online and not ask.not_ready and (not scene.pause or ask.operator)
    )
    if is_ready and _may_begin(scene, own, rules, now, operator=ask.operator):
        return Grant(own.id if own else None)
    if own is None and not (scene.enabled and scene.online):
        return Refused(reason="offline" if scene.enabled else "disabled")
    place = place_in_queue(scene, own.id if own else None, now)
    return Wait(
        own.id if own else None,
        place,
        minutes_until_turn(scene, place, rules, now),
        scene.pause or ask.not_ready or scene.waits_for,
    )


def _come_back(scene: Scene, own: ActiveSession, ask: Ask, now: float) -> Grant | Resume | Refused:
    """Answer a page of the visitor who holds the lease.

    A reload has closed its socket and remembers its session; a second tab remembers none, or copied
    it from a tab that is still open. So the lease moves to the new page only when the first page is
    gone or lost, or when the visitor takes over.
    """
    if scene.hold.peer and (
        ask.peer == scene.hold.peer or (ask.session == own.id and ask.old_peer == scene.hold.peer)
    ):
        return Resume(own.id)
    if ask.takeover or own.is_left(now) or (not own.page_open(now) and ask.session == own.id):
        return Grant(
            own.id,
            "reconnecting" if own.state in {"driving", "reconnecting"} else "connecting",
            returning=True,
        )
    return Refused(reason="elsewhere", session=own.id)


def _may_begin(
    scene: Scene, own: ActiveSession | None, rules: Rules, now: float, *, operator: bool
) -> bool:
    if scene.holder is not None:
        return False
    queue = () if operator and scene.waits_for else scene.queue
    ahead = [
        session
        for session in queue
        if own is None or (session.queued_at, session.id) < (own.queued_at, own.id)
    ]
    others_offered = any(
        offer_alive(session, rules, now) for session in queue if session is not own
    )
    return not others_offered and not any(ready(session, now) for session in ahead)


def ready(session: ActiveSession, now: float) -> bool:
    """Tell whether the page is open and has no offer, not even one that has lapsed."""
    return session.page_open(now) and session.offered_at is None


def offer_alive(session: ActiveSession, rules: Rules, now: float) -> bool:
    """Tell whether the robot is reserved for this session."""
    return session.offered_at is not None and now < session.offered_at + rules.start


def place_in_queue(scene: Scene, session: str | None, now: float) -> int:
    """Return the place of a session, or that of one that would join now; 1 is next. Sessions whose
    page is closed keep their place, but do not count for others.
    """
    ids = [waiting.id for waiting in scene.queue if waiting.id == session or waiting.page_open(now)]
    return ids.index(session) + 1 if session in ids else len(ids) + 1


def minutes_until_turn(scene: Scene, place: int, rules: Rules, now: float) -> float:
    """Estimate the wait in minutes: the rest of the turn, and a turn for each visitor ahead."""
    holder = scene.holder
    left = (
        max(0.0, turn_end(holder, rules, now) - now)
        if holder
        else RETURN_TO_DOCK_SECONDS
        if scene.pause
        else 0.0
    )
    return (left + (place - 1) * rules.turn) / 60.0


def turn_end(holder: ActiveSession, rules: Rules, now: float) -> float:
    """Return when the turn ends if another visitor waits, or in any case if it is always limited.

    It lasts a whole turn from the grant. A visitor who has driven alone for longer still gets the
    warning time from the moment that another visitor waits, so that no drive ends without notice;
    a turn that is always limited has had a known end from the beginning.
    """
    if holder.turn_ends_at is not None:
        return holder.turn_ends_at
    whole = (holder.granted_at or now) + rules.of(holder).turn
    return whole if holder.turn_always else max(whole, now + rules.warning)
