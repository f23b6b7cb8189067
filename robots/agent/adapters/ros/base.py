"""A robot that runs ROS, over any `Bus`: rospy or rclpy in a child process, or rosbridge.

The pose comes from the robot's own localization (`pose`: amcl's topic, or `tf`), or with
`localization` "none" from the agent's. Go-to is the robot's own navigation (navigators/).
"""

import asyncio
import contextlib
import itertools
import math
import re
import time
from dataclasses import replace
from typing import Annotated, Any, Literal, Self

import msgspec
import structlog
from msgspec import Struct

from robots.agent.adapters.common.pending_actions import (
    LONGEST_RELOCALIZATION,
    ExpectedArea,
    PendingAction,
)
from robots.agent.adapters.common.remote_adapter import RemoteAdapter, profile_of
from robots.agent.adapters.common.robot_profile import RobotProfile
from robots.agent.adapters.ros import messages
from robots.agent.adapters.ros.bus import OURS, Bus, Handler, Subscription
from robots.agent.adapters.ros.docking import TriggerDocking
from robots.agent.adapters.ros.graph import (
    TWIST,
    TWIST_STAMPED,
    Graph,
    TopicNeed,
    TopicPeers,
    chosen_stamped,
    no_subscriber,
    unpublished,
)
from robots.agent.adapters.ros.navigators import navigator_of
from robots.agent.adapters.ros.topic_camera import TopicCamera
from robots.agent.ramp import ZERO, is_within
from robots.agent.robot_interface import (
    ActionProgress,
    ActionRefusedError,
    AdapterError,
    NavigationControl,
    VideoSource,
)
from robots.api.geometry import Pose2D
from robots.api.messages import (
    Action,
    ActionState,
    Capability,
    Dock,
    Goto,
    Relocalize,
    Undock,
    Velocity,
)
from robots.api.reasons import ReasonCode

ACCEPTANCE = 5.0  # seconds in which navigation has to accept a goal
AT_REST_FOR = 0.3  # seconds of measurements that show the robot at rest
WANTED_AGE = 0.3  # seconds after which a velocity of the navigation counts as zero
# metres and radians: standard deviations of a pose that a person entered
POSE_DEVIATION, HEADING_DEVIATION = 0.5, 0.26
SCAN_PERIOD = 0.05
IMAGE_PERIOD = 0.03
STAMPED: dict[str, bool | None] = {
    "auto": None,
    **dict.fromkeys(("true", "yes", "on", "1"), True),
    **dict.fromkeys(("false", "no", "off", "0"), False),
}
BOOL = "std_msgs/Bool"
ROS_NAME = re.compile(r"/?\w+(/\w+)*", re.ASCII)
SUBSCRIBED_WITHIN = 2.0  # seconds in which a subscriber of velocities should be found
# seconds between two reports of errors; subscribers are polled five times as often
REPORT_PERIOD = 0.25
PUBLISHED_WITHIN = 3.0  # seconds after which a topic without a publisher is reported
GRAPH_PERIOD = 5.0  # seconds between two requests of all topics
# seconds between two readings, at most, when a velocity can wait for the next of them
FAST_PERIOD = 0.1
log = structlog.stdlib.get_logger(__name__)

# an option that names a topic, a service or an action: resolved below the namespace
RosName = Annotated[str, "a name of ROS"]


