"""The messages between a page and the server on the WebSocket, beside Robot API v1.

A frame is a suffix, a newline, and a JSON object in camelCase, as on the data channel. Suffixes of
the Robot API mean the same here as on MQTT: the page sends `command/velocity`, `command/heartbeat`,
`command/action`, `command/picture`, `command/point`, `command/route`; the server relays `state`,
`pose`, `path`, `scan`, `route`, `event`, `action`, `heartbeat`, and to the page concerned `words`
and `pointer`. This file has the rest. Role, session, epoch and peer that a page sends are never
used: the server sets those of the lease.
"""

from typing import Annotated, Any, Literal

import msgspec
import structlog
from msgspec import Meta

from robots.api.codec import encode_frame
from robots.api.errors import Rejection
from robots.api.messages import (
    AssistLevel,
    Bye,
    Candidate,
    Count,
    IceServer,
    Id,
    InputMethod,
    LeaseLimits,
    Message,
    Metres,
    Name,
    NotNegative,
    Reason,
    SdpAnswer,
    SdpOffer,
    Seconds,
    Stamp,
)
from robots.api.topics import SERVER

log = structlog.stdlib.get_logger(__name__)

PATH = "ws/robots/<slug:robot>/"
CHECK_PATH = "ws/check/"
SCREEN_PATH = "ws/robots/<slug:robot>/screen/"
MAX_FRAME = 64 * 1024
# Bytes of JSON. Page reports are stored for a long time; the longest of our page has some 300.
MAX_REPORT = 1024

# Why the server closes a WebSocket: the page's CloseEvent.code.
SIGNED_OUT, NOT_ALLOWED, NO_SUCH_ROBOT = 4401, 4403, 4404
FLOODED, TOO_SLOW, REPLACED = 4008, 4009, 4010

# --- page → server ------------------------------------------------------------------------------


class Take(Message, frozen=True, kw_only=True):
    """`session/take`: I want to drive.

    `session` and `peer` are from an earlier `session/granted` of this same page, if its WebSocket
    was lost: same page, same peer, same epoch, and the drive continues. `takeover` moves a session
    of the same visitor from another tab to this page.
    """

    session: Id | None = None
    peer: Id | None = None
    takeover: bool = False


class Observe(Message, frozen=True, kw_only=True):
    """`session/observe`: I want to watch."""


class Leave(Message, frozen=True, kw_only=True):
    """`session/leave`: I am done (or leave the queue).

    `session` and `peer` name a session that was left while this page had no connection; without
    them it is the session of this page.
    """

    session: Id | None = None
    peer: Id | None = None


class Assist(Message, frozen=True, kw_only=True):
    """`session/assist`: how much the robot is to help me drive. The lease takes it to the robot,
    whose states have the level in force.
    """

    level: AssistLevel


Detail = Annotated[str, Meta(max_length=200)]


class PageEvent(Message, frozen=True, kw_only=True):
    """`page/event`: an event for the record, such as a controller chosen or a tab hidden."""

    stamp: Stamp
    type: Id
    data: Annotated[dict[Name, Detail | float | bool | None], Meta(max_length=16)] = {}


# The type of the page event that shows that the visitor is present, although not driving: typing,
# pressing, looking around.
HERE = "here"


class PageNetwork(Message, frozen=True, kw_only=True):
    """`page/network`: one second of the connection, by the browser; times in s, rates in bit/s."""

    stamp: Stamp
    way: Literal["datachannel", "mqtt"]
    round_trip: Seconds | None = None
    loss: NotNegative | None = None
    jitter: Seconds | None = None
    fps: NotNegative | None = None
    freezes: NotNegative | None = None
    bitrate: Annotated[float, Meta(ge=0.0, le=1e11)] | None = None
    frame_age: Seconds | None = None
    path: Name = ""


class WantOffer(Message, frozen=True, kw_only=True, tag_field="type", tag="want"):
    """`signal`, of a page that watches through the SFU: offer me a connection. The server answers
    with an SdpOffer, and the page with an SdpAnswer.
    """


class Direct(Message, frozen=True, kw_only=True):
    """`page/direct`: whether the robot's messages also arrive over the data channel."""

    direct: bool


QuestionText = Annotated[str, Meta(min_length=1, max_length=280)]
QuestionState = Literal["waiting", "answering", "answered", "declined"]


