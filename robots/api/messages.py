"""Every message of Robot API v1: one frozen class a message.

SI units and radians throughout; x forward, y left, theta counter-clockwise; names follow VDA 5050
where it has one. On the wire a message is a JSON object in camelCase. `stamp` is Unix time in
seconds by the sender's clock, `boot` the id of one run of the agent, and `seq` counts within a boot
(states) or within an epoch (commands). Unknown fields are ignored, so that a newer peer can say
more; a field out of its range makes the whole message `malformed`.

Longer than most files here, because a reader who writes an agent wants all of the words on one
page.
"""

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

VERSION = 1

# Ranges are wide enough for any robot and narrow enough that arithmetic on them cannot overflow or
# lose a millisecond.
Metres = Annotated[float, Meta(ge=-1e5, le=1e5)]
Radians = Annotated[float, Meta(ge=-7.0, le=7.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=1e6)]
Stamp = Annotated[float, Meta(ge=0.0, le=1e11, description="Unix time in seconds, sender's clock")]
LinearSpeed = Annotated[float, Meta(ge=-10.0, le=10.0, description="m/s, forward positive")]
AngularSpeed = Annotated[
    float, Meta(ge=-20.0, le=20.0, description="rad/s, counter-clockwise positive")
]
Positive = Annotated[float, Meta(gt=0.0, le=1e3)]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e6)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
BitRate = Annotated[float, Meta(ge=1e3, le=1e11, description="bit/s")]
Count = Annotated[
    int,
    Meta(ge=0, le=2**53 - 1, description="at most 2^53 - 1, so that JavaScript counts it exactly"),
]
Id = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
Name = Annotated[str, Meta(max_length=120)]
Reason = Annotated[str, Meta(max_length=300)]
Point = tuple[Metres, Metres]
# of a picture: of its width from the left, and of its height from the top
Spot = tuple[Share, Share]
Variance = Annotated[float, Meta(ge=-1e10, le=1e10)]

Role = Literal["driver", "observer", "screen", "wizard"]
InputMethod = Literal["keyboard", "mouse", "touch", "stick", "gamepad", "map", "script"]
Way = Literal["datachannel", "mqtt"]
Mode = Literal["manual", "assisted", "goto", "docking", "stopped"]
AssistLevel = Literal["off", "slow", "steer"]
Capability = Literal[
    "velocity",
    "goto",
    "follow",
    "dock",
    "undock",
    "tilt",
    "relocalize",
    "localization",
    "scan",
    "assist",
    "photo",
    "say",
    "call",
    "point",
    "audio",
    "video",
    "doors",
    "network_lab",
    "safety_test",
]
WordsState = Literal["shown", "spoken", "not_spoken"]
ActionState = Literal["WAITING", "RUNNING", "FINISHED", "FAILED", "CANCELLED"]
ENDED: frozenset[ActionState] = frozenset({"FINISHED", "FAILED", "CANCELLED"})


