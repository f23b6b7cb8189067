"""The newest state, signs of the driver, and clock of each robot, in memory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from robots.api.idle import ONLINE_SECONDS
from robots.api.messages import ActionStatus, Connection, Heartbeat, State
from robots.bridge.known import refutation
from sessions.leases.transitions import RobotLink
from sessions.manager.clock_offset import ClockOffset
from sessions.visitor_motion import BY_ITSELF, VisitorMotion

PEER = "server"
AWAKE_SECONDS = 2.0  # an idle robot sends no heartbeats, any other five a second
ANSWERS_KEPT = 50
ECHO_SECONDS = 5.0
# Seconds: twice the age at which a robot refuses a command, so that it cannot be driven over the
# broker.
ROUND_TRIP = 0.5
NO_SIGNS: Mapping[str, float] = MappingProxyType({})


@dataclass
class RobotLiveness:
    """One robot. Times are monotonic seconds: jumps of the clock make no robot silent."""

    last_received_at: float = -math.inf
    boot: str = ""
    seq: int = -1
    state_at: float | None = None
    state: State | None = None
    motion: VisitorMotion = field(default_factory=VisitorMotion)
    moved: tuple[str, int] | None = None  # session and epoch in which it moved for its visitor
    active_at: float | None = None
    page: tuple[str, int] | None = None  # session and epoch of the page that drives, or drove last
    beat_at: float = -math.inf
    echoed_at: float = -math.inf  # when it last echoed a heartbeat of ours
    offline_at: float | None = None  # when OFFLINE was received; None while it is online
    offset: ClockOffset = field(default_factory=lambda: ClockOffset(PEER))
    beats: int = 0
    answers: dict[str, ActionStatus] = field(default_factory=dict)

    def connection(self, message: Connection, now: float) -> None:
        """Note ONLINE or OFFLINE; a new run of the agent may have another clock."""
        if message.state == "ONLINE":
            self.last_received_at, self.offline_at = now, None
            self._new_run(message.boot)
        elif message.boot == self.boot:
            self.offline_at = now

    def heartbeat(self, message: Heartbeat, now: float, unix: float) -> None:
        """Note a heartbeat that was received at `now`, `unix` by our clock."""
        self.last_received_at = self.beat_at = now
        if self.offset.on_heartbeat(message, unix):
            self.echoed_at = now

    def refutation(self, unix: float) -> Connection | None:
        """Return, once, an ONLINE for a robot that was reported offline and still sends beats."""
        found = refutation(self.boot, self.offline_at, self.beat_at, unix)
        if found is not None:
            self.offline_at = None
        return found

    def answer(self, status: ActionStatus) -> None:
        """Note the status of an action; those of the last ANSWERS_KEPT are kept."""
        self.answers.pop(status.action_id, None)
        self.answers[status.action_id] = status
        if len(self.answers) > ANSWERS_KEPT:
            del self.answers[next(iter(self.answers))]

    def take(self, state: State, now: float) -> bool:
        """Note a state; False when it is an older one."""
        self.last_received_at = now
        self._new_run(state.boot)
        if state.seq <= self.seq:
            return False
        if self._is_sign(state):
            self.active_at = now
        self.seq, self.state_at, self.state = state.seq, now, state
        if self.motion.take(state) and state.session is not None:
            self.moved = (state.session, state.epoch)
        return True

    def _is_sign(self, state: State) -> bool:
        """Tell whether a state shows that its driver is present: a page has connected, drives,
        talks, or has sent the robot somewhere. An active emergency stop counts, too: there is
        nothing that a driver could do, and no other visitor could drive.
        """
        before = self.page
        if state.session is not None:  # a lease that lapsed and was renewed is not a new page
            self.page = (state.session, state.epoch)
        return (
            self.page != before
            or bool(state.applied)
            or state.mode in BY_ITSELF
            or state.call is not None
            or state.safety.estop
        )

    def _new_run(self, boot: str) -> None:
        if boot != self.boot:
            self.boot, self.seq, self.offset = boot, -1, ClockOffset(PEER)

    def is_present(self, now: float) -> bool:
        """Tell whether the robot has sent anything recently; an idle one sends twice a minute."""
        return now - self.last_received_at < ONLINE_SECONDS

    def is_awake(self, now: float) -> bool:
        """Tell whether the robot sends at its full rate."""
        return now - self.beat_at < AWAKE_SECONDS

    def is_prompt(self, now: float) -> bool:
        """Tell whether the robot echoes our heartbeats soon enough to be driven."""
        trip = self.offset.round_trip
        return trip is not None and trip <= ROUND_TRIP and now - self.echoed_at <= ECHO_SECONDS

    def link(
        self, since: float, signs: Mapping[str, float] = NO_SIGNS, *, shift: float = 0.0
    ) -> RobotLink:
        """Return the scheduler's input, in Unix seconds: monotonic ones plus `shift`. `signs` are
        those of the pages of all sessions.
        """
        last_received_at = self.last_received_at + shift
        state = self.state
        if state is None:
            return RobotLink(since=since, last_received_at=last_received_at, signs=signs)
        return RobotLink(
            since,
            last_received_at,
            None if self.state_at is None else self.state_at + shift,
            state.session,
            state.epoch,
            state.visitor_silence,
            self.moved == (state.session, state.epoch),
            None if self.active_at is None else self.active_at + shift,
            signs=signs,
        )