class RaiseHand(Message, frozen=True, kw_only=True):
    """`audience/hand`, of a page that watches: my hand goes up, or down."""

    raised: bool


class AskQuestion(Message, frozen=True, kw_only=True):
    """`audience/ask`, of a page that watches: a question to the driver."""

    text: QuestionText


class MarkQuestion(Message, frozen=True, kw_only=True):
    """`audience/mark`, of the driver's page, or of an operator's page that watches: the new state
    of a question.
    """

    question: Id
    state: Literal["answering", "answered", "declined"]


class LowerHands(Message, frozen=True, kw_only=True):
    """`audience/lower`, of the same pages: all hands go down."""


ToAudience = RaiseHand | AskQuestion | MarkQuestion | LowerHands

# --- server → page ------------------------------------------------------------------------------


class Hello(Message, frozen=True, kw_only=True):
    """`hello`: first frame of every connection. `peer` is secret to this page, `stamp` the server's
    clock. `live_since` is when the visitor's session at this robot began, as `since` of
    `session/refused`; without `live_elsewhere` no page drives in it, and this one may resume it.
    """

    peer: Id
    stamp: Stamp
    robot: Id
    online: bool
    may_drive: bool
    may_observe: bool
    live_elsewhere: bool = False
    live_since: Stamp | None = None


class GrantedTerms(Message, frozen=True, kw_only=True):
    """The terms of this session (sessions/leases/terms.py), which the visitor cannot change.

    `controllers` are the allowed input methods, `actions` the allowed types of actions, absent:
    all. `assist` is the level of assistance, absent: the visitor's choice. `interface` is the
    profile of the page.
    """

    label: Name = ""
    controllers: tuple[InputMethod, ...] | None = None
    actions: tuple[Name, ...] | None = None
    assist: AssistLevel | None = None
    control_way: Literal["any", "datachannel", "mqtt"] = "any"
    interface: Name = ""


class Granted(Message, frozen=True, kw_only=True):
    """`session/granted`: you drive. `resumed`: with the same epoch, peer and data channel."""

    session: Id
    epoch: Count
    peer: Id
    resumed: bool = False
    turn_seconds: Seconds | None = None
    ice_servers: tuple[IceServer, ...] = ()
    limits: LeaseLimits = LeaseLimits()
    terms: GrantedTerms | None = None


class Observing(Message, frozen=True, kw_only=True):
    """`session/observing`: you watch; `sfu`: through the server's SFU instead of the robot."""

    ice_servers: tuple[IceServer, ...] = ()
    sfu: bool = False


class Refused(Message, frozen=True, kw_only=True):
    """`session/refused`: no. `elsewhere` offers a takeover of the visitor's `session`, which began
    at `since`. `outcome` is that of a session which has `ended`, as in `session/ended`.
    """

    reason: Literal[
        "offline",
        "disabled",
        "not_invited",
        "not_trained",
        "elsewhere",
        "observers_full",
        "private",
        "not_allowed",
        "ended",
        "paused",
        "closed",
        "reserved",
        "full",
    ]
    session: Id | None = None
    outcome: Name = ""
    since: Stamp | None = None


class RoomState(Message, frozen=True, kw_only=True):
    """`room`: who is here. `driver` is the driver's name, None without one; `observers` only watch
    and do not wait. A `private` drive and its driver's name are not shown to this page.

    `pause` is why a robot without a driver is not ready, as the reason of `session/queued`.
    """

    driver: Name | None = None
    driving: bool = False
    observers: Count = 0
    waiting: Count = 0
    pause: Reason = ""
    private: bool = False


class AudienceQuestion(Message, frozen=True, kw_only=True):
    """A question of the audience; `own`: this visitor's. Only moderating pages receive `who`."""

    id: Id
    text: QuestionText
    state: QuestionState
    who: Name = ""
    own: bool = False


class AudienceState(Message, frozen=True, kw_only=True):
    """`audience`: the hands and questions that this page may see, oldest first; not `open` without
    a driver, or in a study.

    `raised`: this visitor's hand is up. Only a page that `moderates` receives the number of
    `hands`, the `names` of the first, and all waiting questions; every page receives those of its
    own visitor, and the one that is being answered.
    """

    open: bool = False
    moderates: bool = False
    raised: bool = False
    hands: Count = 0
    names: Annotated[tuple[Name, ...], Meta(max_length=30)] = ()
    questions: Annotated[tuple[AudienceQuestion, ...], Meta(max_length=100)] = ()


