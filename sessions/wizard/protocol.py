"""The messages between the page of a hidden operator and the server, beside Robot API v1.

Frames are as in sessions/protocol.py. The page sends `command/velocity`, `command/heartbeat`,
`command/action` with a stop, `signal`, and the messages below. The server relays no message that
reveals the condition of a study: of a state only the fields of `RobotView`.
"""

from typing import Annotated, Any, Literal

from msgspec import Meta

from robots.api.messages import (
    Battery,
    Bye,
    Candidate,
    Count,
    IceServer,
    Id,
    Message,
    Mode,
    Name,
    Pose,
    Reason,
    Safety,
    SdpOffer,
    Seconds,
    Stamp,
    Velocity,
)
from sessions import protocol
from sessions.protocol import decoders_of
from sessions.wizard.script import Deviation, Script

PATH = "ws/robots/<slug:robot>/wizard/"
Line = Annotated[str, Meta(min_length=1, max_length=500)]

# --- page → server --------------------------------------------------------------------------------


class TakeOver(Message, frozen=True, kw_only=True):
    """`wizard/take`: I operate this session; `takeover` from another operator."""

    session: Id
    takeover: bool = False


class StopOperating(Message, frozen=True, kw_only=True):
    """`wizard/release`: I stop operating the session."""


class BeginStep(Message, frozen=True, kw_only=True):
    """`wizard/step`: do this step of the script."""

    step: Id
    action_id: Id
    stamp: Stamp


class FreeLine(Message, frozen=True, kw_only=True):
    """`wizard/line`: say a text that the script does not have."""

    text: Line
    aloud: bool = True
    action_id: Id
    stamp: Stamp


class Reached(Message, frozen=True, kw_only=True):
    """`wizard/reached`: the robot received a step `latency` s after the press, by both clocks."""

    action_id: Id
    latency: Annotated[float, Meta(ge=0.0, le=60.0)]


# --- server → page --------------------------------------------------------------------------------


class WizardHello(Message, frozen=True, kw_only=True):
    """`wizard/hello`: first frame. `peer` is secret to this page."""

    peer: Id
    stamp: Stamp
    robot: Id
    online: bool
    ice_servers: tuple[IceServer, ...] = ()


class SessionToOperate(Message, frozen=True, kw_only=True):
    """`wizard/session`: the session at the robot, None without one.

    `participant` is a code, `condition` its title unless the operator is blind to it, `operator`
    who operates: this page, another one, or none. `visitor_seen` is whether the participant's page
    is open.
    """

    session: Id | None = None
    participant: Name = ""
    condition: Name = ""
    visitor_seen: bool = False
    operator: Literal["", "me", "other"] = ""
    script: Script | None = None
    done: Annotated[tuple[Id, ...], Meta(max_length=2000)] = ()


class Operating(Message, frozen=True, kw_only=True):
    """`wizard/granted`: you operate the session, with this epoch in your commands."""

    session: Id
    epoch: Count


class Lost(Message, frozen=True, kw_only=True):
    """`wizard/lost`: you no longer operate: `taken` by another operator, `ended`, or `refused`."""

    reason: Literal["taken", "ended", "refused", "occupied"]


class StepBegun(Message, frozen=True, kw_only=True):
    """`wizard/begun`: a step was taken, or not for a `reason`."""

    step: Id
    action_id: Id
    deviation: Deviation = ""
    skipped: Count = 0
    reason: Reason = ""


class RobotView(Message, frozen=True, kw_only=True):
    """`wizard/state`: the part of a robot's state that the operator receives. `command_age` is the
    age of the newest velocity when it reached the wheels, in seconds.
    """

    stamp: Stamp
    pose: Pose
    velocity: Velocity
    battery: Battery
    docked: bool
    mode: Mode
    tilt: float | None = None
    safety: Safety
    epoch: Count = 0
    command_age: Seconds | None = None


class ParticipantView(Message, frozen=True, kw_only=True):
    """`wizard/participant`: the cue on the participant's page, and the rest of the task's time."""

    cue: Name = ""
    number: Count | None = None
    remaining: Seconds | None = None
    outcome: Name = ""


TO_SERVER: dict[str, type] = {
    "wizard/take": TakeOver,
    "wizard/release": StopOperating,
    "wizard/step": BeginStep,
    "wizard/line": FreeLine,
    "wizard/reached": Reached,
}
TO_PAGE: dict[str, type] = {
    "wizard/hello": WizardHello,
    "wizard/session": SessionToOperate,
    "wizard/granted": Operating,
    "wizard/lost": Lost,
    "wizard/begun": StepBegun,
    "wizard/state": RobotView,
    "wizard/participant": ParticipantView,
}
_DECODERS = decoders_of({**TO_SERVER, "signal": SdpOffer | Candidate | Bye})


def decode(suffix: str, payload: str) -> Any:
    """Return the message of an operator's frame.

    Raises:
        Rejection: unknown suffix or malformed.
    """
    return protocol.decode(suffix, payload, _DECODERS)
