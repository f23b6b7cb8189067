"""The paper's Giraff at its source: the variables of OpenMORA in a MOOSDB.

A variable never changes its type and keeps its last value, which comes when we register: of what was said before we came, only what
stays true counts (battery, place), never an end of navigation.
"""

import contextlib
import logging
import time
from collections.abc import Mapping
from typing import Any

from msgspec import Struct

from robots.agent.adapters import openmora
from robots.agent.adapters.contract import AdapterError
from robots.agent.adapters.errands import Errand
from robots.agent.adapters.moos_client import MoosClient
from robots.agent.adapters.moos_wire import Mail
from robots.agent.adapters.readings import stamp_of
from robots.agent.adapters.remote import RemoteAdapter, profile_of
from robots.agent.adapters.robot_profile import RobotProfile, load_profile, settings_of
from robots.api.messages import Action, Capability, Dock, Goto, Relocalize, Undock, Velocity

OWN: tuple[Capability, ...] = ("localization", "goto", "dock", "undock", "relocalize", "tilt")
HEARD = (
    "LOCALIZATION", "BATTERY_V_FLOAT", "BATTERY_IS_CHARGING", "TILT_CURRENT_ANGLE_FROM_HOME", "BUMPERS", "ERROR_MSG",
    "NAV_EVENT_START", "NAV_EVENT_END", "NAV_EVENT_ERROR", "NAV_EVENT_NOWAY",
)  # fmt: skip
SETTING_OUT = 5.0
ERROR_SHOWN = 10.0

log = logging.getLogger(__name__)


class Options(Struct, frozen=True):
    """Where the MOOSDB is, and who we are to it; `tilt_sign` -1 where the head counts upwards, `nodes` places by name, by comma."""

    host: str = "127.0.0.1"
    port: int = 9000
    name: str = "telepresence"
    watchdog: float = 0.5
    tilt_sign: float = 1.0
    nodes: str = ""


def create(profile_name: str, options: Mapping[str, Any]) -> "MoosAdapter":
    """Return an adapter for a robot of OpenMORA; nothing is connected yet.

    Raises:
        AdapterError: no such profile or option; one sentence.
    """
    robot = load_profile(profile_name)
    return MoosAdapter(robot, settings_of(Options, "moos", robot, options))


class MoosAdapter(RemoteAdapter):
    """See contract.Adapter."""

    vital = "LOCALIZATION"

    def __init__(self, robot: RobotProfile, options: Options) -> None:
        super().__init__(profile_of(robot, "MOOS (OpenMORA)", options.watchdog, own=OWN), robot.battery)
        self.place = f"the MOOSDB at {options.host}:{options.port}"
        self._robot, self._options = robot, options
        self._client: MoosClient | None = None
        self._nodes = openmora.listed_nodes(options.nodes)
        self._connected_at = self._error_at = 0.0
        self._voltage: float | None = None
        self._charging = False

    async def _open(self) -> None:
        options = self._options
        self._client = MoosClient(options.name, options.host, options.port, self._take, self._lose)
        self._connected_at = time.time()
        await self._client.connect()
        for key in HEARD:
            self._client.register(key)

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

    # --- what it hears ---------------------------------------------------------------------------------------------------

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
            case (("NAV_EVENT_START" | "NAV_EVENT_END" | "NAV_EVENT_ERROR" | "NAV_EVENT_NOWAY"), _) if is_news:
                self._navigated(mail.key.rpartition("_")[2])

    def _locate(self, text: str, said: float) -> None:
        try:
            pose = openmora.pose_of(text)
        except openmora.DialectError as error:
            log.warning("localization_refused", extra={"reason": str(error)})
            return
        now = time.monotonic()
        if pose is None:
            self.readings.lost()
            self.readings.heard_at = now
        else:
            self.readings.located(pose, stamp_of(said, time.time()), now)
        self._heard()

    def _charge(self) -> None:
        self.readings.charged(voltage=self._voltage, charging=self._charging)

    def _navigated(self, event: str) -> None:
        match event:
            case "START" if self.errands.drive is not None:
                self.errands.drive.seen_running = True
            case "END":
                self.errands.end_drive("FINISHED", "", "goto")
            case "ERROR":
                self.errands.end_drive("FAILED", "navigation failed")
            case "NOWAY":
                self.errands.end_drive("FAILED", "there is no way")

    def _look(self, now: float) -> None:
        if self.readings.errors and now - self._error_at > ERROR_SHOWN:
            self.readings.errors = ()
        errand = self.errands.drive
        if errand is not None and errand.kind == "goto" and not errand.seen_running and now - errand.began > SETTING_OUT:
            self.errands.end(errand.action_id, "FAILED", "the robot does not set out")

    # --- what it says ----------------------------------------------------------------------------------------------------

    def _notify(self, key: str, value: float | str) -> None:
        if self._client is None:
            raise AdapterError(f"{self.place} is not connected")
        self._client.notify(key, value)

    def _drive(self, velocity: Velocity) -> None:
        self._notify("MOTION_REQUEST", openmora.motion(velocity))

    def _turn_head(self, angle: float) -> None:
        self._notify("TILT_SET_ANGLE_FROM_HOME", openmora.head_degrees(angle, self._robot, self._options.tilt_sign))

    async def _order(self, action: Action) -> Errand | None:
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None:
                self._notify("NAVIGATE_TARGET", openmora.point(x, y))
            case Goto(place=str(place)) if place in self._nodes:
                self._notify("GO_TO_NODE", place)
            case Goto(place=place):
                raise AdapterError(f"this robot knows no place {place!r}; it knows {', '.join(sorted(self._nodes)) or 'none by name'}")
            case Dock():
                self._notify("GO_TO_RECHARGE", 1.0)
            case Undock():
                self._notify("NEW_TASK", "ROBOT_CONTROLLER 1 UNDOCK")
            case Relocalize(x=x, y=y) if x is not None and y is not None:
                self._notify("RELOCALIZE_IN_AREA", f"{x:.3f} {y:.3f}")
                return None
            case _:
                raise AdapterError("this robot has to be told where it is")
        return self._errand(action)

    async def _withdraw(self, errand: Errand) -> None:
        if errand.kind == "dock":
            self._notify("PARKING", 0.0)
        with contextlib.suppress(AdapterError):
            self._notify("CANCEL_NAVIGATION", "telepresence")


def _is_set(value: float | str | bytes) -> bool:
    if isinstance(value, str):
        return any(digit in value for digit in "123456789")
    return bool(value) if isinstance(value, float) else any(value)