class Screen(Message, frozen=True, kw_only=True):
    """`screen`, for the robot's own display: the robot's title, and `titles` in other languages;
    its session and visitor, None without one, and whether the session is part of a study.
    """

    title: Name
    titles: Annotated[dict[Name, Name], Meta(max_length=50)] = {}
    session: Id | None = None
    visitor: Name | None = None
    waiting: Name | None = None
    study: bool = False
    ice_servers: tuple[IceServer, ...] = ()


class RobotPresence(Message, frozen=True, kw_only=True):
    """`robot`: the robot went online or offline."""

    online: bool
    reason: Reason = ""


class Fault(Message, frozen=True, kw_only=True):
    """A fault of a part of the server, or of the robot, and its effect on driving.

    `then`: `waits` there is no driver, and no visitor gets the robot until the fault is over;
    `stops` the robot brakes in `seconds` unless the fault is over before; `stopped` it has braked,
    and driving continues after the fault; `goes_on` driving is not affected.
    """

    part: Literal["broker", "session_manager", "database", "disk_low", "disk_full", "robot"]
    then: Literal["waits", "stops", "stopped", "goes_on"]
    seconds: Seconds | None = None


class ServerStatus(Message, frozen=True, kw_only=True):
    """`server/status`: all present faults, once a second and whenever they change; empty: none.

    A page that receives nothing at all for a second and a half has lost its web process, or its
    network.
    """

    faults: Annotated[tuple[Fault, ...], Meta(max_length=8)] = ()


class Denied(Message, frozen=True, kw_only=True):
    """`denied`: a frame of this page was refused; not an error of the connection."""

    suffix: Name
    reason: Name


# --- notices: server → the page of a session ------------------------------------------------------


class Notice(Message, frozen=True, kw_only=True):
    """A message to the page of a session that the page did not request.

    Every notice has one name everywhere (`NOTICES`): `session/<name>` is the suffix of its frame,
    which processes pass on unchanged. If it is recorded, `<name>` is the type of the session's
    event, and its other fields are the event's data.
    """

    session: Id


class Queued(Notice, frozen=True, kw_only=True):
    """You wait; `place` 1 is next, `minutes` the estimate.

    `reason` is why a robot without a driver is not ready: `returning`, `charging` or `paused`, a
    colon, and the robot's reason; `held`, a colon, and why sessions are paused; `maintenance` of
    the site; or `start`, a colon, and the code of why it does not meet a study's terms:
    `not_docked`, `elsewhere`, `lost`, `charge`, `silent`.
    """

    place: Count
    minutes: NotNegative
    reason: Reason = ""


class Offered(Notice, frozen=True, kw_only=True):
    """The robot is yours if you send `session/take` within `seconds`."""

    seconds: Seconds


class TurnWarning(Notice, frozen=True, kw_only=True):
    """The turn ends in `remaining` seconds, or no longer has an end if this is None. `reason` is
    empty, or `maintenance` if the site's maintenance ends it.
    """

    remaining: Seconds | None
    reason: Reason = ""


class PresenceAsked(Notice, frozen=True, kw_only=True):
    """Are you still there? Without a sign, the next visitor gets the robot in `seconds`."""

    seconds: Seconds


class PresenceConfirmed(Notice, frozen=True, kw_only=True):
    """Your presence is confirmed."""


class Task(Notice, frozen=True, kw_only=True):
    """The complete state of the task, at every change and whenever a page takes the session.

    `cue` is the instruction to the visitor (experiments.definition.cues.CueKey, or `practice`),
    `number` its checkpoint (0 is the station), at `x`, `y` in metres on the map. `passed` are the
    numbers of passed checkpoints, `doors` the names of doors in the order the robot went through
    them. `remaining` is in seconds at `stamp`, sent in the last minutes only. `photo` is the action
    whose photo is reviewed while `window` is `review`. `outcome` is empty until the task is over.
    """

    stamp: Stamp
    cue: Name = ""
    number: Count | None = None
    x: Metres | None = None
    y: Metres | None = None
    passed: Annotated[tuple[Count, ...], Meta(max_length=100)] = ()
    remaining: Seconds | None = None
    window: Literal["shut", "open", "review"] = "shut"
    photo: Annotated[str, Meta(max_length=64)] = ""
    outcome: Name = ""
    doors: Annotated[tuple[Name, ...], Meta(max_length=1000)] = ()


