"""A robot that runs ROS, whatever way leads to it: rosbridge, a node of ROS 1, DDS of ROS 2.

A `Bus` carries messages as JSON objects (ros_words.py); this module knows the topics. Where the
robot is comes from its own localization (`pose`: amcl's topic, or `tf`), or with `localization`
"none" from the agent's. Go-to is move_base's or Nav2's.
"""

import asyncio
import itertools
import math
import re
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, Protocol, Self

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
from robots.agent.adapters.common.state_builder import stamp_of
from robots.agent.adapters.ros import messages
from robots.agent.adapters.ros.graph import (
    TWIST,
    TWIST_STAMPED,
    Graph,
    TopicNeed,
    TopicPeers,
    chosen_stamped,
    master_restarted,
    nobody_listens,
    not_said,
)
from robots.agent.adapters.ros.topic_camera import TopicCamera
from robots.agent.robot_interface import AdapterError, VideoSource
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

ACCEPTANCE = 5.0  # seconds in which navigation has to take note of a goal
# metres and radians: standard deviations of a pose that somebody told
TOLD_WITHIN, TURNED_WITHIN = 0.5, 0.26
SCAN_PERIOD = 0.05
PICTURE_PERIOD = 0.03
DONE: dict[int, dict[int, ActionState]] = {
    # actionlib_msgs/GoalStatus
    1: {2: "CANCELLED", 3: "FINISHED", 4: "FAILED", 5: "FAILED", 8: "CANCELLED", 9: "FAILED"},
    2: {4: "FINISHED", 5: "CANCELLED", 6: "FAILED"},  # action_msgs/GoalStatus
}
STAMPED: dict[str, bool | None] = {
    "auto": None,
    **dict.fromkeys(("true", "yes", "on", "1"), True),
    **dict.fromkeys(("false", "no", "off", "0"), False),
}
# the options that name a topic, a service or an action
NAMED = (
    "cmd_vel",
    "odom",
    "scan",
    "battery",
    "pose",
    "initial_pose",
    "tf",
    "move_base",
    "navigate",
    "goal_pose",
    "dock",
    "undock",
    "cancel_dock",
    "tilt",
    "joint_states",
    "bumper",
    "estop",
    "image",
)
ROS_NAME = re.compile(r"/?\w+(/\w+)*", re.ASCII)
LISTENERS = 2.0  # seconds in which whoever listens for velocities should be found
LOOKING = 0.25  # seconds between two looks at who listens, while nobody does
SETTLING = 3.0  # seconds after which a topic that nobody publishes is missing
LOOKING_ROUND = 5.0  # seconds between two looks at all topics
OFTEN = 0.1  # seconds between two readings, at most, when an order can wait for the next of them
RUNNING = frozenset({1, 2, 3})  # accepted, executing, cancelling
log = structlog.stdlib.get_logger(__name__)

Handler = Callable[[dict[str, Any]], None]
# topic, type, what takes its messages, and options of the subscription
Subscription = tuple[str, str, Handler, dict[str, Any]]


class RosOptions(Struct, frozen=True, kw_only=True):
    """Names of topics, services and frames; an empty name is one that this robot does not have.

    As in ROS, a name that begins with a slash is what it says, and every other one is below the
    `namespace`; frames and joints have none.

    `watchdog` is the base's own, in seconds. `navigation` is `move_base` (topics of its action),
    `nav2` (the action), `goal_pose` (a topic, and the status of Nav2's action) or `none`. `dock`,
    `undock` and `cancel_dock` are std_srvs/Trigger services; done is what the battery says. `tilt`
    takes a std_msgs/Float64 in radians, `tilt_joint` is its name in `joint_states`. `bumper` and
    `estop` are std_msgs/Bool, `image` is a sensor_msgs/CompressedImage. `stamped` says whether
    velocities are TwistStamped; `auto` goes by what listens on `cmd_vel`.
    """

    namespace: str = ""
    cmd_vel: str = "cmd_vel"
    stamped: bool | str = "auto"
    odom: str = "odom"
    scan: str = "scan"
    battery: str = "battery_state"
    localization: Literal["pose", "tf", "none"] = "pose"
    pose: str = "amcl_pose"
    initial_pose: str = "initialpose"
    tf: str = "tf"
    map_frame: str = "map"
    odom_frame: str = "odom"
    navigation: Literal["", "move_base", "nav2", "goal_pose", "none"] = ""
    move_base: str = "move_base"
    navigate: str = "navigate_to_pose"
    goal_pose: str = "goal_pose"
    dock: str = ""
    undock: str = ""
    cancel_dock: str = ""
    tilt: str = ""
    joint_states: str = "joint_states"
    tilt_joint: str = ""
    bumper: str = ""
    estop: str = ""
    image: str = ""
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
        """Return the same with every topic, service and action from the root."""
        namespace = self.namespace.strip("/")
        below = f"/{namespace}/" if namespace else "/"
        names = {option: getattr(self, option) for option in NAMED}
        relative = {option: name for option, name in names.items() if name and name[0] != "/"}
        return msgspec.structs.replace(
            self, **{option: below + name for option, name in relative.items()}
        )


