"""What the page of a hidden operator may send to the robot: pure.

The page drives only while the lease names it as the wizard of its session, and only as the script
has it: by hand where the study allows that, otherwise with the velocities of a step that has begun.
It may stop the robot at any time, as any page may.
"""

from collections.abc import Callable
from typing import Any

import msgspec

from robots.api.messages import (
    Bye,
    Cancel,
    Candidate,
    CommandHeartbeat,
    EStop,
    IceServer,
    Lease,
    SdpOffer,
    Stop,
    VelocityCommand,
)
from sessions.consumers.authorization import (
    Authorization,
    Effect,
    FrameRefused,
    Halt,
    Publish,
    Verb,
)
from sessions.wizard import protocol

SCRIPT = "script"  # the input method of a step


class WizardAuthorization(Authorization):
    """The permissions of an operator's page.

    Args:
        peer: the id that the server made for this connection.
        ice_servers: as of Authorization.
    """

    _protocol = protocol

    def __init__(self, peer: str, ice_servers: Callable[[], tuple[IceServer, ...]] = tuple) -> None:
        super().__init__(peer, "", None, ice_servers)
        self.watches = True
        self.by_hand = False
        self.script_until = float("-inf")

    def operate(self, session: str, epoch: int, *, by_hand: bool) -> None:
        """The page now drives in a session."""
        self.session, self.epoch, self.by_hand = session, epoch, by_hand
        self.velocity_seq, self.script_until = 0, float("-inf")

    def release(self) -> None:
        """The page no longer operates a session."""
        self.session, self.epoch, self.by_hand = None, 0, False

    def holds(self, _lease: Lease | None) -> bool:
        """The lease's session is never the operator's."""
        return False

    def drives(self, lease: Lease | None) -> bool:
        """Tell whether the lease names this page as its wizard."""
        return (
            lease is not None
            and lease.kind == "wizard"
            and (lease.session, lease.wizard, lease.wizard_epoch)
            == (self.session, self.peer, self.epoch)
        )

    def _effect(self, suffix: str, message: Any, lease: Lease | None, now: float) -> Effect:
        match message:
            case VelocityCommand():
                self._check_method(message, now)
                return self._velocity(message, lease, now)
            case CommandHeartbeat():
                if not self.drives(lease):
                    raise self._not_driving()
                beat = msgspec.structs.replace(message, peer=self.peer)
                return Publish(suffix, beat, wanted=False)
            case Stop() | EStop():
                return Halt(self._stamp_stop(message, lease))
            case Cancel():
                return Publish(suffix, self.stamp_action(message, lease))
            case SdpOffer():
                offer = SdpOffer(sdp=message.sdp, role="wizard", ice_servers=self.ice_servers())
                return Publish(f"signal/{self.peer}", offer)
            case Candidate() | Bye():
                return Publish(f"signal/{self.peer}", message)
        if type(message) in protocol.TO_SERVER.values():
            return Verb(suffix, message)
        raise FrameRefused("not_allowed")

    def _check_method(self, command: VelocityCommand, now: float) -> None:
        """Refuse a velocity that is neither of a step that has begun nor allowed by hand."""
        moves = command.linear != 0.0 or command.angular != 0.0
        is_script = command.method == SCRIPT
        if moves and not (now < self.script_until if is_script else self.by_hand):
            raise FrameRefused("not_allowed")
