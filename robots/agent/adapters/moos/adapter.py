"""The paper's Giraff at its source: the variables of OpenMORA in a MOOSDB.

A variable never changes its type and keeps its last value, which arrives upon registration. Of
values that were published before we registered, only lasting ones count (battery, place), never an
end of navigation.

What OpenMORA does with these variables (its sources, by module and file):
- RobotControlManager/CRobotControllerApp.cpp: NAVIGATE_TARGET, GO_TO_NODE, PARKING 1 and
  MOTION_REQUEST (a zero, too) set the autonomous mode, ROBOT_CONTROL_MODE 2. CANCEL_NAVIGATION
  cancels the navigator and the plans, sets PARKING 0 and publishes ROBOT_CONTROL_MODE 0, each time,
  also when the mode was 0 before. MOTION_REQUEST pauses the navigator, so that its velocities
  cannot pass through the agent.
- A journey that something else cancels, and a docking that AutoDocking_Laser/CDockingApp.cpp gives
  up (PARKING 0), end without an event: only the mode becomes manual, and stays so.
- With `use_client_alive_ack`, it sends CANCEL_NAVIGATION again and again while CLIENT_MQTT_ACK has
  not come for `max_client_ack_interval` seconds (2 as shipped) and the robot is not charging. That
  is the guard: it ends navigation, docking and driving alike when the agent or its link is lost.
- MobileRobot_Giraff/CRobotGiraffApp.cpp: the base obeys MOTION_CMD_V and MOTION_CMD_W in the
  autonomous mode alone, and repeats the last ones for ever; mode 0 stops it. The head's angle is
  published once after TILT_SET_ANGLE_FROM_HOME, before it has turned, and whenever
  TILT_GET_ANGLE_FROM_HOME asks.
- NavigatorReactivePTG/CReacNavPTGApp.cpp and NavigatorReactivePTG3D/CReacNavPTGApp3D.cpp: a journey
  to a point ends with NAV_EVENT_END, ERROR or NOWAY; the second never publishes NAV_EVENT_START.
  Both compute MOTION_CMD_V and MOTION_CMD_W in any mode. The first knows no cancel of the
  RobotControlManager, but its own command.
- Executor/TExecutor.cpp and Planner/HPWA.cpp: a journey to a node, the way to the dock and UNDOCK
  are plans. PLAN_FINISHED "<task> 0|505|1 ROBOT_CONTROLLER" ends them, whether they succeeded or
  not. A plan that starts forgets a cancel that came before, so only PLAN_FINISHED tells that a
  cancelled plan will not start.
"""

import asyncio
import contextlib
import itertools
import math
import time
from collections.abc import Mapping
from typing import Annotated, Any

import structlog
from msgspec import Meta

from robots.agent.adapters.common.pending_actions import Kind, PendingAction
from robots.agent.adapters.common.robot_profile import RobotProfile, load_profile, settings_of
from robots.agent.adapters.moos import openmora
from robots.agent.adapters.moos.client import MoosClient
from robots.agent.adapters.moos.openmora_adapter import OpenMoraAdapter, OpenMoraOptions, is_plan
from robots.agent.adapters.moos.wire import Mail
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Action, Capability, Dock, Goto, Relocalize, Undock, Velocity
from robots.api.reasons import ReasonCode

OWN: tuple[Capability, ...] = ("localization", "goto", "dock", "undock", "relocalize", "tilt")
SUBSCRIBED = (
    *("LOCALIZATION", "BATTERY_V_FLOAT", "BATTERY_IS_CHARGING", "TILT_CURRENT_ANGLE_FROM_HOME"),
    *("BUMPERS", "ERROR_MSG", "NAV_EVENT_START", "NAV_EVENT_END", "NAV_EVENT_ERROR"),
    *("NAV_EVENT_NOWAY", "PLAN_FINISHED", "ROBOT_TOPOLOGICAL_PLACE", "ROBOT_CONTROL_MODE"),
    *("MOTION_CMD_V", "MOTION_CMD_W"),
)
PLANS: dict[Kind, str] = {"goto": "0", "dock": "505", "undock": "1"}  # their number at its end
LANDING = 2.0  # seconds that the place may come after the end of the journey
GIVEN_UP = 5.0  # seconds of manual mode, after which a journey has ended elsewhere
ASKING = 0.3  # seconds between two questions for the head's angle while it turns

