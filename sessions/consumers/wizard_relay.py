"""The messages of robot and session for the page of a hidden operator: pure.

An allow-list, because the operator may be blind to the condition, which a state's assistance and
network would reveal: of a state only the fields of `RobotView`, of a pose update only the pose and
the velocity.
"""

from robots.api.codec import encode_frame
from robots.api.messages import PoseUpdate, State
from robots.bridge.delivery import ReceivedMessage
from sessions import protocol as pages
from sessions.consumers.relay import Outgoing, relayed
from sessions.wizard import protocol


def for_wizard(inbound: ReceivedMessage, peer: str) -> Outgoing | None:
    """Return the frame of a robot's message for an operator's page with this peer id; None for
    messages that are not on the list.
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
    """Return the part of a state that an operator may see."""
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
    """Return the operator's view of a notice to the participant's page; None for a notice that is
    not about the task.
    """
    notice = pages.decode_notice(frame)
    if not isinstance(notice, pages.Task):
        return None
    return protocol.ParticipantView(
        cue=notice.cue, number=notice.number, remaining=notice.remaining, outcome=notice.outcome
    )