class OperatorMessage(Notice, frozen=True, kw_only=True):
    """A sentence of the session's operator."""

    text: Reason


class Ended(Notice, frozen=True, kw_only=True):
    """The session is over; `outcome` as in sessions.models, or `moved` to another tab."""

    outcome: Name
    reason: Reason = ""


NOTICES: dict[str, type[Notice]] = {
    "queued": Queued,
    "offered": Offered,
    "turn_warning": TurnWarning,
    "asked_there": PresenceAsked,
    "found_there": PresenceConfirmed,
    "task": Task,
    "operator_message": OperatorMessage,
    "ended": Ended,
}
NOTICE_NAMES = {kind: name for name, kind in NOTICES.items()}
_NOTICE = "session/"


def notice_frame(notice: Notice) -> str:
    """Return the frame of a notice."""
    return encode_frame(_NOTICE + NOTICE_NAMES[type(notice)], notice)


def decode_notice(frame: str) -> Notice:
    """Return the notice of a frame.

    Raises:
        Rejection: it is none, or malformed.
    """
    suffix, _, payload = frame.partition("\n")
    notice: Notice = decode(suffix, payload, _NOTICE_DECODERS)
    return notice


def task_of(session: str, shown: dict[str, Any], stamp: float) -> Task | None:
    """Return the stored state of a task (Drive.shown) as a notice; None when it is malformed."""
    try:
        return msgspec.convert({**shown, "session": session, "stamp": stamp}, Task)
    except msgspec.ValidationError as error:
        log.error("task_malformed", session=session, reason=str(error))
        return None


# --- between servers ------------------------------------------------------------------------------


class PageReport(Message, frozen=True, kw_only=True):
    """`telepresence/v1/server/page/<session>`: a page's report for the record, from a web process
    to the session manager. `message` is the JSON of a PageEvent or a PageNetwork, which the web
    process has checked.
    """

    suffix: Literal["page/event", "page/network"]
    session: Id
    message: msgspec.Raw


def page_reports(session: str) -> str:
    """Return the topic of a session's page reports; for `+`, the filter of all."""
    return f"{SERVER}/page/{session}"


TO_SERVER: dict[str, type] = {
    "session/take": Take,
    "session/observe": Observe,
    "session/leave": Leave,
    "session/assist": Assist,
    "page/event": PageEvent,
    "page/network": PageNetwork,
    "page/direct": Direct,
    "audience/hand": RaiseHand,
    "audience/ask": AskQuestion,
    "audience/mark": MarkQuestion,
    "audience/lower": LowerHands,
}
# page → server: Offer, Candidate, Bye; server → page: `signal/reply` with Answer, Candidate, Bye.
# With the SFU, the server offers, at the page's request.
SIGNAL = "signal"
TO_PAGE: dict[str, Any] = {
    "hello": Hello,
    "session/granted": Granted,
    "session/observing": Observing,
    "session/refused": Refused,
    "room": RoomState,
    "audience": AudienceState,
    "robot": RobotPresence,
    "screen": Screen,
    "denied": Denied,
    "server/status": ServerStatus,
    "signal/reply": SdpAnswer | Candidate | Bye | SdpOffer,
    **{f"{_NOTICE}{name}": kind for name, kind in NOTICES.items()},
}
Decoders = dict[str, msgspec.json.Decoder[Any]]


def decoders_of(kinds: dict[str, Any]) -> Decoders:
    """Return the decoders of message types, by suffix."""
    return {suffix: msgspec.json.Decoder(kind) for suffix, kind in kinds.items()}


_DECODERS = decoders_of({**TO_SERVER, SIGNAL: SdpOffer | Candidate | Bye | WantOffer | SdpAnswer})
_NOTICE_DECODERS = decoders_of({f"{_NOTICE}{name}": kind for name, kind in NOTICES.items()})


def decode(suffix: str, payload: str, decoders: Decoders = _DECODERS) -> Any:
    """Return the message of a frame, by default a page's.

    Raises:
        Rejection: unknown suffix or malformed; Robot API suffixes go to robots.api.codec instead.
    """
    decoder = decoders.get(suffix)
    if decoder is None:
        raise Rejection("unknown_topic", suffix[:80])
    try:
        return decoder.decode(payload)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Rejection("malformed", f"{suffix}: {error}") from error