class RosOptions(Struct, frozen=True, kw_only=True):
    """Names of topics, services and frames; empty for what this robot does not have.

    As in ROS, a name that begins with a slash is absolute, and any other is below the `namespace`;
    frames and joints have none.

    `watchdog` is the base's own, in seconds. `navigation` is `move_base` (topics of its action),
    `nav2` (the action) or `none`. `navigation_velocity` is the topic on which navigation and
    docking publish their velocities when only the agent subscribes to it and passes them on.
    `speed_limit` takes a nav2_msgs/SpeedLimit. `dock`, `undock` and `cancel_dock` are
    std_srvs/Trigger services; the battery shows when the robot is docked. `tilt` takes a
    std_msgs/Float64 in radians, `tilt_joint` is its name in `joint_states`. `bumper` and `estop`
    are std_msgs/Bool, `image` is a sensor_msgs/CompressedImage. `lock` is a std_msgs/Bool that
    locks the base against velocities (twist_mux), `estop_service` a service of
    `estop_service_type` that does. `stamped` selects TwistStamped for velocities; `auto` follows
    the type of the subscribers of `cmd_vel`.
    """

    namespace: str = ""
    cmd_vel: RosName = "cmd_vel"
    navigation_velocity: RosName = ""
    stamped: bool | str = "auto"
    odom: RosName = "odom"
    scan: RosName = "scan"
    battery: RosName = "battery_state"
    localization: Literal["pose", "tf", "none"] = "pose"
    pose: RosName = "amcl_pose"
    initial_pose: RosName = "initialpose"
    tf: RosName = "tf"
    map_frame: str = "map"
    odom_frame: str = "odom"
    navigation: Literal["", "move_base", "nav2", "none"] = ""
    move_base: RosName = "move_base"
    navigate: RosName = "navigate_to_pose"
    speed_limit: RosName = ""
    dock: RosName = ""
    undock: RosName = ""
    cancel_dock: RosName = ""
    tilt: RosName = ""
    joint_states: RosName = "joint_states"
    tilt_joint: str = ""
    bumper: RosName = ""
    estop: RosName = ""
    lock: RosName = ""
    estop_service: RosName = ""
    estop_service_type: Literal["SetBool", "Trigger"] = "SetBool"
    image: RosName = ""
    watchdog: float

    def __post_init__(self) -> None:
        if str(self.stamped).lower() not in STAMPED:
            raise ValueError(f"stamped must be auto, true or false, not {self.stamped!r}")
        names = {option: getattr(self, option) for option in NAMED}
        for option, name in {"namespace": self.namespace.strip("/"), **names}.items():
            if name and not ROS_NAME.fullmatch(name):
                raise ValueError(
                    f"{option} must be a name of ROS (letters, digits and underscores, between"
                    f" slashes), such as {'/robot1' if option == 'namespace' else '/base/cmd_vel'},"
                    f" not {name!r}"
                )

    def resolved(self) -> Self:
        """Return the same with absolute names of topics, services and actions."""
        namespace = self.namespace.strip("/")
        below = f"/{namespace}/" if namespace else "/"
        names = {option: getattr(self, option) for option in NAMED}
        absolute = {each: below + name for each, name in names.items() if name and name[0] != "/"}
        return msgspec.structs.replace(self, **absolute)


NAMED = tuple(option for option, kind in RosOptions.__annotations__.items() if kind == RosName)


