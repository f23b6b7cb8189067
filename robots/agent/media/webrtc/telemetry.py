"""States and poses as pages get them: enough to draw, small enough for a narrow network."""

from typing import Any, TypeVar

import msgspec

from robots.api.messages import Message, Pose, PoseUpdate, State

S = TypeVar("S", bound=msgspec.Struct)
DIGITS = 4  # tenths of a millimetre, and of a thousandth of a radian


def for_page(message: Message) -> Message:
    """Return the message with rounded pose and velocity, and only the newest of the commands that
    reached the wheels. The record, which is sent to the broker, has all of them.
    """
    if isinstance(message, State):
        message = msgspec.structs.replace(
            message, applied=tuple(map(_rounded, message.applied[-1:]))
        )
    if isinstance(message, State | PoseUpdate):
        return msgspec.structs.replace(
            message, pose=_pose(message.pose), velocity=_rounded(message.velocity)
        )
    return message


def _pose(pose: Pose) -> Pose:
    covariance = pose.covariance and tuple(round(value, 2 * DIGITS) for value in pose.covariance)
    return msgspec.structs.replace(_rounded(pose), covariance=covariance)


def _rounded(struct: S) -> S:
    floats: dict[str, Any] = {
        name: round(value, DIGITS)
        for name, value in msgspec.structs.asdict(struct).items()
        if isinstance(value, float)
    }
    return msgspec.structs.replace(struct, **floats)
