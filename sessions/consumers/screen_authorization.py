"""What a robot's own display may send to the robot: pure.

A screen shows the visitor's video, answers calls, writes messages, confirms the visitor's, points
at the shared picture, and stops the robot. It never drives. All of its messages have the role
`screen`.
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
from sessions.consumers.authorization import Effect, FrameRefused, Halt, PageAuthorization, Publish


class ScreenAuthorization(PageAuthorization):
    """The permissions of a robot's display; `who` is the robot's title."""

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
        # `seq` belongs to the driver's counter.
        return msgspec.structs.replace(stamped, seq=0) if isinstance(stamped, Stop) else stamped
