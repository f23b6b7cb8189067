"""Who may say what from a robot's own display: the rules of that page's connection, without a
socket, a broker or a database.

A screen shows the visitor, answers a call, writes to the visitor and says that it has shown what
the visitor writes, points at what the visitor shares, and stops the robot. It never drives, and
says all of it as the screen.
"""

from typing import Any

import msgspec

from robots.api.messages import (
    AnswerCall,
    Bye,
    Candidate,
    ClearEStop,
    ConfirmWords,
    EStop,
    Lease,
    PointCommand,
    Say,
    SdpOffer,
    Stop,
)
from sessions.consumers.authorization import Authorization, Effect, FrameRefused, Halt, Publish


class ScreenAuthorization(Authorization):
    """The place of a robot's screen in its room.
    In its place `who` is what the robot is called, in whose name the screen speaks.
    """

    def _effect(self, suffix: str, message: Any, _lease: Lease | None, _now: float) -> Effect:
        match message:
            case Stop() | EStop():
                return Halt(self._as_screen(message))
            case Say() | AnswerCall() | ConfirmWords() | ClearEStop():
                return Publish(suffix, self._as_screen(message))
            case PointCommand():
                stamped = msgspec.structs.replace(
                    message, role="screen", peer=self.peer, session=None, epoch=0
                )
                return Publish(suffix, stamped, wanted=False)
            case SdpOffer():
                offer = SdpOffer(
                    sdp=message.sdp, role="screen", who=self.who, ice_servers=self.ice_servers()
                )
                return Publish(f"signal/{self.peer}", offer)
            case Candidate() | Bye():
                return Publish(f"signal/{self.peer}", message)
        raise FrameRefused("not_allowed")

    def _as_screen(self, action: Any) -> Any:
        stamped = msgspec.structs.replace(
            action, session=None, epoch=0, role="screen", user=self.who
        )
        # The number belongs to the driver's counter.
        return msgspec.structs.replace(stamped, seq=0) if isinstance(stamped, Stop) else stamped