class Message(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """Base of everything on the wire."""


# --- parts ----------------------------------------------------------------------------------------


class Pose(Message, frozen=True, kw_only=True):
    """Where the robot is, in the frame of its map.

    `covariance` is the upper triangle of the 3 x 3 matrix over (x, y, theta), row by row: xx, xy,
    xθ, yy, yθ, θθ. `score` says how far to trust the pose: 1 is certain, below 0.5 the robot counts
    as lost (`localized` false).
    """

    x: Metres
    y: Metres
    theta: Radians
    covariance: tuple[Variance, Variance, Variance, Variance, Variance, Variance] | None = None
    localized: bool = True
    score: Share = 1.0


class Velocity(Message, frozen=True, kw_only=True):
    """A planar velocity of a differential drive."""

    linear: LinearSpeed
    angular: AngularSpeed


class Battery(Message, frozen=True, kw_only=True):
    """`charge` runs from 0 to 1, `voltage` is in volts; each is absent when the robot does not know
    it.

    `charging` is absent when it does not charge, and `null` when the robot does not know.
    """

    charge: Share | None = None
    voltage: NotNegative | None = None
    charging: bool | None = False


class Safety(Message, frozen=True, kw_only=True):
    """What keeps the robot from moving.

    `inhibited` names the reason in one word when commands are refused for a state of the robot:
    `estop`, `stopped`, `no_lease`, `settling` (it has to come to rest first), `unconfirmed` (its
    own navigation has not confirmed that it ended), `collision` (it can only be driven away from
    what it has touched), `fault`. `stop_seq` and `stop_id` echo the newest stop, so that its sender
    can stop repeating it. `touched` are the sides on which the robot has touched something and has
    not yet backed away. `button` states whether the robot's own emergency
    button is pressed, absent when the robot has not reported it.
    """

    estop: bool = False
    estop_source: Name | None = None
    collision: bool = False
    inhibited: Name | None = None
    stop_seq: Count | None = None
    stop_id: Id | None = None
    touched: Annotated[
        tuple[Literal["ahead", "left", "behind", "right"], ...], Meta(max_length=4)
    ] = ()
    button: bool | None = None


class AppliedCommand(Message, frozen=True, kw_only=True):
    """One velocity command that reached the wheels: its number, input method, control channel, age,
    and the velocity that was applied.

    `frame_age` is the age by then of the video frame that the visitor saw, in seconds by the
    robot's own clock: the whole loop, from the camera through the visitor's eyes and hand to the
    wheels. Absent when the command named no frame.

    `asked` is what the driver asked for, `allowed` what the limits and the age allowed: `share` of
    the maximum speeds, 1 if command and frame are recent enough. `linear` and `angular` are what
    was then applied, after collision monitor and ramp. Agents may leave out all three.
    """

    seq: Count
    stamp: Stamp
    method: InputMethod
    way: Way
    age: Annotated[
        float,
        Meta(
            ge=-10.0,
            le=1e4,
            description="s, from the visitor's hand to the adapter, by the estimated clock offset",
        ),
    ]
    linear: LinearSpeed
    angular: AngularSpeed
    frame_age: Annotated[float, Meta(ge=-10.0, le=10.0)] | None = None
    asked: Velocity | None = None
    allowed: Velocity | None = None
    share: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None


class Limits(Message, frozen=True, kw_only=True):
    """The limits that the robot's own kernel enforces. They are published, not negotiated.

    Speeds in m/s and rad/s, accelerations and braking in m/s² and rad/s², times in s. `command_age`
    and `frame_age` are the defaults, the `_ceiling`s what no lease can exceed. `deadman` is the
    silence after which the robot brakes.
    """

    linear: Positive
    reverse: Positive
    angular: Positive
    linear_acceleration: Positive
    angular_acceleration: Positive
    linear_braking: Positive
    angular_braking: Positive
    command_age: Positive = 0.25
    command_age_ceiling: Positive = 1.0
    frame_age: Positive = 1.0
    frame_age_ceiling: Positive = 3.0
    deadman: Positive = 0.3


class Camera(Message, frozen=True, kw_only=True):
    """The driving camera: pinhole, square pixels, centred principal point.

    `hfov` is the horizontal field of view, `x` the distance of the camera ahead of the robot's
    centre, `z` its height above the floor, `pitch` its angle below the horizon when the tilt is 0
    (positive looks down, as a rotation about +y does).
    """

    width: Annotated[int, Meta(ge=16, le=7680)]
    height: Annotated[int, Meta(ge=16, le=4320)]
    fps: Positive
    hfov: Annotated[float, Meta(gt=0.1, lt=3.1)]
    x: Metres
    z: Metres
    pitch: Radians = 0.0


class Laser(Message, frozen=True, kw_only=True):
    """Where the planar laser sits in the robot's frame: the ranges of `scan` are seen from there,
    `theta` is where its angle 0 looks.
    """

    x: Metres
    y: Metres = 0.0
    theta: Radians = 0.0


class TiltRange(Message, frozen=True, kw_only=True):
    """Head tilt: 0 is level, positive looks down; `speed` in rad/s."""

    minimum: Radians
    maximum: Radians
    home: Radians = 0.0
    speed: Positive = 1.0


class CallState(Message, frozen=True, kw_only=True):
    """The status of a visitor's call at the robot: `audio` and `video` are what the visitor sends,
    `volume` what they requested.

    `shares`: the video shows the visitor's screen, a window or a tab, not their face. `shown` and
    `audible`: a display of the robot confirms that it shows the video, or that it may play sound
    (`command/heartbeat`), or no display is connected and the robot has its own display or
    loudspeaker. An agent that omits them cannot tell.
    """

    status: Literal["ringing", "accepted", "declined", "unanswered"]
    audio: bool = False
    video: bool = False
    volume: Share = 1.0
    shares: bool = False
    shown: bool | None = None
    audible: bool | None = None


class KnockState(Message, frozen=True, kw_only=True):
    """A knock of the driver; `action_id` is that of the `knock`. While it is `ringing`, the robot's
    displays ring and show who knocks; if none is connected, the robot's own loudspeaker rings.
    """

    action_id: Id
    status: Literal["ringing", "answered", "declined", "unanswered"]


class CameraStatus(Message, frozen=True, kw_only=True):
    """A camera that gives no video: it is `starting`, which takes seconds, or has `failed`.
    `reason` is why it failed, now or the last time.
    """

    status: Literal["starting", "failed"]
    reason: Reason = ""


class NetworkLab(Message, frozen=True, kw_only=True):
    """Impairments that a study puts on one direction; times in s, loss and reordering as shares,
    rate in bit/s.

    `jitter` changes the delay by up to this value, in either direction. The same seed and the same
    packets at the same moments give the same losses.
    """

    delay: NotNegative = 0.0
    jitter: NotNegative = 0.0
    loss: Share = 0.0
    reorder: Share = 0.0
    bitrate: BitRate | None = None
    seed: Count = 0


class LabReport(Message, frozen=True, kw_only=True):
    """The impairment that was really applied to one direction of the driver's network, and what has
    happened to its packets since then.

    `lost` by chance, `overflowed` because the queue before the bit rate was full, `reordered`
    overtaken by the next one; `waiting` are on their way now. `held` is the mean time in seconds
    for which a packet was held.
    """

    lab: NetworkLab
    taken: Count = 0
    lost: Count = 0
    overflowed: Count = 0
    reordered: Count = 0
    waiting: Count = 0
    held: Seconds = 0.0


# --- robot → server and page --------------------------------------------------------------------


class Connection(Message, frozen=True, kw_only=True):
    """`connection`: retained, and the agent's last will (CONNECTIONBROKEN). Ignore a message whose
    boot is not that of the last ONLINE.
    """

    boot: Id
    state: Literal["ONLINE", "OFFLINE", "CONNECTIONBROKEN"]
    stamp: Stamp
    reason: Reason = ""


class Factsheet(Message, frozen=True, kw_only=True):
    """`factsheet`: retained; what this robot is and can do. `watchdog` is what stops its base when
    the agent is dead. `navigation_control` states what stops the robot's own navigation then:
    `agent` (its velocities pass through the agent), `guarded` (a process on its side) or
    `unguarded` (nothing); empty when the robot does not move by itself. A robot with
    `previews_routes` answers `command/route`. `adapter` names the agent's
    adapter to the RCA, and `driver` the software of the base, both with their versions; empty when
    unknown.
    """

    name: Id
    series: Name
    rca: Name
    agent_version: Name
    boot: Id
    capabilities: tuple[Capability, ...]
    limits: Limits
    footprint: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=64)]
    camera: Camera | None = None
    tilt: TiltRange | None = None
    laser: Laser | None = None
    map_id: Name = ""
    watchdog: Positive
    viewers: Annotated[int, Meta(ge=0, le=64)] = 8
    previews_routes: bool = False
    navigation_control: Name = ""
    adapter: Name = ""
    driver: Name = ""


