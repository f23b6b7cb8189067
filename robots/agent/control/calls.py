"""How far a visitor is let through to the people at the robot: decisions only.

A visitor who wants to be heard or seen rings. Where the owner's rule is `accept` the visitor is
through at once; where it is `ask` somebody at the robot's screen decides, and until then nothing of
the visitor's voice and face leaves the agent. An answer holds for the rest of the session; what the
page sends must be said anew by each page that takes the session, because a page begins in silence.

A knock sends nothing. It rings at the robot so that somebody comes, at most every ten seconds, and
not once somebody has answered with "not now": until the end of the session the robot stays quiet.
"""

from dataclasses import dataclass
from typing import Literal

from robots.api.messages import Call, CallState, KnockState, Lease

RINGS = 45.0  # s until somebody who could answer is taken not to be there

KNOCK_RINGS = 30.0  # s that a knock is shown and can be answered
KNOCK_TOLD = 60.0  # s after which nobody is told of it any more
KNOCK_PAUSE = 10.0  # s between two knocks, whoever drives

Rule = Literal["accept", "ask"]
Status = Literal["ringing", "accepted", "declined", "unanswered"]


@dataclass(frozen=True)
class Passing:
    """What of the driver's media is let through now, and how loud, as a share."""

    audio: bool = False
    video: bool = False
    volume: float = 1.0


NOTHING = Passing()


@dataclass
class _Knock:
    """A knock that was heard; `answer` is what somebody at the screen made of it."""

    action_id: str
    session: str
    at: float
    answer: Literal["answered", "declined"] | None = None


class CallControl:
    """The call and the knock of whoever drives. `now` is monotonic seconds, `lease` the live one.

    Args:
        knock_pause: seconds between two knocks.
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
        """Take a knock; return in one word why nobody hears it, or None.

        Args:
            action_id: that of the knock.
            lease: the live one.
            now: monotonic seconds.
            audible: whether a display is connected or the robot has a loudspeaker.
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
        """Tell whether the driver may knock, but for the pause between two knocks."""
        return lease is not None and audible and not self._is_quiet(lease)

    def answer_knock(
        self, action_id: str, *, accept: bool, lease: Lease | None, now: float
    ) -> str | None:
        """Take the answer of somebody at the screen to a knock; return in one word why there is
        nothing to answer, or None.
        """
        knock = self._knock_of(lease, now)
        if knock is None or knock.action_id != action_id or lease is None:
            return "nobody_knocks"
        knock.answer = "answered" if accept else "declined"
        if accept:
            self._turn_to(lease)
            self._status = "accepted"
        return None

    def knocking(self, lease: Lease | None, now: float) -> KnockState | None:
        """Return how the newest knock of this session stands; None when there is none to tell."""
        knock = self._knock_of(lease, now)
        if knock is None:
            return None
        rings = now - knock.at <= KNOCK_RINGS
        return KnockState(
            action_id=knock.action_id,
            status=knock.answer or ("ringing" if rings else "unanswered"),
        )

    def _knock_of(self, lease: Lease | None, now: float) -> _Knock | None:
        knock = self._knock
        return (
            knock
            if knock is not None
            and lease is not None
            and knock.session == lease.session
            and now - knock.at <= KNOCK_TOLD
            else None
        )

    def _is_quiet(self, lease: Lease) -> bool:
        knock = self._knock
        return knock is not None and knock.session == lease.session and knock.answer == "declined"

    def ask(self, call: Call, lease: Lease, now: float) -> None:
        """Take what the driver wants; one who was declined must hang up before ringing again."""
        self._turn_to(lease)
        if not call.ringing:
            self._call = None
            self._status = self._status if self._status == "accepted" else None
            return
        if self._call is None and self._status != "accepted":
            self._status, self._since = "ringing", now
        self._call = call

    def answer(self, *, accept: bool, lease: Lease | None, now: float) -> str | None:
        """Take the answer of somebody at the screen; return in one word why there is nothing to
        answer, or None.

        Whoever was let through may be declined later: that is how somebody at the robot hangs up.
        """
        state = self.state(lease, now)
        if state is None:
            return "nobody_calls"
        self._status = "accepted" if accept else "declined"
        return None

    def state(self, lease: Lease | None, now: float) -> CallState | None:
        """Return how the call stands; None when nobody calls."""
        call = self._of(lease)
        if call is None or self._status is None:
            return None
        status = self._status
        if status == "ringing":
            status = (
                "accepted"
                if self.rule == "accept"
                else "unanswered"
                if now - self._since > RINGS
                else "ringing"
            )
        return CallState(
            status=status,
            audio=call.audio,
            video=call.video,
            volume=call.volume,
            shares=call.shares,
        )

    def passing(self, lease: Lease | None, now: float) -> Passing:
        """Return what is let through."""
        state = self.state(lease, now)
        return (
            Passing(state.audio, state.video, state.volume)
            if state is not None and state.status == "accepted"
            else NOTHING
        )

    def shows_screen(self, lease: Lease | None, now: float) -> bool:
        """Tell whether the people at the robot see a screen that the visitor shares, and may point
        at what is on it.
        """
        state = self.state(lease, now)
        return state is not None and state.status == "accepted" and state.video and state.shares

    def _of(self, lease: Lease | None) -> Call | None:
        return (
            self._call
            if lease is not None and (lease.session, lease.epoch) == (self._session, self._epoch)
            else None
        )

    def _turn_to(self, lease: Lease) -> None:
        if lease.session != self._session:
            self._status = None
        if (lease.session, lease.epoch) != (self._session, self._epoch):
            self._session, self._epoch, self._call = lease.session, lease.epoch, None