log = structlog.stdlib.get_logger(__name__)


class MoosOptions(OpenMoraOptions, frozen=True, kw_only=True):
    """Where the MOOSDB is, and our name there."""

    host: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 9000
    name: str = "telepresence"


def create(profile_name: str, options: Mapping[str, Any]) -> "MoosAdapter":
    """Return an adapter, not connected. Raises AdapterError for a wrong profile or option, or when
    nothing would stop the robot's navigation.
    """
    robot = load_profile(profile_name)
    return MoosAdapter(robot, settings_of(MoosOptions, "moos", robot, options))


class MoosAdapter(OpenMoraAdapter):
    """See robot_interface.Adapter."""

    vital = "LOCALIZATION"
    _options: MoosOptions

    def __init__(self, robot: RobotProfile, options: MoosOptions) -> None:
        super().__init__(robot, options, "moos", "MOOS (OpenMORA)", OWN)
        self.place = f"the MOOSDB at {options.host}:{options.port}"
        self._client: MoosClient | None = None
        self._connected_at = self._asked_at = 0.0
        # when the manual mode was published last, and since when without another mode; monotonic
        self._manual_at, self._manual_since = -math.inf, math.inf
        self._arrived = ""  # the action that has reached its goal
        self._controller = ""  # the name of the RobotControlManager in this mission
        self._voltage: float | None = None
        self._charging: bool | None = None

    async def _open(self) -> None:
        options = self._options
        self._client = MoosClient(options.name, options.host, options.port, self._take, self._lose)
        await self._client.connect()
        self._connected_at = time.time() + self._client.skew
        for key in SUBSCRIBED:
            self._client.register(key)
        self._ask_for_angle(time.monotonic())
        self._run(self._acknowledge())

    async def _cancel_leftovers(self) -> None:
        self._cancel_navigation()

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
            await asyncio.sleep(openmora.ACK_PERIOD)

    # --- what it receives -------------------------------------------------------------------------

    def _take(self, mail: Mail) -> None:
        if mail.key == "ROBOT_CONTROL_MODE":
            self._controller = mail.source
        match mail.key, mail.value:
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
            case "ROBOT_TOPOLOGICAL_PLACE", str(label):
                self._place = label
            case _ if mail.time > self._connected_at:
                self._take_news(mail)

    def _take_news(self, mail: Mail) -> None:
        match mail.key, mail.value:
            case "LOCALIZATION", str(text):
                self._locate(text, mail.time)
            case "ERROR_MSG", str(text):
                self._report_error(text)
            case (("NAV_EVENT_START" | "NAV_EVENT_END" | "NAV_EVENT_ERROR" | "NAV_EVENT_NOWAY"), _):
                self._navigated(mail.key.rpartition("_")[2])
            case "PLAN_FINISHED", str(text):
                self._plan_finished(text.split()[1:3])
            case "ROBOT_CONTROL_MODE", openmora.MANUAL:
                self._manual_at = time.monotonic()
                self._manual_since = min(self._manual_since, self._manual_at)
            case "ROBOT_CONTROL_MODE", _:
                self._manual_since = math.inf
            case (("MOTION_CMD_V" | "MOTION_CMD_W"), float(speed)):
                self._moved_by(mail.source, speed)

    def _locate(self, text: str, stamp: float) -> None:
        try:
            self._located(openmora.pose_of(text), stamp)
        except openmora.DialectError as error:
            log.warning("localization_refused", reason=str(error))
        else:
            self._received()

    def _charge(self) -> None:
        self.readings.charged(voltage=self._voltage, charging=self._charging)

    def _navigated(self, event: str) -> None:
        pending = self.pending_actions.drive
        if pending is None:
            return
        by_plan = is_plan(pending)
        match event:
            case "START":
                pending.seen_running = True
            case "END" if not by_plan:
                pending.over_at = time.monotonic()
            case "ERROR" if not by_plan:  # a plan tries again
                pending.failure = pending.failure or ReasonCode.NAVIGATION_FAILED
            case "NOWAY":
                pending.failure = pending.failure or ReasonCode.NO_WAY

    def _plan_finished(self, plan: list[str]) -> None:
        pending = self.pending_actions.drive
        if pending is not None and plan == [PLANS[pending.kind], "ROBOT_CONTROLLER"]:
            pending.over_at = time.monotonic()

    def _moved_by(self, source: str, speed: float) -> None:
        """Take a velocity of the RobotControlManager, which is ours, or of a navigator: one that
        moves the base without an action of ours started late, or has not stopped.
        """
        if source == self._controller or not self._controller:
            return
        if self.pending_actions.drive is not None:
            self.pending_actions.drive.seen_running = True
        elif speed != 0.0:
            with contextlib.suppress(AdapterError):  # the reader of the connection reports it
                self._cancel_navigation()

    def _look(self, now: float) -> None:
        super()._look(now)
        if self.pending_actions.head is not None and now - self._asked_at > ASKING:
            self._ask_for_angle(now)
        self._watch_journey(now)

    def _watch_journey(self, now: float) -> None:
        pending = self.pending_actions.drive
        if pending is None or pending.failure:
            return
        if pending.first_cancelled_at is not None and pending.action_id != self._arrived:
            return  # the confirmation ends it
        is_goto = pending.kind == "goto"
        if is_goto and pending.over_at < now and self._is_at_goal(pending):
            self._finish(pending, now)
        elif is_goto and now - pending.over_at > LANDING:
            pending.failure = ReasonCode.STOPPED_SHORT
        elif not pending.seen_running and now - pending.began > openmora.SETTING_OUT:
            pending.failure = ReasonCode.DOES_NOT_START
        elif pending.seen_running and self._has_given_up(pending, now):
            pending.failure = ReasonCode.STOPPED_SHORT

    def _has_given_up(self, pending: PendingAction, now: float) -> bool:
        is_docked = pending.kind == "dock" and self.readings.charger_contact
        return not is_docked and now - max(self._manual_since, pending.began) > GIVEN_UP

    def _finish(self, pending: PendingAction, now: float) -> None:
        """Cancel the navigator, which would restart; its confirmed end finishes the action."""
        self._arrived = pending.action_id
        if pending.first_cancelled_at is None:
            pending.first_cancelled_at = now
        self._cancel_navigation()
        if self._has_ended(pending):
            self.pending_actions.end(pending.action_id, "FINISHED")

    # --- what it sends ----------------------------------------------------------------------------

    def _notify(self, key: str, value: float | str) -> None:
        if self._client is None:
            raise AdapterError(f"{self.place} is not connected")
        self._client.notify(key, value)

    def _send_motion(self, velocity: Velocity) -> None:
        self._notify("MOTION_REQUEST", openmora.motion(velocity))

    def _turn_head(self, angle: float) -> None:
        self._notify("TILT_SET_ANGLE_FROM_HOME", self._head_degrees(angle))

    def _ask_for_angle(self, now: float) -> None:
        if self.profile.tilt is not None:
            self._asked_at = now
            self._notify("TILT_GET_ANGLE_FROM_HOME", 1.0)

    async def _send_action(self, action: Action) -> None:
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None:
                self._notify("NAVIGATE_TARGET", openmora.point(x, y))
            case Goto(place=str(place)):
                self._notify("GO_TO_NODE", place)
            case Dock():
                self._notify("GO_TO_RECHARGE", 1.0)
            case Undock():
                self._drive(ZERO)
                self._notify("NEW_TASK", "ROBOT_CONTROLLER 1 UNDOCK")
            case Relocalize(x=x, y=y) if x is not None and y is not None:
                self._notify("RELOCALIZE_IN_AREA", self._area(x, y))

    async def _withdraw(self, pending: PendingAction) -> bool:
        self._cancel_navigation()
        return self._has_ended(pending)

    def _has_ended(self, pending: PendingAction) -> bool:
        """Whether the RobotControlManager has obeyed the cancel and the plan, if any, is over."""
        return (
            pending.first_cancelled_at is not None
            and self._manual_at > pending.first_cancelled_at
            and (not is_plan(pending) or pending.over_at < math.inf)
        )

    def _send_cancel(self) -> None:
        self._notify("CANCEL_NAVIGATION", "telepresence")
        self._notify("PARKING", 0.0)
        self._notify("PNAVIGATORREACTIVEPTG_CMD", "CANCEL")


def _is_set(value: float | str | bytes) -> bool:
    if isinstance(value, str):
        return any(digit in value for digit in "123456789")
    return bool(value) if isinstance(value, float) else any(value)