class State(Message, frozen=True, kw_only=True):
    """`state`: four times a second and on every change that matters; the record of the session is
    made of these.

    `clearance` is the smallest distance in metres from the footprint to anything since the last
    state, `contacts` how many collisions began, `distance` the metres driven by odometry since the
    boot, or with `distance_by_position` the sum of the steps between positions, of a robot that has
    no odometry. `visitor_silence` is the time in seconds since the last heartbeat of the lease's
    `peer` on either transport. `refused` counts refusals by reason since the last state. While the
    assistance changes what the driver requests, `assist_why` gives the reason in one word, and
    `assist_point` the obstacle, in metres in the robot's frame. `call` is the status of the
    visitor's sound and video at the robot, absent when the visitor sends neither; `screens` is the
    number of pages that show them. `knockable`: a `knock` can ring now, at a display or at the
    robot's own loudspeaker; `knock` is the newest one of this session, for a minute.
    `control_network` and `video_network` are present while the robot impairs the driver's network,
    as `config` requests. `camera_status` is present while the camera is needed but delivers no
    video, or delivered none when it was last needed; `errors` has the reason, too.

    `charger_contact` states whether the charging contacts meet now, or the robot charges. `docked`
    requires more: they have met for 2 s while the robot was at a standstill (at most 0.03 m/s and
    0.06 rad/s) and was sent no velocity, and have not been apart for 0.5 s since. If an agent does
    not send `charger_contact`, its `docked` has the meaning that its robot gives it.
    """

    stamp: Stamp
    boot: Id
    seq: Count
    session: Id | None = None
    epoch: Count = 0
    pose: Pose
    velocity: Velocity
    battery: Battery
    docked: bool = False
    charger_contact: bool | None = None
    tilt: Radians | None = None
    mode: Mode = "manual"
    assist: AssistLevel = "off"
    safety: Safety = Safety()
    errors: Annotated[tuple[Reason, ...], Meta(max_length=16)] = ()
    clearance: NotNegative | None = None
    contacts: Count = 0
    distance: NotNegative = 0.0
    visitor_silence: Seconds | None = None
    viewers: Count = 0
    applied: Annotated[tuple[AppliedCommand, ...], Meta(max_length=64)] = ()
    refused: Annotated[dict[Name, Count], Meta(max_length=64)] = {}
    assist_why: Name = ""
    assist_point: Point | None = None
    call: CallState | None = None
    screens: Count = 0
    knockable: bool = False
    knock: KnockState | None = None
    control_network: LabReport | None = None
    video_network: LabReport | None = None
    camera_status: CameraStatus | None = None
    distance_by_position: bool = False


