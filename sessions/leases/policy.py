"""Who may drive a robot: decisions on plain snapshots, without a clock, a database or a network.

A robot has one lease. Whoever wants it reads a `Scene`, asks `decide_take`, and carries the answer
out only if the lease still has the epoch that the scene showed (sessions/leases/store.py). The
epoch therefore grows with every change of the lease, also when it is given up, so that no answer
can be carried out twice.

Order is kept by two rules: a free robot is for the first visitor in the queue whose page is there,
and while a turn is offered to somebody it is for nobody else. What time does to a visit stands in
sessions/leases/transitions.py.

Times are Unix seconds, durations seconds.
"""

from dataclasses import dataclass, replace
from typing import Literal

State = Literal["waiting", "connecting", "driving", "reconnecting"]
Refusal = Literal["offline", "disabled", "elsewhere", "ended", "closed", "reserved", "full"]

# A page's web process says every PAGE_SEEN_EVERY seconds that the page is open; after
# PAGE_GONE_SECONDS without, it counts as gone.
PAGE_SEEN_EVERY = 10.0
PAGE_GONE_SECONDS = 25.0
# How long a robot is on its way home, for estimates alone.
HOMECOMING_SECONDS = 90.0


@dataclass(frozen=True)
class Rules:
    """How long things take at one robot, in seconds; `idle` is how long a driver may do nothing
    before being asked, 0 for ever.
    """

    turn: float
    warning: float
    start: float
    grace: float
    idle: float = 0.0

    def of(self, visit: "Visit") -> "Rules":
        """Return the rules of one visit, which its terms may have changed."""
        own = {"turn": visit.turn, "grace": visit.grace, "idle": visit.idle}
        changed = {name: seconds for name, seconds in own.items() if seconds is not None}
        return replace(self, **changed) if changed else self


@dataclass(frozen=True)
class Visit:
    """A session that has not ended. `seen_at` is None when its page has closed its socket, `drove`
    whether it ever moved the robot.

    `turn`, `grace` and `idle` are what its terms say instead of the robot's rules, in seconds.
    `not_ready` says why the robot is not yet as its terms want it, empty when it is; it is known
    only of whoever would be next.
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
    not_ready: str = ""

    def page_open(self, now: float) -> bool:
        """Tell whether a page of this visit is connected to the server."""
        return self.seen_at is not None and now - self.seen_at < PAGE_GONE_SECONDS


@dataclass(frozen=True)
class Hold:
    """The lease: its epoch, and the session and page that it names."""

    epoch: int
    session: str | None = None
    peer: str = ""


@dataclass(frozen=True)
class Scene:
    """Everything that a decision about one robot looks at.

    `pause` says in a word or sentence why the robot is not ready for a visit
    (sessions/leases/readiness.py), empty when it is. `changed_at` is when the lease changed last:
    whoever asked earlier and waited for it has the robot from then on.
    """

    hold: Hold
    visits: tuple[Visit, ...] = ()
    enabled: bool = True
    online: bool = True
    pause: str = ""
    changed_at: float = 0.0

    @property
    def waits_for(self) -> str:
        """Why a robot that nobody drives is given to nobody; empty when it would be."""
        return self.pause or next((visit.not_ready for visit in self.queue if visit.not_ready), "")

    @property
    def ready(self) -> bool:
        """Tell whether a visit could begin."""
        return self.enabled and self.online and not self.pause

    @property
    def holder(self) -> Visit | None:
        """The visit that the lease names, None when nobody drives or the lease names one that has
        ended.
        """
        return next((visit for visit in self.visits if visit.id == self.hold.session), None)

    @property
    def queue(self) -> tuple[Visit, ...]:
        """Everybody who waits, in order."""
        waiting = [
            visit
            for visit in self.visits
            if visit.state == "waiting" and visit.id != self.hold.session
        ]
        return tuple(sorted(waiting, key=lambda visit: (visit.queued_at, visit.id)))


@dataclass(frozen=True)
class Ask:
    """A page asks to drive: `peer` is its own id, `session` and `old_peer` are what an earlier
    grant told this same page.

    An `operator` may take a robot that is not ready, before whoever waits for that: somebody has to
    free it. `not_ready` is as in Visit.
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
    """Give the lease to `visit` (None: a new one); `state` is where the visit then stands,
    `returning` whether it held the lease.
    """

    visit: str | None
    state: Literal["connecting", "reconnecting"] = "connecting"
    returning: bool = False


