"""The paper's Giraff at its source: the variables of OpenMORA in a MOOSDB.

A variable never changes its type and keeps its last value, which comes when we register: of what
was said before we came, only what stays true counts (battery, place), never an end of navigation.

What OpenMORA does with these variables (its sources, by module and file):
- A journey to a point ends with NAV_EVENT_END, ERROR or NOWAY
  (NavigatorReactivePTG/CReacNavPTGApp.cpp). One to a node is a plan of several such journeys, tried
  again after an ERROR, and ends with PLAN_FINISHED "task 0 ROBOT_CONTROLLER" whether it got there
  or not (Executor/TExecutor.cpp, Planner/HPWA.cpp, RobotControlManager/CRobotControllerApp.cpp):
  the place tells.
- The head's angle is said once after TILT_SET_ANGLE_FROM_HOME, before it has turned, and whenever
  TILT_GET_ANGLE_FROM_HOME asks.
- UNDOCK sets MOTION_CMD_V, which the base obeys in autonomous mode alone
  (MobileRobot_Giraff/CRobotGiraffApp.cpp); docking ends in manual mode. A MOTION_REQUEST, of zero
  too, makes it autonomous.
- With `use_client_alive_ack`, as shipped, a robot out of its dock is stopped again and again while
  CLIENT_MQTT_ACK has not come for two seconds (RobotControlManager/CRobotControllerApp.cpp,
  Iterate). So it has to come from us; when we are dead, that stops the base.
"""

import asyncio
import contextlib
import itertools
import math
import time
from collections.abc import Mapping
from typing import Annotated, Any

import structlog
from msgspec import Meta, Struct

from robots.agent.adapters.common.pending_actions import PendingAction
from robots.agent.adapters.common.remote_adapter import RemoteAdapter, profile_of
from robots.agent.adapters.common.robot_profile import RobotProfile, load_profile, settings_of
from robots.agent.adapters.common.state_builder import stamp_of
from robots.agent.adapters.moos import openmora
from robots.agent.adapters.moos.client import MoosClient
from robots.agent.adapters.moos.wire import Mail
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Action, Capability, Dock, Goto, Relocalize, Undock, Velocity

OWN: tuple[Capability, ...] = ("localization", "goto", "dock", "undock", "relocalize", "tilt")
HEARD = (
    "LOCALIZATION",
    "BATTERY_V_FLOAT",
    "BATTERY_IS_CHARGING",
    "TILT_CURRENT_ANGLE_FROM_HOME",
    "BUMPERS",
    "ERROR_MSG",
    "NAV_EVENT_START",
    "NAV_EVENT_END",
    "NAV_EVENT_ERROR",
    "NAV_EVENT_NOWAY",
    "PLAN_FINISHED",
    "ROBOT_TOPOLOGICAL_PLACE",
)
SETTING_OUT = 5.0
OURS = ["0", "ROBOT_CONTROLLER"]  # of PLAN_FINISHED: the journey to a node
# metres from its goal at which a robot that ended its journey has reached it: OpenMORA allows
# itself 0.4
ARRIVED = 0.6
LANDING = 2.0  # seconds that the place may come after the end of the journey
ACK_PERIOD = 0.5  # seconds
ASKING = 0.3  # seconds between two questions for the head's angle while it turns
ERROR_SHOWN = 10.0

log = structlog.stdlib.get_logger(__name__)


