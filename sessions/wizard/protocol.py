"""What the page of a hidden operator and the server say to each other, beside Robot API v1.

Frames are as in sessions/protocol.py. The page sends `command/velocity`, `command/heartbeat`,
`command/action` with a stop, `signal`, and what is below. The server relays no message that tells
the condition of a study: of a state only what `RobotView` has.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from robots.api.errors import Rejection
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
from sessions.wizard.script import Deviation, Script

PATH = "ws/robots/<slug:robot>/wizard/"
Line = Annotated[str, Meta(min_length=1, max_length=500)]

# --- page → server --------------------------------------------------------------------------------


class TakeOver(Message, frozen=True, kw_only=True):
    """`wizard/take`: I operate this session; `takeover` although somebody else does."""

    session: Id
    takeover: bool = False


class StopOperating(Message, frozen=True, kw_only=True):
    """`wizard/release`: I operate it no more."""


class BeginStep(Message, frozen=True, kw_only=True):
    """`wizard/step`: do this step of the script."""

    step: Id
    action_id: Id
    stamp: Stamp


class FreeLine(Message, frozen=True, kw_only=True):
    """`wizard/line`: say what is not in the script."""

    text: Line
    aloud: bool = True
    action_id: Id
    stamp: Stamp


class Reached(Message, frozen=True, kw_only=True):
    """`wizard/reached`: `latency` seconds after it was pressed the robot had a step, by the clocks
    of both.
    """

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
    """`wizard/session`: the session at the robot; without one nobody takes part now.

    `participant` is a code, `condition` its title unless the operator is blind to it, `operator`
    who operates: this page, somebody else, or nobody. `visitor_seen` is whether the participant's
    page is open.
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
    """`wizard/lost`: you operate no more: `taken` by somebody else, `ended`, or `refused`."""

    reason: Literal["taken", "ended", "refused", "occupied"]


class StepBegun(Message, frozen=True, kw_only=True):
    """`wizard/begun`: a step was taken, or not for a `reason`."""

    step: Id
    action_id: Id
    deviation: Deviation = ""
    skipped: Count = 0
    reason: Reason = ""


class RobotView(Message, frozen=True, kw_only=True):
    """`wizard/state`: what the operator is told of a state of the robot. `command_age` is how old
    the newest velocity was when the wheels had it.
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
    """`wizard/participant`: the cue on the participant's page, and what is left of the task."""

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
_DECODERS: dict[str, msgspec.json.Decoder[Any]] = {
    suffix: msgspec.json.Decoder(kind) for suffix, kind in TO_SERVER.items()
} | {"signal": msgspec.json.Decoder(SdpOffer | Candidate | Bye)}


def decode(suffix: str, payload: str) -> Any:
    """Return the message of an operator's frame.

    Raises:
        Rejection: unknown suffix or malformed.
    """
    decoder = _DECODERS.get(suffix)
    if decoder is None:
        raise Rejection("unknown_topic", suffix[:80])
    try:
        return decoder.decode(payload)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Rejection("malformed", f"{suffix}: {error}") from error