class PoseUpdate(Message, frozen=True, kw_only=True):
    """`pose`: the small, fast one for the page; `assist_why` and `assist_point` as in `state`."""

    stamp: Stamp
    pose: Pose
    velocity: Velocity
    tilt: Radians | None = None
    assist_why: Name = ""
    assist_point: Point | None = None


class Scan(Message, frozen=True, kw_only=True):
    """`scan`: ranges in metres from `angle_min` on, counter-clockwise, `null` where nothing came
    back.
    """

    stamp: Stamp
    angle_min: Radians
    angle_increment: Radians
    range_max: Positive
    ranges: Annotated[tuple[NotNegative | None, ...], Meta(max_length=2000)]


class Path(Message, frozen=True, kw_only=True):
    """`path`: what the robot will follow by itself, in map metres; empty when it
    follows nothing.
    """

    stamp: Stamp
    points: Annotated[tuple[Point, ...], Meta(max_length=2000)]


class Event(Message, frozen=True, kw_only=True):
    """`event`: something that happened once. `seq` is that of the next state, so that events and
    states share one order.
    """

    stamp: Stamp
    boot: Id
    seq: Count
    session: Id | None = None
    epoch: Count = 0
    type: Literal[
        "docked",
        "undocked",
        "charging",
        "goal_reached",
        "goal_blocked",
        "collision",
        "estop",
        "estop_cleared",
        "stopped",
        "released",
        "photo",
        "session_closed",
        "lease_taken",
        "lease_expired",
        "adapter_lost",
        "adapter_back",
        "localization_lost",
        "localization_found",
        "door_changed",
    ]
    action_id: Id | None = None
    sha256: Annotated[str, Meta(max_length=64)] | None = None
    last_seq: Count | None = None
    detail: Reason = ""


class ActionStatus(Message, frozen=True, kw_only=True):
    """`action`: the progress of an action. `reason` (see Reasons) is why it FAILED, was CANCELLED,
    or does not get on while it runs.

    An action that moves the robot begins when the robot is measured to be at a standstill, and it
    ends, as does its `cancel`, when the robot is at a standstill again.
    """

    action_id: Id
    status: ActionState
    stamp: Stamp
    type: Name = ""
    reason: Reason = ""
    result: Annotated[dict[Name, float | str | bool | None], Meta(max_length=16)] = {}


class Words(Message, frozen=True, kw_only=True):
    """`words`: a message from the driver to the people at the robot, or from them to the driver;
    with `aloud`, it is to be spoken. It is not recorded.

    `receipts`: the robot accepts `confirm_words` for these words, and passes it on as `receipt`.
    `who` is empty for what a hidden operator has the robot say.
    """

    stamp: Stamp
    action_id: Id
    session: Id
    by: Literal["driver", "screen"]
    who: Name = ""
    text: Annotated[str, Meta(min_length=1, max_length=500)]
    language: Annotated[str, Meta(max_length=16)] = ""
    aloud: bool = False
    receipts: bool = False


class Receipt(Message, frozen=True, kw_only=True):
    """`receipt`: what happened to the driver's words at the robot, for the driver: `action_id` is
    that of the `say`.

    `shown`: they were visible on a display of the robot. `spoken`: they were read aloud to the end.
    `not_spoken`: they were shown and should have been read aloud, but this was not possible. If one
    display has spoken them, a later report of another does not change this. Receipts are not
    recorded. A `say` that is sent again with the same id is also answered with the newest receipt.
    """

    stamp: Stamp
    action_id: Id
    session: Id
    state: WordsState