class MoosOptions(Struct, frozen=True, kw_only=True):
    """Where the MOOSDB is, and who we are to it; `tilt_sign` -1 where the head counts upwards,
    `nodes` places by name, by comma.

    Told where it is, the robot looks for itself in a square that reaches `relocalize_half_width`
    metres either way, with so many `relocalize_particles`. The first should be what the robot's own
    X_MIN … Y_MAX say, the second is what OpenMORA takes when lost.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 9000
    name: str = "telepresence"
    watchdog: float
    tilt_sign: float = 1.0
    nodes: str = ""
    relocalize_half_width: float = 1.0
    relocalize_particles: int = 20000


def create(profile_name: str, options: Mapping[str, Any]) -> "MoosAdapter":
    """Return an adapter for a robot of OpenMORA; nothing is connected yet.

    Raises:
        AdapterError: no such profile or option; one sentence.
    """
    robot = load_profile(profile_name)
    return MoosAdapter(robot, settings_of(MoosOptions, "moos", robot, options))


class MoosAdapter(RemoteAdapter):
    """See robot_interface.Adapter."""

    vital = "LOCALIZATION"

    def __init__(self, robot: RobotProfile, options: MoosOptions) -> None:
        super().__init__(
            profile_of(robot, "MOOS (OpenMORA)", options.watchdog, own=OWN), robot.battery
        )
        self.place = f"the MOOSDB at {options.host}:{options.port}"
        self._robot, self._options = robot, options
        self._client: MoosClient | None = None
        self._nodes = openmora.listed_nodes(options.nodes)
        self._connected_at = self._error_at = self._asked_at = 0.0
        self._place = ""
        self._voltage: float | None = None
        self._charging: bool | None = None

    async def _open(self) -> None:
        options = self._options
        self._client = MoosClient(options.name, options.host, options.port, self._take, self._lose)
        self._connected_at = time.time()
        await self._client.connect()
        for key in HEARD:
            self._client.register(key)
        self._ask_for_angle(time.monotonic())
        self._run(self._acknowledge())

    async def _ask(self) -> None:
        if self._client is None:
            raise AdapterError(f"{self.place} is not connected")
        await self._client.ask()

    def _cut(self) -> None:
        if self._client is not None:
            self._client.abort()

    async def _shut(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            await client.close()

    async def _acknowledge(self) -> None:
        for count in itertools.count(1):
            self._notify("CLIENT_MQTT_ACK", f"{count} {openmora.milliseconds(time.time())}|0 0|0 0")
            await asyncio.sleep(ACK_PERIOD)

    # --- what it hears ----------------------------------------------------------------------------

    def _take(self, mail: Mail) -> None:
        is_news = mail.time > self._connected_at
        match mail.key, mail.value:
            case "LOCALIZATION", str(text) if is_news:
                self._locate(text, mail.time)
            case "BATTERY_V_FLOAT", float(volts):
                self._voltage = volts
                self._charge()
            case "BATTERY_IS_CHARGING", float(share):
                self._charging = share >= 1.0
                self._charge()
            case "TILT_CURRENT_ANGLE_FROM_HOME", float(degrees):
                self.readings.tilt = openmora.tilt_of(degrees, self._robot, self._options.tilt_sign)
            case "BUMPERS", value:
                self.readings.bumped(touching=_is_set(value))
            case "ERROR_MSG", str(text) if is_news:
                self.readings.errors, self._error_at = (text,), time.monotonic()
            case (
                ("NAV_EVENT_START" | "NAV_EVENT_END" | "NAV_EVENT_ERROR" | "NAV_EVENT_NOWAY"),
                _,
            ) if is_news:
                self._navigated(mail.key.rpartition("_")[2])
            case "PLAN_FINISHED", str(text) if is_news and text.split()[1:3] == OURS:
                self._over(named=True)
            case "ROBOT_TOPOLOGICAL_PLACE", str(label):
                self._place = label

    def _locate(self, text: str, said: float) -> None:
        try:
            pose = openmora.pose_of(text)
        except openmora.DialectError as error:
            log.warning("localization_refused", extra={"reason": str(error)})
            return
        now = time.monotonic()
        if pose is None:
            self.readings.lost(now)
            self.readings.last_received_at = now
        else:
            self.readings.located(pose, stamp_of(said, time.time()), now)
        self._heard()

    def _charge(self) -> None:
        self.readings.charged(voltage=self._voltage, charging=self._charging)

    def _navigated(self, event: str) -> None:
        pending = self.pending_actions.drive
        if pending is None:
            return
        by_plan = pending.kind == "dock" or bool(pending.place)
        match event:
            case "START":
                pending.seen_running = True
            case "END":
                self._over(named=False)
            case "ERROR" if not by_plan:  # a plan tries again
                self._give_up("navigation failed")
            case "NOWAY":
                self._give_up("there is no route to the goal")

    def _give_up(self, reason: str) -> None:
        """Say that a journey has failed, and see to it that the robot does not go on with it."""
        self._cancel_navigation()
        self.pending_actions.end_drive("FAILED", reason)

    def _over(self, *, named: bool) -> None:
        """Take that a journey to a point, or to a node, has ended; where, tells the place."""
        pending = self.pending_actions.drive
        if pending is not None and pending.kind == "goto" and bool(pending.place) == named:
            pending.over_at = time.monotonic()

    def _look(self, now: float) -> None:
        if self.readings.errors and now - self._error_at > ERROR_SHOWN:
            self.readings.errors = ()
        if self.pending_actions.head is not None and now - self._asked_at > ASKING:
            self._ask_for_angle(now)
        self._watch_journey(now)

    def _watch_journey(self, now: float) -> None:
        pending = self.pending_actions.drive
        if pending is None or pending.kind != "goto":
            return
        if pending.over_at < now and self._is_there(pending):
            self.pending_actions.end(pending.action_id, "FINISHED")
        elif now - pending.over_at > LANDING:
            self.pending_actions.end(
                pending.action_id, "FAILED", "the robot stopped before it arrived"
            )
        elif (
            pending.over_at > now and not pending.seen_running and now - pending.began > SETTING_OUT
        ):
            self._give_up("the robot does not start moving")

    def _is_there(self, pending: PendingAction) -> bool:
        if pending.goal is None:
            return self._place == pending.place
        pose = self.readings.pose
        return (
            pose.localized
            and math.hypot(pose.x - pending.goal[0], pose.y - pending.goal[1]) < ARRIVED
        )

    # --- what it says -----------------------------------------------------------------------------

    def _notify(self, key: str, value: float | str) -> None:
        if self._client is None:
            raise AdapterError(f"{self.place} is not connected")
        self._client.notify(key, value)

    def _drive(self, velocity: Velocity) -> None:
        self._notify("MOTION_REQUEST", openmora.motion(velocity))

    def _turn_head(self, angle: float) -> None:
        self._notify(
            "TILT_SET_ANGLE_FROM_HOME",
            openmora.head_degrees(angle, self._robot, self._options.tilt_sign),
        )

    def _ask_for_angle(self, now: float) -> None:
        if self.profile.tilt is not None:
            self._asked_at = now
            self._notify("TILT_GET_ANGLE_FROM_HOME", 1.0)

    async def _order(self, action: Action) -> PendingAction:
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None:
                self._notify("NAVIGATE_TARGET", openmora.point(x, y))
            case Goto(place=str(place)) if place in self._nodes:
                self._notify("GO_TO_NODE", place)
            case Goto(place=place):
                raise AdapterError(
                    f"this robot does not know the place {place!r}; it knows "
                    f"{', '.join(sorted(self._nodes)) or 'none by name'}"
                )
            case Dock():
                self._notify("GO_TO_RECHARGE", 1.0)
            case Undock():
                self._drive(ZERO)
                self._notify("NEW_TASK", "ROBOT_CONTROLLER 1 UNDOCK")
            case Relocalize(x=x, y=y) if x is not None and y is not None:
                options = self._options
                self._notify(
                    "RELOCALIZE_IN_AREA",
                    openmora.area(
                        x, y, options.relocalize_half_width, options.relocalize_particles
                    ),
                )
                return openmora.search(
                    action.action_id, x, y, options.relocalize_half_width, time.monotonic()
                )
            case _:
                raise AdapterError("this robot needs to be given its position: x and y")
        return self._pending(action)

    async def _withdraw(self, pending: PendingAction) -> None:
        if pending.kind == "dock":
            self._notify("PARKING", 0.0)
        self._cancel_navigation()

    def _cancel_navigation(self) -> None:
        with contextlib.suppress(AdapterError):
            self._notify("CANCEL_NAVIGATION", "telepresence")


def _is_set(value: float | str | bytes) -> bool:
    if isinstance(value, str):
        return any(digit in value for digit in "123456789")
    return bool(value) if isinstance(value, float) else any(value)
