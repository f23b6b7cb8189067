"""How far a visitor is let through to the people at the robot: decisions only.

A visitor who wants to be heard or seen rings. Where the owner's rule is `accept` the visitor is
through at once; where it is `ask` somebody at the robot's screen decides, and until then nothing of
the visitor's voice and face leaves the agent. An answer holds for the rest of the session; what the
page sends must be said anew by each page that takes the session, because a page begins in silence.
"""

from dataclasses import dataclass
from typing import Literal

from robots.api.messages import Call, CallState, Lease

RINGS = 45.0  # s until somebody who could answer is taken not to be there

Rule = Literal["accept", "ask"]
Status = Literal["ringing", "accepted", "declined", "unanswered"]


@dataclass(frozen=True)
class Passing:
    """What of the driver's media is let through now, and how loud, as a share."""

    audio: bool = False
    video: bool = False
    volume: float = 1.0


NOTHING = Passing()


class CallControl:
    """The call of whoever drives. `now` is monotonic seconds, `lease` the live one."""

    def __init__(self) -> None:
        self.rule: Rule = "accept"
        self._session = ""
        self._epoch = -1
        self._status: Status | None = None
        self._since = 0.0
        self._call: Call | None = None

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