class Pointer(Message, frozen=True, kw_only=True):
    """`pointer`: where one side points on the screen that the driver shares, for the other side;
    without `at`, it points no longer.

    `at` is in shares of the screen's width from its left and of its height from its top, however
    large it is shown. A message out of order is dropped, and the dot disappears after two seconds
    without another message. On the data channel it goes to the other side alone: the driver's
    pointer to the robot's own displays, the pointer at a display to the driver. It is not recorded.
    """

    stamp: Stamp
    by: Literal["driver", "screen"]
    at: Spot | None = None


class RoutePreview(Message, frozen=True, kw_only=True):
    """`route`: the answer to `command/route`: where a `goto` to that point would lead now, in map
    metres from the robot on; empty when there is no route.

    `reason` (see Reasons) is why there is none, or why it ends beside the point: at the nearest
    place that the robot can reach, at most a metre away. It is not recorded.
    """

    stamp: Stamp
    request_id: Id
    points: Annotated[tuple[Point, ...], Meta(max_length=500)]
    reason: Reason = ""


class Echo(Message, frozen=True, kw_only=True):
    """The last heartbeat from a peer: its own n and stamp, and its time of arrival by the clock of
    the echoing side.
    """

    peer: Id
    n: Count
    stamp: Stamp
    received: Stamp


class Heartbeat(Message, frozen=True, kw_only=True):
    """`heartbeat`: five times a second from the robot on every transport, with an echo of the last
    heartbeat of each peer.
    """

    n: Count
    stamp: Stamp
    echoes: Annotated[tuple[Echo, ...], Meta(max_length=16)] = ()


class MediaClock(Message, frozen=True, kw_only=True):
    """`media` (data channel only): converts an RTP timestamp of the video into the robot's time of
    capture.

    capture stamp = `stamp` + ((rtp - `rtp`) modulo 2^32, as a signed difference) / `rate`.
    """

    rtp: Annotated[int, Meta(ge=0, le=2**32 - 1)]
    stamp: Stamp
    rate: Annotated[int, Meta(ge=1, le=10**6)] = 90000


# --- server → robot (and page → robot on the data channel) ------------------------------------


class LeaseLimits(Message, frozen=True, kw_only=True):
    """What a lease allows, below what the robot allows itself; absent means the
    robot's own limit.
    """

    linear: Positive | None = None
    angular: Positive | None = None
    command_age: Positive | None = None
    frame_age: Positive | None = None


class Lease(Message, frozen=True, kw_only=True):
    """`lease`: retained; who drives. Valid for `ttl` seconds from its receipt, renewed with a
    growing `renewal`.

    A copy that the broker delivers from its store (retain = 1) announces the epoch and never
    permits driving. `methods`, `ways` and `actions` are the only input methods, control channels
    and types of actions that the driver may use (otherwise: `not_allowed`); absent means all.
    `stop`, `estop` and `cancel` are always allowed. Lower limits apply at once, even if the lease
    was not renewed. In `who` of all messages, a visitor without a chosen name is `(visitor)` or
    `(participant)`: translate it into the language of each reader.

    A lease of `kind` `wizard` belongs to a session whose visitor does not drive: only the page
    `wizard` does, with `wizard_epoch` in its commands, and no page while `wizard` is absent. The
    visitor's page, `peer`, sends photos, texts, calls and knocks with the role `visitor`.

    `private`: the server shows this drive only to the visitor, the operators of the robot, and the
    people whom the terms of the session name. A robot can ignore it.
    """

    session: Id
    epoch: Count
    peer: Id
    who: Name
    renewal: Count
    stamp: Stamp
    ttl: Annotated[float, Meta(gt=0.0, le=60.0)] = 10.0
    limits: LeaseLimits = LeaseLimits()
    video: Literal["required", "none"] = "required"
    assist: AssistLevel | None = None
    methods: Annotated[tuple[InputMethod, ...], Meta(max_length=16)] | None = None
    ways: Annotated[tuple[Way, ...], Meta(max_length=4)] | None = None
    actions: Annotated[tuple[Name, ...], Meta(max_length=32)] | None = None
    kind: Literal["visitor", "wizard"] = "visitor"
    wizard: Id | None = None
    wizard_epoch: Count = 0
    private: bool = False

    @property
    def driver(self) -> str | None:
        """The peer of the only page that may drive; None while no page may."""
        return self.peer if self.kind == "visitor" else self.wizard

    @property
    def driver_epoch(self) -> int:
        """The epoch in the commands of that page."""
        return self.epoch if self.kind == "visitor" else self.wizard_epoch


