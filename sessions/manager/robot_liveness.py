"""What the session manager has heard of robots, in memory: the newest state of each, whether it is
driven, and its clock.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from robots.api.idle import ONLINE_SECONDS
from robots.api.messages import ActionStatus, Connection, Heartbeat, State
from robots.bridge.known import refutation
from sessions.leases.transitions import RobotLink
from sessions.manager.clock_offset import ClockOffset

PEER = "server"
AWAKE_SECONDS = 2.0  # an idle robot sends no heartbeats, any other five a second
ANSWERS_KEPT = 50
ECHO_SECONDS = 5.0
# seconds: twice the age at which a robot refuses a command, so whoever drives it over the broker
# could not
ROUND_TRIP = 0.5
NO_SIGNS: Mapping[str, float] = MappingProxyType({})
BY_ITSELF = frozenset({"goto", "docking"})


@dataclass
class RobotLiveness:
    """One robot. Times in seconds of a monotonic clock, of receipt: a step of the server's clock
    makes no robot silent.
    """

    last_received_at: float = -math.inf
    boot: str = ""
    seq: int = -1
    state_at: float | None = None
    state: State | None = None
    moved: tuple[str, int] | None = None
    active_at: float | None = None
    page: tuple[str, int] | None = None  # session and epoch of the page that drives, or drove last
    beat_at: float = -math.inf
    echoed_at: float = -math.inf  # when it answered a beat of ours
    gone_at: float | None = None
    offset: ClockOffset = field(default_factory=lambda: ClockOffset(PEER))
    beats: int = 0
    answers: dict[str, ActionStatus] = field(default_factory=dict)

    def connection(self, message: Connection, now: float) -> None:
        """Note that the robot came or went; a new run of the agent may have another clock."""
        if message.state == "ONLINE":
            self.last_received_at, self.gone_at = now, None
            self._new_run(message.boot)
        elif message.boot == self.boot:
            self.gone_at = now

    def heartbeat(self, message: Heartbeat, now: float, unix: float) -> None:
        """Note a beat that came now, which is `unix` by our clock."""
        self.last_received_at = self.beat_at = now
        if self.offset.on_heartbeat(message, unix):
            self.echoed_at = now

    def refutation(self, unix: float) -> Connection | None:
        """Return what a robot that is said to have gone and still beats would say; once."""
        found = refutation(self.boot, self.gone_at, self.beat_at, unix)
        if found is not None:
            self.gone_at = None
        return found

    def answer(self, status: ActionStatus) -> None:
        """Note how far an action is, of the last few."""
        self.answers.pop(status.action_id, None)
        self.answers[status.action_id] = status
        if len(self.answers) > ANSWERS_KEPT:
            del self.answers[next(iter(self.answers))]

    def take(self, state: State, now: float) -> bool:
        """Note a state; False when it is an older one, sent again."""
        self.last_received_at = now
        self._new_run(state.boot)
        if state.seq <= self.seq:
            return False
        if self._is_sign(state):
            self.active_at = now
        self.seq, self.state_at, self.state = state.seq, now, state
        if state.session is not None and any(
            command.linear or command.angular for command in state.applied
        ):
            self.moved = (state.session, state.epoch)
        return True

    def _is_sign(self, state: State) -> bool:
        """Tell whether a state shows that its driver is there: a page has come, drives, talks, or
        has told the robot where to go. While the emergency stop is on, there is nothing to do, and
        nobody else could drive.
        """
        before = self.page
        if state.session is not None:  # a lease that lapsed and was renewed is no page that came
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
        """Tell whether the robot was heard of lately; an idle one is silent for half a minute."""
        return now - self.last_received_at < ONLINE_SECONDS

    def is_awake(self, now: float) -> bool:
        """Tell whether the robot speaks at its full rate."""
        return now - self.beat_at < AWAKE_SECONDS

    def is_prompt(self, now: float) -> bool:
        """Tell whether the robot answers our beats, and at the best of the last ones soon enough to
        be driven.
        """
        trip = self.offset.round_trip
        return trip is not None and trip <= ROUND_TRIP and now - self.echoed_at <= ECHO_SECONDS

    def link(
        self, since: float, signs: Mapping[str, float] = NO_SIGNS, *, shift: float = 0.0
    ) -> RobotLink:
        """Return what the scheduler needs to know, in Unix seconds: those of the monotonic clock
        plus `shift`. `signs` are those of pages, of every session.
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