class Goals(Protocol):
    """Who hears of a goal that a bus carries to an action of ROS 2."""

    def accepted(self, goal: str) -> None:
        """The robot works on it."""

    def ended(self, goal: str, status: ActionState, reason: str) -> None:
        """It is over."""


class Bus(Protocol):
    """A way to a ROS system. Types are written as in ROS 1 (`nav_msgs/Odometry`); nothing but the
    awaited may block.
    """

    version: int
    place: str
    # whether `ask` asks those who listen for velocities; else it is a reading that says that they
    # live
    answers: bool

    @property
    def forgotten(self) -> tuple[str, ...]:
        """Return the nodes that still run and that the ROS master, restarted meanwhile, does not
        know.
        """

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        """Reach it; `lost` hears later why it is gone.

        Raises:
            AdapterError, OSError, TimeoutError: it cannot be reached.
        """

    async def shut(self) -> None:
        """Let go of it."""

    def subscribe(
        self,
        topic: str,
        kind: str,
        handler: Handler,
        *,
        latched: bool = False,
        sensor: bool = False,
        period: float = 0.0,
    ) -> None:
        """Hear a topic; `latched` wants its last message too, `sensor` may lose some, `period` is
        the least time between two.
        """

    def advertise(self, topic: str, kind: str, *, drives: bool = False) -> None:
        """Say what will be published; `drives` are velocities."""

    def unadvertise(self, topic: str) -> None:
        """Say that nothing more will be."""

    async def ask(self) -> None:
        """Wait until those who should have read what they were told.

        Raises:
            AdapterError: it is gone.
        """

    def cut(self) -> None:
        """Throw away what has not been sent yet; at once."""

    def listeners(self, topic: str) -> int | None:
        """Return how many hear a topic that drives, as the same type; None when
        that is not known.
        """

    async def graph(self, driving: str, heard: Iterable[str]) -> Graph | None:
        """Return what others have to do with topics: at least with the one that drives and those
        `heard`; None when nobody knows.

        Raises:
            AdapterError: the system is gone.
        """

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        """Send; of those that are `newest` only the last counts, and only while it is fresh.

        Raises:
            AdapterError: it takes none.
        """

    async def call(self, service: str, kind: str) -> tuple[bool, str]:
        """Call a service without arguments and return its success and message.

        Raises:
            AdapterError: there is none, or no answer.
        """

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        """Send a goal to an action of ROS 2 under a name of ours.

        Raises:
            AdapterError: this bus carries no actions.
        """

    def cancel_goal(self, action: str, name: str) -> None:
        """Take it back."""