class VelocityCommand(Message, frozen=True, kw_only=True):
    """`command/velocity`: 10 to 20 times a second while driving. `frame` is the capture stamp of
    the video frame that the visitor saw.
    """

    session: Id
    epoch: Count
    seq: Count
    stamp: Stamp
    linear: LinearSpeed
    angular: AngularSpeed
    method: InputMethod
    frame: Stamp | None = None


class CommandHeartbeat(Message, frozen=True, kw_only=True):
    """`command/heartbeat`: the visitor's page (or the server) is connected. The server sets `peer`,
    which is ignored on the data channel.

    Unless `needed` is false, it keeps the robot from being idle: false is for a server that only
    compares clocks with a robot that others keep awake. A robot need not echo the peer `watcher`,
    with which web processes report that one of its pages is open. A display of the robot reports
    whether the visitor's video is on view there (`shows`), and whether it may play sound (`plays`).
    """

    n: Count
    stamp: Stamp
    peer: Id = "page"
    echo: Echo | None = None
    frame_age: Seconds | None = None
    needed: bool = True
    shows: bool = False
    plays: bool = False


class PointCommand(Message, frozen=True, kw_only=True):
    """`command/point`: where a hand is on the screen that the driver shares, at most 20 times a
    second; without `at` it is gone.

    From the driver's page and from the robot's own displays; `at` as in `pointer`. The robot passes
    it on while the driver's shared screen is accepted, and counts other messages. The server sets
    `role`, `peer`, `session` and `epoch`; on the data channel `role` and `peer` are ignored. For
    each peer, the newest `stamp` counts.
    """

    stamp: Stamp
    at: Spot | None = None
    role: Literal["driver", "screen"] = "driver"
    peer: Id = "page"
    session: Id | None = None
    epoch: Count = 0


class RouteRequest(Message, frozen=True, kw_only=True):
    """`command/route`: a driver asks, before requesting it, where a `goto` to a point of the map
    would lead; nothing moves. Robots whose factsheet has `previewsRoutes` answer with `route`.

    Ask at most five times a second, and again after 0.7 s without an answer: of several requests
    that wait, the robot answers the newest. The server sets `session` and `epoch`.
    """

    request_id: Id
    stamp: Stamp
    x: Metres
    y: Metres
    session: Id | None = None
    epoch: Count = 0


class Action(Message, frozen=True, kw_only=True):
    """Base of `command/action`: idempotent by `action_id`, refused when older than 3 s or retained.

    `role` and `user` say who asks; the server stamps them, a page's own are discarded.
    """

    action_id: Id
    stamp: Stamp
    session: Id | None = None
    epoch: Count = 0
    role: Literal["driver", "visitor", "observer", "screen", "staff", "owner", "server"] = "driver"
    user: Name = ""


class Goto(Action, frozen=True, kw_only=True, tag_field="type", tag="goto"):
    """Drive to a point of the map, or to a named place."""

    x: Metres | None = None
    y: Metres | None = None
    theta: Radians | None = None
    place: Name | None = None


class Follow(Action, frozen=True, kw_only=True, tag_field="type", tag="follow"):
    """Drive along a line drawn by a controller."""

    points: Annotated[tuple[Point, ...], Meta(min_length=1, max_length=500)]


class Dock(Action, frozen=True, kw_only=True, tag_field="type", tag="dock"):
    """Drive to the charging station and dock."""


class Undock(Action, frozen=True, kw_only=True, tag_field="type", tag="undock"):
    """Back out of the charging station and, if the robot can, turn around, so that the path ahead
    is free.
    """


class Cancel(Action, frozen=True, kw_only=True, tag_field="type", tag="cancel"):
    """Cancel the action `target`, or the running one."""

    target: Id | None = None


class Stop(Action, frozen=True, kw_only=True, tag_field="type", tag="stop"):
    """Brake now. `seq` comes from the velocity counter and voids every lower one; accepted at any
    age, epoch and lease.
    """

    seq: Count = 0


class EStop(Action, frozen=True, kw_only=True, tag_field="type", tag="estop"):
    """Brake now and stay stopped, across a restart of the agent, until `clear_estop`. An observer's
    emergency stop brakes but does not latch.
    """

    detail: Reason = ""


