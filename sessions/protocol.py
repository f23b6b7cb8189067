"""What a page and the server say to each other on the WebSocket, beside Robot API v1.

A frame is a suffix, a newline, and a JSON object in camelCase, as on the data channel. Suffixes of
the Robot API mean the same here as on MQTT: the page sends `command/velocity`, `command/heartbeat`,
`command/action`, `command/picture`, `command/point`; the server relays `state`, `pose`, `path`,
`scan`, `event`, `action`, `heartbeat`, and to whom they concern `words` and `pointer`. This file
has the rest. The page's own idea of role, session, epoch or peer is never used: the server stamps
what the lease says.
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
# bytes of JSON: what a page says for the record is kept for long, and the longest that ours says
# has some 300
MAX_REPORT = 1024

# Why the server closes a WebSocket, as the page's CloseEvent.code tells it.
SIGNED_OUT, NOT_ALLOWED, NO_SUCH_ROBOT, FLOODED, TOO_SLOW, REPLACED = (
    4401,
    4403,
    4404,
    4008,
    4009,
    4010,
)

# --- page → server ------------------------------------------------------------------------------


class Take(Message, frozen=True, kw_only=True):
    """`session/take`: I want to drive.

    `session` and `peer` come back from an earlier `session/granted` of this same page when its
    WebSocket was lost: same page, same peer, same epoch, the drive goes on. `takeover` moves a
    session of the same visitor from another tab to this page.
    """

    session: Id | None = None
    peer: Id | None = None
    takeover: bool = False


class Observe(Message, frozen=True, kw_only=True):
    """`session/observe`: I want to watch."""


class Leave(Message, frozen=True, kw_only=True):
    """`session/leave`: I am done (or leave the queue).

    `session` and `peer` name the visit that was left while this page had no connection; without
    them it is the visit of this page.
    """

    session: Id | None = None
    peer: Id | None = None


class Assist(Message, frozen=True, kw_only=True):
    """`session/assist`: how much the robot shall help me drive. The lease carries it to the robot,
    whose states say what is in force.
    """

    level: AssistLevel


Detail = Annotated[str, Meta(max_length=200)]


class PageEvent(Message, frozen=True, kw_only=True):
    """`page/event`: something on the page that belongs into the record, such as a controller chosen
    or a tab hidden.
    """

    stamp: Stamp
    type: Id
    data: Annotated[dict[Name, Detail | float | bool | None], Meta(max_length=16)] = {}


# the type of a page event that is a sign of the visitor, who types, presses or looks around without
# driving
HERE = "here"


class PageNetwork(Message, frozen=True, kw_only=True):
    """`page/network`: one second of the connection as the browser measured it; times in s, rates in
    bit/s.
    """

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
    """`page/direct`: whether what the robot says comes over the data channel as well, so that the
    server can leave most of it out.
    """

    direct: bool


QuestionText = Annotated[str, Meta(min_length=1, max_length=280)]
QuestionState = Literal["waiting", "answering", "answered", "declined"]


class RaiseHand(Message, frozen=True, kw_only=True):
    """`audience/hand`, of a page that watches: my hand goes up, or down."""

    raised: bool


class AskQuestion(Message, frozen=True, kw_only=True):
    """`audience/ask`, of a page that watches: a question to whoever drives."""

    text: QuestionText


class MarkQuestion(Message, frozen=True, kw_only=True):
    """`audience/mark`, of the page that drives, or watches for somebody who operates the robot:
    what becomes of a question.
    """

    question: Id
    state: Literal["answering", "answered", "declined"]


class LowerHands(Message, frozen=True, kw_only=True):
    """`audience/lower`, of the same: all hands go down."""


ToAudience = RaiseHand | AskQuestion | MarkQuestion | LowerHands

# --- server → page ------------------------------------------------------------------------------


class Hello(Message, frozen=True, kw_only=True):
    """`hello`: first frame of every connection. `peer` is secret to this page; `stamp` the server's
    clock. `live_since`: since when the visitor drives this robot, as `since` of `session/refused`;
    without `live_elsewhere` no page drives it just now, and this one may go on.
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
    """What somebody has fixed for this visit (sessions/leases/terms.py), which the visitor cannot
    change.

    `controllers` are the input methods and `actions` the types of actions that are allowed, absent:
    all. `assist` is the level of assistance, absent: the visitor's choice. `interface` names what
    the page shows and leaves out.
    """

    label: Name = ""
    controllers: tuple[InputMethod, ...] | None = None
    actions: tuple[Name, ...] | None = None
    assist: AssistLevel | None = None
    control_way: Literal["any", "datachannel", "mqtt"] = "any"
    interface: Name = ""


