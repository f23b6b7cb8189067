"""What the page of a hidden operator is told of its robot and session: pure.

It is a list of what may pass, because an operator may be blind to the condition, which a state
tells by its assistance and its network: of a state and a pose only what `RobotView` and the pose
itself have.
"""

from robots.api.codec import encode_frame
from robots.api.messages import PoseUpdate, State
from robots.bridge.delivery import ReceivedMessage
from sessions import protocol as pages
from sessions.consumers.relay import Outgoing, relayed
from sessions.wizard import protocol


def for_wizard(inbound: ReceivedMessage, peer: str) -> Outgoing | None:
    """Return what an operator's page with this peer id is told of a robot's message; None when it
    is none of its business.
    """
    match inbound:
        case ReceivedMessage(suffix="state", message=State() as state):
            return Outgoing(encode_frame("wizard/state", view_of(state)), droppable=True)
        case ReceivedMessage(suffix="pose", message=PoseUpdate() as update):
            pose = PoseUpdate(stamp=update.stamp, pose=update.pose, velocity=update.velocity)
            return Outgoing(encode_frame("pose", pose), droppable=True)
        case ReceivedMessage(suffix="receipt", frame=str() as frame):
            return Outgoing(frame)
    if inbound.suffix in {"heartbeat", "action", f"{pages.SIGNAL}/{peer}/reply"}:
        return relayed(inbound, peer)
    return None


def view_of(state: State) -> protocol.RobotView:
    """Return what an operator is told of a state."""
    return protocol.RobotView(
        stamp=state.stamp,
        pose=state.pose,
        velocity=state.velocity,
        battery=state.battery,
        docked=state.docked,
        mode="manual" if state.mode == "assisted" else state.mode,
        tilt=state.tilt,
        safety=state.safety,
        epoch=state.epoch,
        command_age=max(0.0, state.applied[-1].age) if state.applied else None,
    )


def participant_view(frame: str) -> protocol.ParticipantView | None:
    """Return what an operator is shown of a notice to the participant's page; None of one that is
    not about the task.
    """
    notice = pages.decode_notice(frame)
    if not isinstance(notice, pages.Task):
        return None
    return protocol.ParticipantView(
        cue=notice.cue, number=notice.number, remaining=notice.remaining, outcome=notice.outcome
    )