class ClearEStop(Action, frozen=True, kw_only=True, tag_field="type", tag="clear_estop"):
    """Let the robot move again; only from the server, with role `staff`, `owner` or `screen` and a
    user.
    """


class Tilt(Action, frozen=True, kw_only=True, tag_field="type", tag="tilt"):
    """Tilt the head to `angle`: 0 is level, positive looks down."""

    angle: Radians


class Photo(Action, frozen=True, kw_only=True, tag_field="type", tag="photo"):
    """Take a photo; the JPEG follows on `photo/<actionId>`, its SHA-256 in the event."""


class Relocalize(Action, frozen=True, kw_only=True, tag_field="type", tag="relocalize"):
    """Tell the robot where it is; without a pose it searches the whole map."""

    x: Metres | None = None
    y: Metres | None = None
    theta: Radians | None = None


class Say(Action, frozen=True, kw_only=True, tag_field="type", tag="say"):
    """Send a short text to the people on the other side: from the driver to the robot's screen,
    read `aloud` or only shown, or back (role `screen`).
    """

    text: Annotated[str, Meta(min_length=1, max_length=500)]
    language: Annotated[str, Meta(max_length=16)] = ""
    aloud: bool = True


class ConfirmWords(Action, frozen=True, kw_only=True, tag_field="type", tag="confirm_words"):
    """A display of the robot reports what happened to the driver's words `target`, the id of their
    `say`; only from role `screen`, and only for words with `receipts`. See `receipt`.
    """

    target: Id
    state: WordsState


class Call(Action, frozen=True, kw_only=True, tag_field="type", tag="call"):
    """The sound and video that the driver wants to send to the robot, whenever that changes;
    `ringing` false hangs up.

    `volume` is the visitor's volume there, as a share of what the robot's own volume allows;
    `shares` as in `state`.
    """

    ringing: bool = True
    audio: bool = False
    video: bool = False
    volume: Share = 1.0
    shares: bool = False


class AnswerCall(Action, frozen=True, kw_only=True, tag_field="type", tag="answer_call"):
    """A person at the robot's screen accepts or declines the visitor's call; only from role
    `screen`.

    `knock` is the id of a knock that is answered instead of a call. Accepting it also accepts the
    visitor's calls in this session. After declining it, the visitor cannot knock again in this
    session; a call in progress continues.
    """

    accept: bool
    knock: Id | None = None


class Knock(Action, frozen=True, kw_only=True, tag_field="type", tag="knock"):
    """Ring at the robot, to call a person there to its screen; `knock` of `state` has the status.

    Accepted at most once every 10 s (`too_soon`), only while it can ring (`nobody_there`), and not
    after a person there has declined in this session (`declined`).
    """


class ResendStates(Action, frozen=True, kw_only=True, tag_field="type", tag="resend_states"):
    """Publish the states `first` … `last` of `boot` again from the agent's buffer."""

    boot: Id
    first: Count
    last: Count


class SafetyTest(Action, frozen=True, kw_only=True, tag_field="type", tag="safety_test"):
    """Measure how the robot stops: it drives slowly, less than half a metre, and is stopped by
    silence, by a stop and by an emergency stop. The results are in `result`; see Safety test.

    Only from role `owner` or `staff`, and only under a live lease whose `peer` is this action's id,
    so that no page can drive. Only a robot with the capability `safety_test` gets it.
    """


AnyAction = (
    Goto
    | Follow
    | Dock
    | Undock
    | Cancel
    | Stop
    | EStop
    | ClearEStop
    | Tilt
    | Photo
    | Relocalize
    | Say
    | ConfirmWords
    | Call
    | AnswerCall
    | Knock
    | ResendStates
    | SafetyTest
)

# Accepted whatever the lease says; everything else needs the lease, or a role that the kernel
# checks.
UNCONDITIONAL: tuple[type[Action], ...] = (Stop, EStop)


class Config(Message, frozen=True, kw_only=True):
    """`config`: retained; the settings of the server for the robot. `calls`: whether a person at
    the robot's screen must accept a visitor's calls.

    `control_network` impairs the driver's velocities and actions on their path to the wheels,
    whichever transport they used; never stop, estop, cancel, heartbeats and messages of others.
    `video_network` impairs video and sound on their path to the driver alone. They apply to the
    session `network_session`, or to every session if that is absent.
    """

    stamp: Stamp
    assist: AssistLevel = "off"
    control_network: NetworkLab | None = None
    video_network: NetworkLab | None = None
    network_session: Id | None = None
    doors: Annotated[dict[Name, Literal["open", "closed"]], Meta(max_length=64)] = {}
    calls: Literal["accept", "ask"] = "accept"