class RosAdapter(RemoteAdapter):
    """See robot_interface.Adapter, and `Goals`."""

    def __init__(self, robot: RobotProfile, options: RosOptions, bus: Bus, rca: str) -> None:
        self._options, self._bus = options.resolved(), bus
        options = self._options
        self._navigation = options.navigation or ("move_base" if bus.version == 1 else "nav2")
        super().__init__(
            profile_of(robot, rca, options.watchdog, own=_abilities(options, self._navigation)),
            robot.battery,
        )
        self.must_answer = bus.answers
        self.place, self.vital = bus.place, f"its odometry on {options.odom}"
        self._counter = itertools.count(1)
        self._camera = TopicCamera(options.image) if options.image else None
        self._goal = ""  # the newest, by our name
        self._latest: frozenset[str] = frozenset()  # the goals of which Nav2 told last
        self._seen: frozenset[str] = frozenset()  # those that were there before ours
        self._knew_goals, self._ours = False, ""
        self._stamped = STAMPED[str(options.stamped).lower()] or False
        self._graph: Graph | None = None
        self._silent: set[str] = set()  # topics of which nothing has come yet
        self._heard_by: int | None = None
        self._early_fix: dict[str, Any] | None = None
        self._advertised = False
        self._next_reading: asyncio.Future[None] | None = None

    # --- the connection ---------------------------------------------------------------------------

    async def _open(self) -> None:
        await self._bus.open(self._lose, self)
        bus, options = self._bus, self._options
        self._silent = {need.topic for need in self._needs()}
        self._graph = await bus.graph(options.cmd_vel, ())
        self._heard_by = self._early_fix = None
        self._advertised = False
        self._advertise_velocities()
        for topic, kind in self._said():
            bus.advertise(topic, kind)
        for topic, kind, handler, quality in self._listened():
            if topic:
                bus.subscribe(topic, kind, self._safely(topic, handler), **quality)
        self._run(self._watch_listeners())
        self._run(self._look_round())

    async def _shut(self) -> None:
        await self._bus.shut()

    async def _ask(self) -> None:
        await self._bus.ask()
        if not self._bus.answers and self._gate.usual < OFTEN:
            self._next_reading = asyncio.get_running_loop().create_future()
            await self._next_reading

    def _cut(self) -> None:
        self._bus.cut()

    # --- who else is there ------------------------------------------------------------------------

    def _needs(self) -> list[TopicNeed]:
        names = {
            topic: option
            for option, topic in msgspec.structs.asdict(self._options).items()
            if isinstance(topic, str)
        }
        return [
            TopicNeed(topic, kind, names[topic])
            for topic, kind, _, _ in self._listened()
            if topic and topic in names
        ]

    def _wanted_stamped(self) -> bool:
        told = STAMPED[str(self._options.stamped).lower()]
        return (
            chosen_stamped(self._graph, self._options.cmd_vel, stamped=self._stamped)
            if told is None
            else told
        )

    def _advertise_velocities(self) -> None:
        """Say that velocities will come, as who listens wants them; with `stamped=auto` not before
        somebody does.
        """
        topic, wanted = self._options.cmd_vel, self._wanted_stamped()
        if not self._advertised:
            is_there = (
                self._graph is None
                or self._graph.get(topic, TopicPeers(listeners=0)).listeners != 0
            )
            if not is_there and STAMPED[str(self._options.stamped).lower()] is None:
                return
        elif wanted == self._stamped or self._bus.listeners(topic):
            return
        else:
            self._bus.unadvertise(topic)
        self._stamped, self._advertised = wanted, True
        self._bus.advertise(topic, TWIST_STAMPED if wanted else TWIST, drives=True)

    def _listeners(self) -> int | None:
        return self._bus.listeners(self._options.cmd_vel) if self._advertised else 0

    def _unheard(self) -> str:
        """Say that nobody listens for velocities: of another type they are not heard, and neither
        side is told.
        """
        return (
            nobody_listens(self._graph, self._options.cmd_vel, stamped=self._stamped)
            if self._listeners() == 0
            else ""
        )

    async def _settle(self) -> None:
        deadline = time.monotonic() + LISTENERS
        # A bus tells nobody when it is heard.
        while (  # noqa: ASYNC110
            self._unheard() and not self._failure and time.monotonic() < deadline
        ):
            await asyncio.sleep(LOOKING / 5)

    async def _watch_listeners(self) -> None:
        """Whoever comes to listen is told to stand first; a base that wants
        another type gets it.
        """
        while True:
            now = self._listeners()
            if now and not self._heard_by:
                self._tell_to_stand(time.monotonic())
            self._heard_by = now
            if not self._gate.moving:
                self._advertise_velocities()
            await asyncio.sleep(LOOKING / 5)

    async def _look_round(self) -> None:
        """Say what is missing. Not while the robot moves: a rosbridge takes no velocities
        meanwhile.
        """
        began = time.monotonic()
        due = began
        while True:
            now = time.monotonic()
            if not self._gate.moving and (now >= due or self._unheard()):
                due = now + LOOKING_ROUND
                self._graph = await self._bus.graph(self._options.cmd_vel, sorted(self._silent))
            missing = not_said(self._graph, self._silent_needs()) if now - began > SETTLING else ()
            hangs = self._gate.shut(time.monotonic())
            self.readings.errors = tuple(
                filter(
                    None,
                    (
                        hangs and f"{self.place} {hangs}",
                        master_restarted(self._bus.forgotten),
                        self._unheard(),
                        *missing,
                    ),
                )
            )
            await asyncio.sleep(LOOKING)

    def _silent_needs(self) -> list[TopicNeed]:
        return [need for need in self._needs() if need.topic in self._silent]

    def _why_silent(self) -> str:
        odometry = [need for need in self._needs() if need.topic == self._options.odom]
        return master_restarted(self._bus.forgotten) or next(
            iter(not_said(self._graph, odometry)), ""
        )

    def _said(self) -> list[tuple[str, str]]:
        options = self._options
        topics = [
            (options.initial_pose, "geometry_msgs/PoseWithCovarianceStamped"),
            (options.tilt, "std_msgs/Float64"),
        ]
        if self._navigation == "move_base":
            topics += [
                (f"{options.move_base}/goal", "move_base_msgs/MoveBaseActionGoal"),
                (f"{options.move_base}/cancel", "actionlib_msgs/GoalID"),
            ]
        if self._navigation == "goal_pose":
            topics.append((options.goal_pose, "geometry_msgs/PoseStamped"))
        return [(topic, kind) for topic, kind in topics if topic]

    def _listened(self) -> list[Subscription]:
        options = self._options
        topics: list[Subscription] = [
            (options.odom, "nav_msgs/Odometry", self._odometry, {}),
            (
                options.scan,
                "sensor_msgs/LaserScan",
                self._scan,
                {"sensor": True, "period": SCAN_PERIOD},
            ),
            (options.battery, "sensor_msgs/BatteryState", self._charge, {}),
            (
                options.joint_states if options.tilt_joint else "",
                "sensor_msgs/JointState",
                self._joints,
                {},
            ),
            (
                options.bumper,
                "std_msgs/Bool",
                lambda m: self.readings.bumped(touching=bool(m.get("data"))),
                {},
            ),
            (
                options.image,
                "sensor_msgs/CompressedImage",
                self._picture,
                {"sensor": True, "period": PICTURE_PERIOD},
            ),
            (
                options.estop,
                "std_msgs/Bool",
                lambda m: setattr(self.readings, "estop", bool(m.get("data"))),
                {"latched": True},
            ),
        ]
        return [*topics, *self._localization_listened(), *self._navigation_listened()]

    def _localization_listened(self) -> list[Subscription]:
        options = self._options
        if options.localization == "pose":
            kind = "geometry_msgs/PoseWithCovarianceStamped"
            return [(options.pose, kind, self._fix, {"latched": True})]
        if options.localization == "tf":
            return [(options.tf, "tf2_msgs/TFMessage", self._transforms, {})]
        return []

    def _navigation_listened(self) -> list[Subscription]:
        options = self._options
        if self._navigation == "move_base":
            base = options.move_base
            return [
                (f"{base}/status", "actionlib_msgs/GoalStatusArray", self._goal_states, {}),
                (f"{base}/result", "move_base_msgs/MoveBaseActionResult", self._goal_result, {}),
            ]
        if self._navigation == "goal_pose":
            topic = f"{options.navigate}/_action/status"
            kind = "action_msgs/GoalStatusArray"
            return [(topic, kind, self._nav2_states, {"latched": True})]
        return []

    def _safely(self, topic: str, handler: Handler) -> Handler:
        """What is no such message is logged and as if it had not come: silence is noticed."""

        def handle(message: dict[str, Any]) -> None:
            self._silent.discard(topic)
            try:
                handler(message)
            except messages.RosError as error:
                log.warning("ros_message_refused", extra={"topic": topic, "reason": str(error)})

        return handle

    # --- what it hears ----------------------------------------------------------------------------

    def _odometry(self, message: dict[str, Any]) -> None:
        here, velocity = messages.odometry_in(message)
        arrived = time.time()
        self.readings.moved(
            here, velocity, stamp_of(messages.stamp_in(message, arrived), arrived), time.monotonic()
        )
        if self._early_fix is not None:
            early, self._early_fix = self._early_fix, None
            self._fix(early)
        if self._next_reading is not None and not self._next_reading.done():
            self._next_reading.set_result(None)
        self._heard()

    def _fix(self, message: dict[str, Any]) -> None:
        pose, arrived = messages.fix_in(message), time.time()
        # a latched fix of long ago, before any odometry: once that is there, they are put together
        if self.readings.odometry is None:
            self._early_fix = message
        else:
            self.readings.located(
                pose, stamp_of(messages.stamp_in(message, arrived), arrived), time.monotonic()
            )

    def _transforms(self, message: dict[str, Any]) -> None:
        found = messages.transform_in(message, self._options.map_frame, self._options.odom_frame)
        if found is not None:
            self.readings.corrected(found, time.monotonic())

    def _scan(self, message: dict[str, Any]) -> None:
        arrived = time.time()
        self.readings.scanned(
            messages.scan_in(message, stamp_of(messages.stamp_in(message, arrived), arrived))
        )

    def _charge(self, message: dict[str, Any]) -> None:
        battery = messages.battery_in(message)
        self.readings.charged(
            voltage=battery.voltage, charge=battery.charge, charging=battery.charging
        )

    def _picture(self, message: dict[str, Any]) -> None:
        if self._camera is not None and self._camera.wanted:
            arrived = time.time()
            self._camera.take(
                messages.picture_in(message), stamp_of(messages.stamp_in(message, arrived), arrived)
            )

    def _joints(self, message: dict[str, Any]) -> None:
        angle = messages.joint_in(message, self._options.tilt_joint)
        self.readings.tilt = self.readings.tilt if angle is None else angle

    def video(self) -> VideoSource | None:
        """Return the camera whose pictures are a topic, always the same one, or None."""
        return self._camera

    # --- what it says -----------------------------------------------------------------------------

    def _drive(self, velocity: Velocity) -> None:
        message: dict[str, Any] = messages.twist(velocity)
        if not self._advertised:
            return  # nobody is there to hear it
        if self._stamped:
            message = {
                "header": messages.header("base_link", time.time(), self._bus.version),
                "twist": message,
            }
        self._bus.publish(self._options.cmd_vel, message, newest=True)

    def _turn_head(self, angle: float) -> None:
        self._bus.publish(self._options.tilt, {"data": angle})

    async def _order(self, action: Action) -> PendingAction:
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None:
                self._send_goal(Pose2D(x, y, self._heading(action)))
            case Goto(place=place):
                raise AdapterError(
                    f"{self.profile.series} does not know the place {place!r}: send it to "
                    "a point on its map"
                )
            case Dock():
                await self._trigger(self._options.dock)
            case Undock():
                await self._trigger(self._options.undock)
            case Relocalize(x=x, y=y) if x is not None and y is not None:
                return self._relocalize(action, Pose2D(x, y, action.theta or 0.0))
            case _:
                raise AdapterError(f"{self.profile.series} needs to be given its position: x and y")
        return self._pending(action)

    def _heading(self, goal: Goto) -> float:
        """Return the wanted heading, or the present one: move_base and Nav2 want some."""
        if goal.theta is not None:
            return goal.theta
        return self.readings.pose.theta

    async def _trigger(self, service: str) -> None:
        done, reason = await self._bus.call(service, "std_srvs/Trigger")
        if not done:
            raise AdapterError(f"{service} refused: {reason or 'it does not say why'}")

    def _relocalize(self, action: Relocalize, place: Pose2D) -> PendingAction:
        """Say where the robot is, and wait for its localization to say so too: amcl answers with
        the next scan, and once.
        """
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = TOLD_WITHIN**2
        covariance[35] = (TURNED_WITHIN if action.theta is not None else math.pi) ** 2
        header = messages.header(self._options.map_frame, time.time(), self._bus.version)
        self._bus.publish(
            self._options.initial_pose,
            {"header": header, "pose": {"pose": messages.pose(place), "covariance": covariance}},
        )
        area = ExpectedArea(place.x, place.y, 2.0 * TOLD_WITHIN, action.theta, 3.0 * TURNED_WITHIN)
        now = time.monotonic()
        return PendingAction(
            action.action_id, "relocalize", now, deadline=now + LONGEST_RELOCALIZATION, area=area
        )

    async def _withdraw(self, pending: PendingAction) -> None:
        if pending.kind != "goto":
            if self._options.cancel_dock:
                await self._trigger(self._options.cancel_dock)
        elif self._navigation == "move_base":
            self._bus.publish(
                f"{self._options.move_base}/cancel",
                {"stamp": messages.time_of(0.0, 1), "id": self._goal},
            )
        elif self._navigation == "nav2":
            self._bus.cancel_goal(self._options.navigate, self._goal)
        else:
            here = self.readings.pose
            # the only way to say it on a topic: stay where you are
            self._publish_goal(Pose2D(here.x, here.y, here.theta))

    # --- goals ------------------------------------------------------------------------------------

    def _send_goal(self, place: Pose2D) -> None:
        now, version = time.time(), self._bus.version
        self._goal = f"telepresence-{next(self._counter)}-{now:.3f}"
        target = {
            "header": messages.header(self._options.map_frame, now, version),
            "pose": messages.pose(place),
        }
        if self._navigation == "move_base":
            goal = {
                "goal_id": {"stamp": messages.time_of(now, version), "id": self._goal},
                "goal": {"target_pose": target},
            }
            self._bus.publish(
                f"{self._options.move_base}/goal", {"header": target["header"], **goal}
            )
        elif self._navigation == "nav2":
            self._bus.send_goal(
                self._options.navigate,
                "nav2_msgs/NavigateToPose",
                {"pose": target, "behavior_tree": ""},
                self._goal,
            )
        else:
            self._seen, self._knew_goals, self._ours = self._latest, bool(self._latest), ""
            self._publish_goal(place)

    def _publish_goal(self, place: Pose2D) -> None:
        header = messages.header(self._options.map_frame, time.time(), self._bus.version)
        self._bus.publish(self._options.goal_pose, {"header": header, "pose": messages.pose(place)})

    def _look(self, now: float) -> None:
        pending = self.pending_actions.drive
        if (
            pending is not None
            and pending.kind == "goto"
            and not pending.seen_running
            and now - pending.began > ACCEPTANCE
        ):
            self.pending_actions.end(pending.action_id, "FAILED", "navigation does not answer")

    def accepted(self, goal: str) -> None:
        """Take that the robot works on a goal."""
        if (
            goal == self._goal
            and self.pending_actions.drive is not None
            and self.pending_actions.drive.kind == "goto"
        ):
            self.pending_actions.drive.seen_running = True

    def ended(self, goal: str, status: ActionState, reason: str) -> None:
        """Take that a goal is over."""
        if goal == self._goal:
            self.pending_actions.end_drive(status, reason, "goto")

    def _goal_states(self, message: dict[str, Any]) -> None:
        for entry in message.get("status_list", ()):
            self.accepted(str(entry.get("goal_id", {}).get("id", "")))

    def _goal_result(self, message: dict[str, Any]) -> None:
        status = message.get("status", {})
        self._over(
            str(status.get("goal_id", {}).get("id", "")),
            1,
            status.get("status"),
            str(status.get("text", "")),
        )

    def _nav2_states(self, message: dict[str, Any]) -> None:
        """Of goals on a topic nobody tells which is whose: ours is the one that was not there
        before we sent it.

        When we had not heard of any goals by then, one that has ended already may be an old one,
        and does not count.
        """
        entries = {_uuid(entry): entry.get("status") for entry in message.get("status_list", ())}
        self._latest = frozenset(entries)
        new = {goal: status for goal, status in entries.items() if goal not in self._seen}
        if self.pending_actions.drive is None or self.pending_actions.drive.kind != "goto":
            return
        for goal, status in new.items():
            if status in RUNNING:
                self._ours = goal
            if status in RUNNING or goal == self._ours or self._knew_goals:
                self.accepted(self._goal)
                self._over(self._goal, 2, status, "")

    def _over(self, goal: str, version: int, status: Any, text: str) -> None:
        end = DONE[version].get(status) if isinstance(status, int) else None
        if end is not None:
            self.ended(goal, end, text or ("" if end == "FINISHED" else "navigation gave up"))


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


def _uuid(entry: Mapping[str, Any]) -> str:
    return str(entry.get("goal_info", {}).get("goal_id", {}).get("uuid"))