class Granted(Message, frozen=True, kw_only=True):
    """`session/granted`: you drive. `resumed` when epoch and peer are those of before, so that a
    living data channel stays bound.
    """

    session: Id
    epoch: Count
    peer: Id
    resumed: bool = False
    turn_seconds: Seconds | None = None
    ice_servers: tuple[IceServer, ...] = ()
    limits: LeaseLimits = LeaseLimits()
    terms: GrantedTerms | None = None


class Observing(Message, frozen=True, kw_only=True):
    """`session/observing`: you watch; `sfu`: not the robot itself, but through the server's SFU."""

    ice_servers: tuple[IceServer, ...] = ()
    sfu: bool = False


class Refused(Message, frozen=True, kw_only=True):
    """`session/refused`: no. `reason` is one of the words below; `elsewhere` offers a takeover.

    `outcome` is how a session of this visitor's that has `ended` did, as in `session/ended`;
    `since` when the one that is driven `elsewhere` began.
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
    """`room`: who is here. `driver` is the name, None when nobody drives; `observers` are
    those who only watch, and not those who watch while they wait. A `private` drive is not shown to
    this page, nor its driver's name.

    `pause` says why a robot that nobody drives is not ready, as the reason of `session/queued`.
    """

    driver: Name | None = None
    driving: bool = False
    observers: Count = 0
    waiting: Count = 0
    pause: Reason = ""
    private: bool = False


class AudienceQuestion(Message, frozen=True, kw_only=True):
    """A question of the audience. Only who moderates is told `who` asked; `own`: this visitor."""

    id: Id
    text: QuestionText
    state: QuestionState
    who: Name = ""
    own: bool = False


class AudienceState(Message, frozen=True, kw_only=True):
    """`audience`: what this page may see of hands and questions, oldest first; not `open` while
    nobody drives, or for a study.

    `raised`: this visitor's hand is up. Only a page that `moderates` is told how many `hands` are
    up, the `names` of the first, and of questions all that wait; every page those of its own
    visitor, and what is being answered.
    """

    open: bool = False
    moderates: bool = False
    raised: bool = False
    hands: Count = 0
    names: Annotated[tuple[Name, ...], Meta(max_length=30)] = ()
    questions: Annotated[tuple[AudienceQuestion, ...], Meta(max_length=100)] = ()


class Screen(Message, frozen=True, kw_only=True):
    """`screen`, for the robot's own display: what the robot is called, `titles` by language where
    it has others, who visits it, None when nobody does, and whether in a study.
    """

    title: Name
    titles: Annotated[dict[Name, Name], Meta(max_length=50)] = {}
    session: Id | None = None
    visitor: Name | None = None
    waiting: Name | None = None
    study: bool = False
    ice_servers: tuple[IceServer, ...] = ()


class RobotPresence(Message, frozen=True, kw_only=True):
    """`robot`: the robot came or went."""

    online: bool
    reason: Reason = ""


class Fault(Message, frozen=True, kw_only=True):
    """A part of the server, or the robot, that does not do its work, and what that means for who
    drives.

    `then`: `waits` nobody drives, and nobody gets the robot meanwhile; `stops` the robot brakes in
    `seconds` unless the part is back before; `stopped` it has, and driving goes on when the part is
    back; `goes_on` driving is not touched.
    """

    part: Literal["broker", "session_manager", "database", "disk_low", "disk_full", "robot"]
    then: Literal["waits", "stops", "stopped", "goes_on"]
    seconds: Seconds | None = None


class ServerStatus(Message, frozen=True, kw_only=True):
    """`server/status`: what fails now, all of it, once a second and whenever that changes; empty:
    all is well.

    A page that hears nothing at all for a second and a half has lost its web process, or its
    network.
    """

    faults: Annotated[tuple[Fault, ...], Meta(max_length=8)] = ()


class Denied(Message, frozen=True, kw_only=True):
    """`denied`: a frame of this page was refused, and why; not an error of the connection."""

    suffix: Name
    reason: Name


# --- notices: server → the page of a session ------------------------------------------------------


class Notice(Message, frozen=True, kw_only=True):
    """What the page of a session is told without having asked for it.

    Every notice has one name on its whole way (`NOTICES`): `session/<name>` is the suffix of its
    frame, which processes hand on as it is, and where it belongs into the record, `<name>` is the
    type of the session's event there and its other fields are the event's data.
    """

    session: Id


class Queued(Notice, frozen=True, kw_only=True):
    """You wait; `place` 1 is next, `minutes` the estimate.

    `reason` says why a robot that nobody drives is not ready: `returning`, `charging` or `paused`,
    a colon, and what the robot says; `held`, a colon, and why somebody has paused visits; or
    `start`, a colon, and in one word why it is not as a study wants it: `not_docked`, `elsewhere`,
    `lost`, `charge`, `silent`.
    """

    place: Count
    minutes: NotNegative
    reason: Reason = ""


class Offered(Notice, frozen=True, kw_only=True):
    """The robot is yours if you send `session/take` within `seconds`."""

    seconds: Seconds


class TurnWarning(Notice, frozen=True, kw_only=True):
    """The turn ends in `remaining` seconds."""

    remaining: Seconds


class AskedThere(Notice, frozen=True, kw_only=True):
    """Are you still there? Without a sign the robot goes on to the next visitor in `seconds`."""

    seconds: Seconds


class FoundThere(Notice, frozen=True, kw_only=True):
    """You have given a sign: all is well."""


class Task(Notice, frozen=True, kw_only=True):
    """How far the task is; all of it, each time that anything changes and whenever
    a page takes the session.

    `cue` is what the visitor is told (experiments.definition.cues.CueKey, or `practice`), `number`
    the checkpoint that it speaks of (0 is the station), at `x`, `y` in metres on the map. `passed`
    are the numbers of checkpoints behind the robot, `doors` the names of doors in the order they
    were gone through. `remaining` is in seconds at `stamp`, said in the last minutes alone. `photo`
    is the action whose picture waits for an answer while `window` is `review`. `outcome` is empty
    until the task is over.
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
    """A sentence of whoever looks after the session."""

    text: Reason