class FloorPlanUpdate(Message, frozen=True, kw_only=True):
    """`floorplan`: retained; the map of ROS map_server, whole, because the agent has no database.

    `image` is a PNG in base64 and `sha256` its digest; `resolution` in metres a pixel; `origin` (x,
    y, theta) of the lower left corner. `plan` is the site's plan.json (rooms, doors, docks,
    places), absent when the site has none.
    """

    map_id: Name
    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
    resolution: Annotated[float, Meta(gt=0.0, le=10.0)]
    origin: tuple[Metres, Metres, Radians]
    negate: bool = False
    occupied_thresh: Share = 0.65
    free_thresh: Share = 0.196
    image: Annotated[str, Meta(max_length=700_000)]
    plan: dict[str, Any] | None = None


# --- signalling -----------------------------------------------------------------------------------

Sdp = Annotated[str, Meta(max_length=64_000)]


class IceServer(Message, frozen=True, kw_only=True):
    """One entry of RTCPeerConnection's iceServers."""

    urls: Annotated[
        tuple[Annotated[str, Meta(max_length=300)], ...], Meta(min_length=1, max_length=8)
    ]
    username: Annotated[str, Meta(max_length=300)] = ""
    credential: Annotated[str, Meta(max_length=300)] = ""


class SdpOffer(Message, frozen=True, kw_only=True, tag_field="type", tag="offer"):
    """`signal/<peer>`: the page always offers. Role, session and epoch are
    stamped by the server.
    """

    sdp: Sdp
    role: Role = "observer"
    session: Id | None = None
    epoch: Count = 0
    who: Name = ""
    ice_servers: Annotated[tuple[IceServer, ...], Meta(max_length=8)] = ()


class SdpAnswer(Message, frozen=True, kw_only=True, tag_field="type", tag="answer"):
    """`signal/<peer>/reply`: the agent answers, with all of its candidates in the SDP."""

    sdp: Sdp


class Candidate(Message, frozen=True, kw_only=True, tag_field="type", tag="candidate"):
    """A trickled ICE candidate of the page; an empty `candidate` says there are no more."""

    candidate: Annotated[str, Meta(max_length=2000)] = ""
    sdp_mid: Annotated[str, Meta(max_length=64)] | None = None
    sdp_m_line_index: Annotated[int, Meta(ge=0, le=64)] | None = None


class Bye(Message, frozen=True, kw_only=True, tag_field="type", tag="bye"):
    """Either side ends the connection; `reason` is one word: `replaced`, `lease_changed`, `full`,
    `failed`, `left`, `flooded`.

    The robot refuses a page that flooded it for another 5 s.
    """

    reason: Reason = ""


class Stay(Message, frozen=True, kw_only=True, tag_field="type", tag="stay"):
    """The server confirms a page that watches, or a robot's own display: every minute, while it is
    connected and permitted.

    The robot closes the connection of a page for which it has received neither an offer nor this
    for 150 s; the lease covers the driver's connection. A page could keep its connection after its
    socket has closed, and must not continue to watch that way.

    `viewers` is how many people watch over this connection: one, but for that of an SFU, which
    passes the stream on. A state counts them all.
    """

    viewers: Count = 1


Signal = SdpOffer | Candidate | Bye | Stay
SignalReply = SdpAnswer | Candidate | Bye


# --- pictures without WebRTC ----------------------------------------------------------------------


class PictureRequest(Message, frozen=True, kw_only=True):
    """`command/picture`: one more JPEG frame through the server, for a page that no WebRTC path
    reaches. The server stamps `peer`.

    It acknowledges the previous frame: `seen` is the capture stamp of that frame. `round_trip` is
    how long a small message takes from the page to the robot and back, by the page's clock; any
    longer time of a frame is due to its size.
    """

    stamp: Stamp
    peer: Id = "page"
    seen: Stamp | None = None
    round_trip: Seconds | None = None


class ManagerStatus(Message, frozen=True, kw_only=True):
    """`telepresence/v1/server/manager`: the session manager's heartbeat for the web processes,
    twice a second.

    `faults` are the failed parts that it needs: a database that does not answer or refuses, and a
    disk that is nearly full (`disk_low`) or full. A web process that receives no heartbeat
    for 1.4 s tells its pages that the session manager has failed.
    """

    stamp: Stamp
    faults: Annotated[
        tuple[Literal["database", "disk_low", "disk_full"], ...], Meta(max_length=8)
    ] = ()
