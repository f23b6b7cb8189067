"""A robot, its queue and its visitors in memory: carries out the decisions of
sessions.leases.policy and sessions.leases.transitions without a database.
"""

from dataclasses import dataclass, field, replace

from sessions.leases.policy import (
    MAINTENANCE,
    ActiveSession,
    Ask,
    Grant,
    Hold,
    Resume,
    Rules,
    Scene,
    Wait,
    decide_take,
)
from sessions.leases.transitions import (
    FirstMotion,
    MarkLost,
    ReleaseLease,
    RobotLink,
    SetState,
    TurnLimited,
    TurnUnlimited,
    WithdrawOffer,
    decide_tick,
)
from sessions.protocol import Ended, Offered, PresenceAsked, PresenceConfirmed, Refused

RULES = Rules(turn=60.0, warning=20.0, start=15.0, grace=10.0)
ASKING = replace(RULES, idle=120.0)


@dataclass
class World:
    now: float = 1000.0
    hold: Hold = field(default_factory=lambda: Hold(0))
    sessions: dict[str, ActiveSession] = field(default_factory=dict)
    # session: visitor, outcome, reason
    ended: dict[str, tuple[str, str, str]] = field(default_factory=dict)
    grants: list[tuple[int, str]] = field(default_factory=list)  # epoch, visitor
    online: bool = True
    maintenance_at: float | None = None
    enabled: bool = True
    offline_since: float | None = None
    connected: set[str] = field(default_factory=set)  # visitors whose heartbeat reaches the robot
    made: int = 0
    rules: Rules = RULES
    active_at: float | None = None  # when the robot last showed a sign of its driver
    signs: dict[str, float] = field(default_factory=dict)  # session: when its page last gave one
    asked: tuple[str, float] | None = None

    @property
    def scene(self) -> Scene:
        return Scene(
            self.hold,
            tuple(self.sessions.values()),
            enabled=self.enabled,
            online=self.online,
            pause="" if self.maintenance_at is None else MAINTENANCE,
            maintenance_at=self.maintenance_at,
        )

    @property
    def link(self) -> RobotLink:
        if not self.online:
            return RobotLink(
                0.0, self.offline_since, self.offline_since, self.hold.session, self.hold.epoch, 0.1
            )
        holder = self.scene.holder
        silence = None if holder is None else (0.1 if holder.visitor in self.connected else 60.0)
        known = {
            "moved": False,
            "active_at": self.active_at,
            "asked": self.asked,
            "signs": self.signs,
        }
        return RobotLink(
            0.0, self.now, self.now, self.hold.session, self.hold.epoch, silence, **known
        )

    def session_of(self, visitor: str) -> ActiveSession | None:
        return next((each for each in self.sessions.values() if each.visitor == visitor), None)

    def take(
        self,
        visitor: str,
        *,
        peer: str = "",
        session: str | None = None,
        old_peer: str | None = None,
        takeover: bool = False,
    ):
        peer = peer or f"peer-of-{visitor}"
        decision = decide_take(
            self.scene, Ask(visitor, peer, session, old_peer, takeover), self.rules, self.now
        )
        match decision:
            case Grant(None):
                self._give(self._join(visitor), decision, peer)
            case Grant(session):
                self._give(session, decision, peer)
            case Wait(None):
                self._join(visitor)
            case Wait(session) | Resume(session):
                self.change(
                    session,
                    seen_at=self.now,
                    lost_at=None if isinstance(decision, Wait) else self.sessions[session].lost_at,
                )
            case Refused():
                pass
        return decision

    def _join(self, visitor: str) -> str:
        self.made += 1
        session = f"s{self.made:04d}"
        assert self.session_of(visitor) is None
        self.sessions[session] = ActiveSession(
            session, visitor, "waiting", self.now + self.made * 1e-6, seen_at=self.now
        )
        return session

    def _give(self, session: str, grant: Grant, peer: str) -> None:
        assert self.scene.holder is None or self.scene.holder.id == session, "two drivers"
        self.hold = Hold(self.hold.epoch + 1, session, peer)
        each = self.sessions[session]
        self.grants.append((self.hold.epoch, each.visitor))
        lost = self.now if grant.state == "reconnecting" else None
        self.change(session, state=grant.state, seen_at=self.now, lost_at=lost)
        if not grant.returning:
            self.change(session, granted_at=self.now, offered_at=None, turn_ends_at=None)

    def change(self, session: str, **changes: object) -> None:
        self.sessions[session] = replace(self.sessions[session], **changes)

    def end(self, session: str, outcome: str, reason: str) -> None:
        each = self.sessions.pop(session)
        self.ended[session] = (each.visitor, outcome, reason)
        self.connected.discard(each.visitor)
        if self.hold.session == session:
            self.hold = Hold(self.hold.epoch + 1)

    def pages_say_they_are_open(self, visitors) -> None:
        for each in list(self.sessions.values()):
            if each.visitor in visitors:
                self.change(
                    each.id,
                    seen_at=self.now,
                    lost_at=None if each.state == "waiting" else each.lost_at,
                )

    def tick(self, link: RobotLink | None = None):
        acts = decide_tick(self.scene, link or self.link, self.rules, self.now)
        for act in acts:
            match act:
                case ReleaseLease(epoch):
                    assert epoch == self.hold.epoch
                    self.hold = Hold(epoch + 1)
                case SetState(session, state, lost_at):
                    self.change(session, state=state, lost_at=lost_at)
                case Ended(session=session, outcome=outcome, reason=reason):
                    self.end(session, outcome, reason)
                case TurnLimited(session, ends_at):
                    self.change(session, turn_ends_at=ends_at)
                case TurnUnlimited(session):
                    self.change(session, turn_ends_at=None)
                case Offered(session=session):
                    self.change(session, offered_at=self.now)
                case WithdrawOffer(session):
                    self.change(session, offered_at=None)
                case MarkLost(session, lost_at):
                    self.change(session, lost_at=lost_at)
                case FirstMotion(session):
                    self.change(session, drove=True)
                case PresenceAsked(session=session):
                    self.asked = session, self.now
                case PresenceConfirmed():
                    self.asked = None
        return acts