@dataclass(frozen=True)
class Resume:
    """The same page is back: epoch and peer stay, a living data channel stays bound."""

    visit: str


@dataclass(frozen=True)
class Wait:
    """`visit` (None: a new one) waits at `place`, 1 being next, for about `minutes`; `reason` says
    why a free robot is not ready.
    """

    visit: str | None
    place: int
    minutes: float
    reason: str = ""


@dataclass(frozen=True)
class Deny:
    """No. `session` names the visit that is meant, if any."""

    reason: Refusal
    session: str | None = None


def decide_take(scene: Scene, ask: Ask, rules: Rules, now: float) -> Grant | Resume | Wait | Deny:
    """Answer a page that asks to drive."""
    own = next((visit for visit in scene.visits if visit.visitor == ask.visitor), None)
    if ask.session is not None and (own is None or own.id != ask.session):
        return Deny("ended", ask.session)
    if own is not None and own is scene.holder:
        return _come_back(scene, own, ask, now)
    is_ready = (
        scene.enabled and scene.online and not ask.not_ready and (not scene.pause or ask.operator)
    )
    if is_ready and _may_begin(scene, own, rules, now, operator=ask.operator):
        return Grant(own.id if own else None)
    if own is None and not (scene.enabled and scene.online):
        return Deny("offline" if scene.enabled else "disabled")
    place = place_in_queue(scene, own.id if own else None)
    return Wait(
        own.id if own else None,
        place,
        minutes_until_turn(scene, place, rules, now),
        scene.pause or ask.not_ready or scene.waits_for,
    )


def _come_back(scene: Scene, own: Visit, ask: Ask, now: float) -> Grant | Resume | Deny:
    """Answer a page of the visitor who holds the lease.

    A reload has closed its socket and remembers its session; a second tab has no session to
    remember, or copied it from a tab that is still open. So the lease moves when the first page is
    gone, lost, or gives way to a takeover, and otherwise does not.
    """
    if scene.hold.peer and (
        ask.peer == scene.hold.peer or (ask.session == own.id and ask.old_peer == scene.hold.peer)
    ):
        return Resume(own.id)
    gone = own.state == "reconnecting" or (
        not own.page_open(now) and (ask.session == own.id or own.state != "driving")
    )
    if ask.takeover or gone:
        return Grant(
            own.id,
            "reconnecting" if own.state in {"driving", "reconnecting"} else "connecting",
            returning=True,
        )
    return Deny("elsewhere", own.id)


def _may_begin(
    scene: Scene, own: Visit | None, rules: Rules, now: float, *, operator: bool
) -> bool:
    if scene.holder is not None:
        return False
    queue = () if operator and scene.waits_for else scene.queue
    ahead = [
        visit
        for visit in queue
        if own is None or (visit.queued_at, visit.id) < (own.queued_at, own.id)
    ]
    others_offered = any(offer_alive(visit, rules, now) for visit in queue if visit is not own)
    return not others_offered and not any(ready(visit, now) for visit in ahead)


def ready(visit: Visit, now: float) -> bool:
    """Tell whether a waiting visit can be offered a turn: its page is there and it has not let an
    offer pass.
    """
    return visit.page_open(now) and visit.offered_at is None


def offer_alive(visit: Visit, rules: Rules, now: float) -> bool:
    """Tell whether the robot is reserved for this visit."""
    return visit.offered_at is not None and now < visit.offered_at + rules.start


def place_in_queue(scene: Scene, visit: str | None) -> int:
    """Return the place of a visit, or that of one that would join now; 1 is next."""
    ids = [waiting.id for waiting in scene.queue]
    return ids.index(visit) + 1 if visit in ids else len(ids) + 1


def minutes_until_turn(scene: Scene, place: int, rules: Rules, now: float) -> float:
    """Estimate the wait in minutes: what is left of the running turn, and a whole turn for
    everybody ahead.
    """
    holder = scene.holder
    left = (
        max(0.0, turn_end(holder, rules, now) - now)
        if holder
        else HOMECOMING_SECONDS
        if scene.pause
        else 0.0
    )
    return (left + (place - 1) * rules.turn) / 60.0


def turn_end(holder: Visit, rules: Rules, now: float) -> float:
    """Return when the turn ends if somebody waits.

    It lasts a whole turn from the grant. A visitor who has driven on alone for longer is given the
    warning time from the moment that somebody waits, so that nobody is stopped without notice.
    """
    if holder.turn_ends_at is not None:
        return holder.turn_ends_at
    return max((holder.granted_at or now) + rules.of(holder).turn, now + rules.warning)