class RosAdapter(RemoteAdapter):
    """See robot_interface.Adapter, PassesVelocities, WithLock and LimitsSpeed, and bus.Goals."""

    def __init__(self, robot: RobotProfile, options: RosOptions, bus: Bus, rca: str) -> None:
        self._options, self._bus = options.resolved(), bus
        options = self._options
        name = options.navigation or ("move_base" if bus.version == 1 else "nav2")
        action = options.move_base if name == "move_base" else options.navigate
        own = _abilities(options, name)
        control = _control(options, bus, own)
        super().__init__(
            profile_of(
                robot, rca, options.watchdog, own=own, control=control, advice=bus.advice + ADVICE
            ),
            robot.battery,
        )
        self.must_answer, self.connect_time = bus.answers, bus.connect_time
        self.place, self.vital = bus.place, f"its odometry on {options.odom}"
        self._navigator = navigator_of(name, action, bus, self) if "goto" in own else None
        self._docking = TriggerDocking(options.cancel_dock, bus, self._at_rest)
        self._docking_id = ""  # the newest action that docks or undocks
        self._docking_ended = False  # it has, but the guard does not know yet
        self._at_rest_since: float | None = None
        self._counter = itertools.count(1)
        self._camera = TopicCamera(options.image) if options.image else None
        self._wanted = (ZERO, -math.inf)  # the navigation's velocity, and when it arrived
        # whether velocities are stamped, by the option and as they are sent
        self._set_stamped = STAMPED[str(options.stamped).lower()]
        self._stamped = self._set_stamped or False
        self._graph: Graph | None = None
        self._silent: set[str] = set()  # topics without a message yet
        self._subscribers: int | None = None
        self._early_fix: dict[str, Any] | None = None
        self._odometry_stamp: Any = None  # of the newest odometry
        self._advertised = False
        self._next_reading: asyncio.Future[None] | None = None
        self._locked = False
        self._locking = asyncio.Lock()
        self._lock_problem = ""

    # --- the connection ---------------------------------------------------------------------------

    async def _open(self) -> None:
        await self._bus.open(self._lose, self)
        bus, options = self._bus, self._options
        bus.tell_guard(op="guard", **self._guard_settings())
        self._graph = await bus.graph(options.cmd_vel, ())
        self._silent = {need.topic for need in self._needs()}
        self._subscribers = self._early_fix = None
        self._wanted = (ZERO, -math.inf)
        self._advertised = False
        for topic, kind in self._publications():
            bus.advertise(topic, kind)
        if options.lock:
            bus.advertise(options.lock, BOOL, latch=True)
        for each in self._subscriptions():
            bus.subscribe(replace(each, handler=self._safely(each.topic, each.handler)))

    async def _cancel_leftovers(self) -> None:
        if self._navigator is not None:
            await self._navigator.cancel_leftovers()
        if self._options.cancel_dock and not self._bus.guards:
            await self._docking.cancel()
        self._advertise_velocities()
        self._run(self._watch_listeners())
        self._run(self._watch_graph())

    def _guard_settings(self) -> dict[str, Any]:
        options, navigator = self._options, self._navigator
        kind = navigator.kind if navigator is not None else ""
        return {
            "action": options.move_base if kind == "move_base" else options.navigate,
            "kind": kind,
            "driving": options.cmd_vel,
            "odom": options.odom,
            "docks": [service for service in (options.dock, options.undock) if service],
            "cancel_dock": options.cancel_dock,
            "linear": self.profile.standstill_linear,
            "angular": self.profile.standstill_angular,
        }

    async def _shut(self) -> None:
        await self._bus.shut()

    async def _ask(self) -> None:
        await self._bus.ask()
        if not self._bus.answers and self._gate.usual < FAST_PERIOD:
            self._next_reading = asyncio.get_running_loop().create_future()
            await self._next_reading

    def _cut(self) -> None:
        self._bus.cut()

    # --- publishers and subscribers ---------------------------------------------------------------

    def _needs(self) -> list[TopicNeed]:
        names = {getattr(self._options, option): option for option in NAMED}
        return [
            TopicNeed(each.topic, each.kind, names[each.topic])
            for each in self._subscriptions()
            if each.topic in names
        ]

    def _advertise_velocities(self) -> None:
        """Advertise velocities of the type of their subscribers; with `stamped=auto`, only once
        there is one.
        """
        topic, wanted = self._options.cmd_vel, self._set_stamped
        if wanted is None:
            wanted = chosen_stamped(self._graph, topic, stamped=self._stamped)
        graph = self._graph if self._set_stamped is None else None
        if self._advertised:
            if wanted == self._stamped or self._bus.listeners(topic):
                return
        elif graph is not None and graph.get(topic, TopicPeers(subscribers=0)).subscribers == 0:
            return
        self._stamped, self._advertised = wanted, True
        self._bus.advertise(topic, TWIST_STAMPED if wanted else TWIST, drives=True)

    def _listeners(self) -> int | None:
        return self._bus.listeners(self._options.cmd_vel) if self._advertised else 0

    def _why_not_received(self) -> str:
        """Return why no subscriber receives velocities; ROS reports no types that differ."""
        if self._listeners() != 0:
            return ""
        return no_subscriber(self._graph, self._options.cmd_vel, stamped=self._stamped)

    async def _settle(self) -> None:
        deadline = time.monotonic() + SUBSCRIBED_WITHIN
        # A bus does not announce its first subscriber.
        while (  # noqa: ASYNC110
            self._why_not_received() and not self._failure and time.monotonic() < deadline
        ):
            await asyncio.sleep(REPORT_PERIOD / 5)

    async def _watch_listeners(self) -> None:
        """Send a new subscriber a zero velocity first, and use the type of the base."""
        while True:
            now = self._listeners()
            if now and not self._subscribers:
                self._send_zero(time.monotonic())
            self._subscribers = now
            if not self._gate.moving:
                self._advertise_velocities()
            await asyncio.sleep(REPORT_PERIOD / 5)

    async def _watch_graph(self) -> None:
        """Report missing peers. The graph is requested only at rest: during the request, rosbridge
        takes no velocities.
        """
        began = time.monotonic()
        due = began
        while True:
            now = time.monotonic()
            if not self._gate.moving and (now >= due or self._why_not_received()):
                due = now + GRAPH_PERIOD
                self._graph = await self._bus.graph(self._options.cmd_vel, sorted(self._silent))
            silent = [need for need in self._needs() if need.topic in self._silent]
            missing = unpublished(self._graph, silent) if now - began > PUBLISHED_WITHIN else ()
            hangs = self._gate.shut(time.monotonic())
            errors = (
                hangs and f"{self.place} {hangs}",
                *self._bus.problems,
                self._why_not_received(),
                self._lock_problem,
                *missing,
            )
            self.readings.errors = tuple(filter(None, errors))
            await asyncio.sleep(REPORT_PERIOD)

    def _why_silent(self) -> str:
        odometry = [need for need in self._needs() if need.topic == self._options.odom]
        return next(iter((*self._bus.problems, *unpublished(self._graph, odometry))), "")

    def _publications(self) -> list[tuple[str, str]]:
        options = self._options
        topics = [
            (options.initial_pose, "geometry_msgs/PoseWithCovarianceStamped"),
            (options.tilt, "std_msgs/Float64"),
        ]
        if self._navigator is not None:
            topics += self._navigator.publications
            topics.append((options.speed_limit, "nav2_msgs/SpeedLimit"))
        return [(topic, kind) for topic, kind in topics if topic]

    def _subscriptions(self) -> list[Subscription]:
        options = self._options
        joints = options.joint_states if options.tilt_joint else ""
        pose = options.pose if options.localization == "pose" else ""
        tf = options.tf if options.localization == "tf" else ""
        peers = (self._graph or {}).get(options.navigation_velocity, TopicPeers())
        is_stamped = TWIST_STAMPED in peers.kinds or self._set_stamped
        twist = TWIST_STAMPED if is_stamped else TWIST
        scan_kind, image_kind = "sensor_msgs/LaserScan", "sensor_msgs/CompressedImage"
        pose_kind = "geometry_msgs/PoseWithCovarianceStamped"
        topics = [
            Subscription(options.odom, "nav_msgs/Odometry", self._odometry, essential=True),
            Subscription(options.scan, scan_kind, self._scan, sensor=True, period=SCAN_PERIOD),
            Subscription(options.battery, "sensor_msgs/BatteryState", self._charge),
            Subscription(joints, "sensor_msgs/JointState", self._joints),
            Subscription(options.bumper, BOOL, self._bumper),
            Subscription(options.image, image_kind, self._image, sensor=True, period=IMAGE_PERIOD),
            Subscription(options.estop, BOOL, self._estop, either=True, essential=True),
            Subscription(options.navigation_velocity, twist, self._navigate, essential=True),
            *(self._navigator.subscriptions if self._navigator is not None else ()),
            Subscription(pose, pose_kind, self._fix, latched=True, essential=True),
            Subscription(tf, "tf2_msgs/TFMessage", self._transforms, essential=True),
        ]
        return [each for each in topics if each.topic]

    def _safely(self, topic: str, handler: Handler) -> Handler:
        """Return a handler that logs and ignores malformed messages."""

        def handle(message: dict[str, Any]) -> None:
            self._silent.discard(topic)
            try:
                handler(message)
            except messages.RosError as error:
                log.warning("ros_message_refused", topic=topic, reason=str(error))

        return handle

    # --- readings ---------------------------------------------------------------------------------

    def _odometry(self, message: dict[str, Any]) -> None:
        here, velocity = messages.odometry_in(message)
        stamp = message.get("header", {}).get("stamp")
        if stamp == self._odometry_stamp and messages.stamp_in(message, 0.0):
            return  # published again: it measures nothing
        self._odometry_stamp = stamp
        self.readings.moved(here, velocity, self._stamp("odometry", message), time.monotonic())
        if self._early_fix is not None:
            early, self._early_fix = self._early_fix, None
            self._fix(early)
        if self._next_reading is not None and not self._next_reading.done():
            self._next_reading.set_result(None)
        self._received()

    def _fix(self, message: dict[str, Any]) -> None:
        pose = messages.fix_in(message)
        if self.readings.odometry is None:
            self._early_fix = message  # latched long ago: combined with the first odometry
        else:
            self.readings.located(pose, self._stamp("pose", message), time.monotonic())

    def _transforms(self, message: dict[str, Any]) -> None:
        found = messages.transform_in(message, self._options.map_frame, self._options.odom_frame)
        if found is not None:
            self.readings.corrected(found, time.monotonic())

    def _stamp(self, topic: str, message: dict[str, Any]) -> float:
        """Return when a message was measured, Unix time."""
        arrived = time.time()
        return self.readings.believed(topic, messages.stamp_in(message, arrived), arrived)

    def _scan(self, message: dict[str, Any]) -> None:
        self.readings.scanned(messages.scan_in(message, self._stamp("scan", message)))

    def _bumper(self, message: dict[str, Any]) -> None:
        self.readings.bumped(touching=messages.flag_in(message))

    def _estop(self, message: dict[str, Any]) -> None:
        self.readings.estop = messages.flag_in(message)

    def _charge(self, message: dict[str, Any]) -> None:
        self.readings.charged(**msgspec.structs.asdict(messages.battery_in(message)))

    def _image(self, message: dict[str, Any]) -> None:
        if self._camera is not None and self._camera.wanted:
            self._camera.take(messages.picture_in(message), self._stamp("image", message))

    def _joints(self, message: dict[str, Any]) -> None:
        angle = messages.joint_in(message, self._options.tilt_joint)
        self.readings.tilt = self.readings.tilt if angle is None else angle

    def video(self) -> VideoSource | None:
        return self._camera

    # --- orders -----------------------------------------------------------------------------------

    def _drive(self, velocity: Velocity) -> None:
        message: dict[str, Any] = messages.twist(velocity)
        if not self._advertised:
            return  # there is no subscriber
        if self._stamped:
            message = {
                "header": messages.header("base_link", time.time(), self._bus.version),
                "twist": message,
            }
        self._bus.publish(self._options.cmd_vel, message, newest=True)

    def _turn_head(self, angle: float) -> None:
        self._bus.publish(self._options.tilt, {"data": angle})

    async def _order(self, action: Action) -> PendingAction:
        pending = None if isinstance(action, Relocalize) else self._pending(action)
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None and pending is not None:
                # move_base and Nav2 need a heading
                theta = self.readings.pose.theta if action.theta is None else action.theta
                pending.goal_id = self._send_goal(Pose2D(x, y, theta))
            case Goto(place=place):
                raise ActionRefusedError(ReasonCode.UNKNOWN_PLACE.of(place))
            case Dock() | Undock():
                self._docking_id, self._docking_ended = action.action_id, False
                is_dock = isinstance(action, Dock)
                await self._docking.start(self._options.dock if is_dock else self._options.undock)
            case Relocalize(x=x, y=y) if x is not None and y is not None:
                return self._relocalize(action, Pose2D(x, y, action.theta or 0.0))
            case _:
                raise ActionRefusedError(ReasonCode.NO_GOAL)
        assert pending is not None
        return pending

    def _relocalize(self, action: Relocalize, place: Pose2D) -> PendingAction:
        """Send a pose to the localization, and wait until it reports one there: amcl answers once,
        with the next scan.
        """
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = POSE_DEVIATION**2
        covariance[35] = (HEADING_DEVIATION if action.theta is not None else math.pi) ** 2
        pose = {"pose": messages.pose(place), "covariance": covariance}
        self._bus.publish(
            self._options.initial_pose, {"header": self._map_header(time.time()), "pose": pose}
        )
        area = ExpectedArea(
            place.x, place.y, 2.0 * POSE_DEVIATION, action.theta, 3.0 * HEADING_DEVIATION
        )
        now = time.monotonic()
        return PendingAction(
            action.action_id, "relocalize", now, deadline=now + LONGEST_RELOCALIZATION, area=area
        )

    def _map_header(self, unix: float) -> dict[str, Any]:
        return messages.header(self._options.map_frame, unix, self._bus.version)

    def _tell(self, progress: ActionProgress) -> None:
        super()._tell(progress)
        if progress.action_id == self._docking_id and progress.status != "RUNNING":
            self._docking_ended, self._at_rest_since = True, None

    async def _withdraw(self, pending: PendingAction) -> bool:
        if pending.kind != "goto":
            return await self._docking.cancel()
        if self._navigator is None or not pending.goal_id:
            return True  # it was never sent
        return await self._navigator.cancel(pending.goal_id)

    # --- goals ------------------------------------------------------------------------------------

    def _send_goal(self, place: Pose2D) -> str:
        assert self._navigator is not None
        now = time.time()
        goal = f"{OURS}{next(self._counter)}-{now:.3f}"
        owned = self.pending_actions.drive
        if owned is not None:
            owned.goal_id = goal  # before it is sent: it may be taken in spite of an error
        target = {"header": self._map_header(now), "pose": messages.pose(place)}
        self._navigator.send(target, goal)
        return goal

    def _release_guard(self, now: float) -> None:
        """Tell the guard that a docking has ended, once the robot is measured at rest: it undocks
        beyond the point where its contacts part.
        """
        if not self._at_rest():
            self._at_rest_since = None
        elif self._at_rest_since is None:
            self._at_rest_since = now
        elif self.readings.last_received_at - self._at_rest_since >= AT_REST_FOR:
            self._docking_ended = False
            with contextlib.suppress(AdapterError):  # a new connection's guard cancels it anyway
                self._bus.tell_guard(op="docking_ended")

    def _look(self, now: float) -> None:
        if self._docking_ended:
            self._release_guard(now)
        drive = self.pending_actions.drive
        if (
            drive is not None
            and drive.kind == "goto"
            and not drive.seen_running
            and now - drive.began > ACCEPTANCE
        ):
            drive.failure = drive.failure or ReasonCode.NAVIGATION_LOST.of("silent")

    def _of_goal(self, goal: str) -> PendingAction | None:
        drive = self.pending_actions.drive
        return drive if drive is not None and drive.goal_id == goal else None

    def accepted(self, goal: str) -> None:
        if (pending := self._of_goal(goal)) is not None:
            pending.seen_running = True

    def ended(self, goal: str, status: ActionState, reason: str) -> None:
        if (pending := self._of_goal(goal)) is not None:
            self.pending_actions.end(pending.action_id, status, reason)

    def failed(self, goal: str, reason: str) -> None:
        """Have a goal that may still run cancelled until its end is confirmed."""
        if (pending := self._of_goal(goal)) is not None:
            pending.failure = pending.failure or reason

    def server_ended(self) -> None:
        if self._navigator is not None:
            self._navigator.server_ended()

    def docking_cancelled(self) -> None:
        drive = self.pending_actions.drive
        if drive is not None and drive.kind != "goto":
            drive.failure = drive.failure or ReasonCode.HEARTBEAT_LOST

    # --- velocities, speed limit and lock of the robot --------------------------------------------

    def _navigate(self, message: dict[str, Any]) -> None:
        self._wanted = messages.velocity_in(message), time.monotonic()

    def wanted(self) -> Velocity | None:
        """Return what the navigation wants while an action of ours runs, see PassesVelocities."""
        drive = self.pending_actions.drive
        if self.profile.navigation_control != "agent" or drive is None:
            return None
        if drive.failure or drive.first_cancelled_at is not None:
            return None
        velocity, arrived = self._wanted
        return velocity if time.monotonic() - arrived <= WANTED_AGE else ZERO

    def limit_speed(self, linear: float) -> None:
        if self._options.speed_limit and not self._failure:
            header = self._map_header(time.time())
            limit = {"header": header, "percentage": False, "speed_limit": linear}
            self._bus.publish(self._options.speed_limit, limit)

    def set_lock(self, *, locked: bool) -> None:
        """Lock or release the base, by topic and by service."""
        if self._failure:
            raise AdapterError(self._failure)
        self._locked = locked
        if self._options.lock:
            self._bus.publish(self._options.lock, {"data": locked})
        if self._options.estop_service:
            self._run(self._call_lock(locked=locked))

    async def _call_lock(self, *, locked: bool) -> None:
        kind, service = self._options.estop_service_type, self._options.estop_service
        async with self._locking:  # of two calls, the newer one counts
            if self._locked != locked or (kind == "Trigger" and not locked):
                return  # a Trigger only locks
            arguments = {"data": locked} if kind == "SetBool" else {}
            try:
                done, reason = await self._bus.call(service, f"std_srvs/{kind}", arguments)
            except AdapterError as error:
                done, reason = False, str(error)
            if self._locked == locked:
                failed = f"{service} failed: {reason or 'no reason given'}"
                self._lock_problem = "" if done else failed

    def _at_rest(self) -> bool:
        return is_within(self.readings.velocity, self.profile.standstill)


ADVICE = (
    "set navigation_velocity to a topic on which navigation and docking publish their velocities"
    " and that only the agent subscribes to, or set navigation=none and dock to nothing"
)


def _control(
    options: RosOptions, bus: Bus, own: tuple[Capability, ...]
) -> NavigationControl | None:
    """Return what stops the robot's own navigation and docking when the agent is lost."""
    docks = bool({"dock", "undock"} & set(own))
    if not docks and "goto" not in own:
        return None
    if options.navigation_velocity:
        return "agent"
    return "guarded" if bus.guards and (options.cancel_dock or not docks) else "unguarded"


def _abilities(options: RosOptions, navigation: str) -> tuple[Capability, ...]:
    """Return what a robot with these topics can do by itself."""
    localizes = options.localization != "none"
    able: dict[Capability, bool] = {
        "localization": localizes,
        "scan": bool(options.scan),
        "goto": localizes and navigation != "none",
        "dock": bool(options.dock),
        "undock": bool(options.undock),
        "relocalize": localizes and bool(options.initial_pose),
        "tilt": bool(options.tilt and options.tilt_joint),
    }
    return tuple(name for name, is_able in able.items() if is_able)
