"""Which of a visitor's media reach the people at the robot. Pure.

A visitor who wants to speak or be seen rings. With the owner's rule `accept` the visitor is
accepted at once; with `ask` a person at the robot's screen decides, and until then no voice or
video leaves the agent. An answer holds for the rest of the session. Each page that takes over the
session must send its call again, because a page starts silent.

A knock sends no media. It rings at the robot, at most every ten seconds, and not again in a session
after the answer "not now".
"""

from dataclasses import dataclass
from typing import Literal

from robots.api.messages import Call, CallState, KnockState, Lease

RINGS = 45.0  # s after which a call counts as unanswered

KNOCK_RINGS = 30.0  # s for which a knock rings
KNOCK_REPORTED = 60.0  # s for which a knock is reported and can be answered
KNOCK_PAUSE = 10.0  # s between two knocks, of one driver or of two

Rule = Literal["accept", "ask"]
Status = Literal["ringing", "accepted", "declined", "unanswered"]


@dataclass(frozen=True)
class Passing:
    """The driver's media that are let through now; `volume` is a share."""

    audio: bool = False
    video: bool = False
    volume: float = 1.0


NOTHING = Passing()


@dataclass
class _Knock:
    """A knock that rang, and its answer at the screen."""

    action_id: str
    session: str
    at: float
    answer: Literal["answered", "declined"] | None = None


class CallControl:
    """The call and the knock of the driver. `now` is monotonic seconds, `lease` the live one,
    `knock_pause` seconds between two knocks. A returned reason is one word.
    """

    def __init__(self, knock_pause: float = KNOCK_PAUSE) -> None:
        self.knock_pause = knock_pause
        self.rule: Rule = "accept"
        self._session = ""
        self._epoch = -1
        self._status: Status | None = None
        self._since = 0.0
        self._call: Call | None = None
        self._knock: _Knock | None = None

    def knock(
        self, action_id: str, lease: Lease | None, now: float, *, audible: bool
    ) -> str | None:
        """Take a knock; return why it does not ring, or None. It is `audible` with a connected
        display or a loudspeaker.
        """
        if lease is None or not audible:
            return "nobody_there"
        if self._is_quiet(lease):
            return "declined"
        if self._knock is not None and now - self._knock.at < self.knock_pause:
            return "too_soon"
        self._knock = _Knock(action_id, lease.session, now)
        return None

    def knockable(self, lease: Lease | None, *, audible: bool) -> bool:
        """Tell whether the driver may knock, apart from the pause between two knocks."""
        return lease is not None and audible and not self._is_quiet(lease)

    def answer_knock(
        self, action_id: str, *, accept: bool, lease: Lease | None, now: float
    ) -> str | None:
        """Take the screen's answer to a knock; return why there is none to answer, or None."""
        knock = self._knock_of(lease, now)
        if knock is None or knock.action_id != action_id or lease is None:
            return "nobody_knocks"
        knock.answer = "answered" if accept else "declined"
        if accept:
            self._follow_lease(lease)
            self._status = "accepted"
        return None

    def knocking(self, lease: Lease | None, now: float) -> KnockState | None:
        """Return the newest knock of this session, None when there is none to report."""
        knock = self._knock_of(lease, now)
        if knock is None:
            return None
        unanswered: Literal["ringing", "unanswered"] = (
            "ringing" if now - knock.at <= KNOCK_RINGS else "unanswered"
        )
        return KnockState(action_id=knock.action_id, status=knock.answer or unanswered)

    def _knock_of(self, lease: Lease | None, now: float) -> _Knock | None:
        knock = self._knock
        if knock is None or lease is None or knock.session != lease.session:
            return None
        return knock if now - knock.at <= KNOCK_REPORTED else None

    def _is_quiet(self, lease: Lease) -> bool:
        knock = self._knock
        return knock is not None and knock.session == lease.session and knock.answer == "declined"

    def ask(self, call: Call, lease: Lease, now: float) -> None:
        """Take the driver's call; after a refusal it must end before it can ring again."""
        self._follow_lease(lease)
        if not call.ringing:
            self._call = None
            self._status = self._status if self._status == "accepted" else None
            return
        if self._call is None and self._status != "accepted":
            self._status, self._since = "ringing", now
        self._call = call

    def answer(self, *, accept: bool, lease: Lease | None, now: float) -> str | None:
        """Take the screen's answer; return why there is no call, or None. An accepted call can be
        declined later: that is how the people at the robot hang up.
        """
        if self.state(lease, now) is None:
            return "nobody_calls"
        self._status = "accepted" if accept else "declined"
        return None

    def state(self, lease: Lease | None, now: float) -> CallState | None:
        """Return the state of the call, None without one."""
        call = self._of(lease)
        if call is None or self._status is None:
            return None
        status = self._status
        if status == "ringing" and self.rule == "accept":
            status = "accepted"
        elif status == "ringing" and now - self._since > RINGS:
            status = "unanswered"
        return CallState(
            status=status,
            audio=call.audio,
            video=call.video,
            volume=call.volume,
            shares=call.shares,
        )

    def passing(self, lease: Lease | None, now: float) -> Passing:
        state = self.state(lease, now)
        if state is None or state.status != "accepted":
            return NOTHING
        return Passing(state.audio, state.video, state.volume)

    def shows_screen(self, lease: Lease | None, now: float) -> bool:
        """Tell whether the people at the robot see the visitor's shared screen, and may point at
        it.
        """
        state = self.state(lease, now)
        return state is not None and state.status == "accepted" and state.video and state.shares

    def _of(self, lease: Lease | None) -> Call | None:
        if lease is None or (lease.session, lease.epoch) != (self._session, self._epoch):
            return None
        return self._call

    def _follow_lease(self, lease: Lease) -> None:
        if lease.session != self._session:
            self._status = None
        if (lease.session, lease.epoch) != (self._session, self._epoch):
            self._session, self._epoch, self._call = lease.session, lease.epoch, None