class Ended(Notice, frozen=True, kw_only=True):
    """The session is over, with one of sessions.models.Session.Outcome, or `moved` to another
    tab.
    """

    outcome: Name
    reason: Reason = ""


NOTICES: dict[str, type[Notice]] = {
    "queued": Queued,
    "offered": Offered,
    "turn_warning": TurnWarning,
    "asked_there": AskedThere,
    "found_there": FoundThere,
    "task": Task,
    "operator_message": OperatorMessage,
    "ended": Ended,
}
NOTICE_NAMES = {kind: name for name, kind in NOTICES.items()}
_NOTICE = "session/"


def notice_frame(notice: Notice) -> str:
    """Return a notice as the page gets it."""
    return encode_frame(_NOTICE + NOTICE_NAMES[type(notice)], notice)


def decode_notice(frame: str) -> Notice:
    """Return the notice of a frame.

    Raises:
        Rejection: it is none, or malformed.
    """
    suffix, _, payload = frame.partition("\n")
    kind = NOTICES.get(suffix.removeprefix(_NOTICE)) if suffix.startswith(_NOTICE) else None
    if kind is None:
        raise Rejection("unknown_topic", suffix[:80])
    try:
        return msgspec.json.decode(payload, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Rejection("malformed", f"{suffix}: {error}") from error


def task_of(session: str, shown: dict[str, Any], stamp: float) -> Task | None:
    """Return what is stored of a task (Drive.shown) as a notice; None when it is none."""
    try:
        return msgspec.convert({**shown, "session": session, "stamp": stamp}, Task)
    except msgspec.ValidationError as error:
        log.error("task_malformed", session=session, reason=str(error))
        return None


# --- between servers ------------------------------------------------------------------------------


class PageReport(Message, frozen=True, kw_only=True):
    """`telepresence/v1/server/page/<session>`: what a page said for the record, on its way from a
    web process to the session manager.

    `message` is the JSON of a PageEvent or a PageNetwork, checked by the web process.
    """

    suffix: Literal["page/event", "page/network"]
    session: Id
    message: msgspec.Raw


def page_reports(session: str) -> str:
    """Return the topic of one session's page reports; `+` makes the filter of all."""
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
# With the SFU the server offers, when the page wants it.
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
_DECODERS: dict[str, msgspec.json.Decoder[Any]] = {
    suffix: msgspec.json.Decoder(kind) for suffix, kind in TO_SERVER.items()
}
_DECODERS[SIGNAL] = msgspec.json.Decoder(SdpOffer | Candidate | Bye | WantOffer | SdpAnswer)
__all__ = [
    "MAX_FRAME",
    "PATH",
    "SIGNAL",
    "TO_PAGE",
    "TO_SERVER",
    "decode",
    "encode_frame",
    "page_reports",
]


def decode(suffix: str, payload: str) -> Any:
    """Return the message of a page's frame.

    Raises:
        Rejection: unknown suffix or malformed; Robot API suffixes go to robots.api.codec instead.
    """
    decoder = _DECODERS.get(suffix)
    if decoder is None:
        raise Rejection("unknown_topic", suffix[:80])
    try:
        return decoder.decode(payload)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Rejection("malformed", f"{suffix}: {error}") from error
