"""The paper's Giraff: OpenMORA's MQTTMosquitto module on a broker of its own, with our age limits
in front of it.

Its topics are `<robot>/…`, QoS 0, not retained. What it does (MQTTMosquitto/CMQTTMosquitto.cpp):
- It obeys a `Motion` however late it arrives: on_message compares its time with that of the last
  `ClientACK`, not with the clock. So a velocity that waited here too long is not sent
  (send_slots.py), and none is sent to a broker that has not just acknowledged a `ClientProbe`,
  which is of QoS 1 and which the robot ignores (velocity_gate.py).
- Half a second after the last `Motion` it publishes CANCEL_NAVIGATION, which ends anything. But it
  checks this only when a message arrives, or after a second without one (`loop(-1)`).
- It forwards `ClientACK` to the RobotControlManager, which is the guard (see adapter.py): as
  shipped, it ends navigation and docking two seconds after the last one.
- `StopGiraff` is CANCEL_NAVIGATION. `Debug VARIABLE text` publishes any variable.
- `RobotACK` begins with the count of the last `ClientACK`: what the module has read.

The agent's last will is a `StopGiraff`: when the agent dies, the broker stops the robot.

The angle of the head is sent and never reported: unknown at first, then estimated from the speed in
the profile.

A cancel, and the end of a journey to a place by name, leave the robot in manual mode. The end of
one to a point leaves it autonomous (RobotControlManager/CRobotControllerApp.cpp): it has ended when
the robot no longer moves. The Executor forgets a cancel that arrived before it started a plan, and
MQTT does not report plans: a cancelled plan has ended when the mode has stayed manual for longer
than a plan takes to start. A robot that is autonomous without an action of ours is cancelled again.
"""

import asyncio
import contextlib
import math
import time
from collections.abc import Mapping
from typing import Any

from aiomqtt import Client, MqttError, Will

from robots.agent.adapters.common.pending_actions import PendingAction
from robots.agent.adapters.common.robot_profile import RobotProfile, load_profile, settings_of
from robots.agent.adapters.common.send_slots import SendSlots
from robots.agent.adapters.common.sockets import options as socket_options
from robots.agent.adapters.moos import openmora
from robots.agent.adapters.moos.openmora_adapter import OpenMoraAdapter, OpenMoraOptions, is_plan
from robots.agent.broker_link.mqtt import Endpoint, subscribe
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.messages import Action, Capability, Dock, Goto, Relocalize, Velocity
from robots.api.reasons import ReasonCode
from robots.process.logs import reason_of

OWN: tuple[Capability, ...] = ("localization", "scan", "goto", "dock", "relocalize", "tilt")
SUBSCRIBED = ("Status", "LaserScan", "Topology", "ErrorMsg", "RobotACK")
CONNECTING = 4.0
KEEPALIVE = 5
# seconds after a Motion in which the robot would cancel any new journey with it
MOTION_MEMORY = 0.6
MOTION_ENDS = 2.0  # seconds after the last Motion, after which the robot is in manual mode
PLAN_STARTS = 1.0  # seconds in which a plan starts, and sets the autonomous mode
STAYS = 0.1  # metres that the pose of a robot at rest may vary
STAYED = 1.5  # seconds after which a robot that stays at its goal has ended its journey
LANDING = 5.0  # seconds in which a robot that ended its docking reports that it charges
GIVEN_UP = 20.0  # seconds after which a robot that stays elsewhere has failed


class OpenMoraMqttOptions(OpenMoraOptions, frozen=True, kw_only=True):
    """`broker` is the robot's own broker, `robot` the first part of its topics; `user` is the
    driver in the robot's session log (empty: no log), `range_max` in metres. `nodes` are the places
    besides those of its topology.
    """

    broker: str = "mqtt://127.0.0.1:1883"
    robot: str = "Giraff"
    username: str = ""
    password: str = ""
    user: str = "telepresence"
    range_max: float = 30.0


def create(profile_name: str, options: Mapping[str, Any]) -> "OpenMoraMqttAdapter":
    """Return an adapter, not connected. Raises AdapterError for a wrong profile or option, or when
    nothing would stop the robot's navigation.
    """
    robot = load_profile(profile_name)
    settings = settings_of(OpenMoraMqttOptions, "openmora_mqtt", robot, options)
    try:
        endpoint = Endpoint.of(settings.broker, settings.username, settings.password)
    except ValueError as error:
        raise AdapterError(str(error)) from error
    return OpenMoraMqttAdapter(robot, settings, endpoint)


class OpenMoraMqttAdapter(OpenMoraAdapter):
    """See robot_interface.Adapter."""

    vital = "its Status"
    _options: OpenMoraMqttOptions

    def __init__(
        self, robot: RobotProfile, options: OpenMoraMqttOptions, endpoint: Endpoint
    ) -> None:
        super().__init__(robot, options, "openmora_mqtt", "OpenMORA over MQTT", OWN)
        self.place = f"{options.robot} at {options.broker}"
        self.name = options.robot
        self._endpoint = endpoint
        self._outgoing: SendSlots[tuple[str, str]] = SendSlots()
        self._moved_at = 0.0
        # counts of ClientACK: the last one sent, read by the robot, sent before the first cancel
        self._acks = int(time.time()) % (1 << 31)  # the robot may repeat one of an earlier run
        self._acked = self._acks_before = 0
        self._mode: tuple[bool, float] = (True, -math.inf)  # whether it is autonomous, since when
        self._stood_at, self._stood_since = (math.inf, math.inf), 0.0
        self._robot_ack = "0 0"
        self._head = _Head(robot)
        self._broker: Client | None = None

    # --- the broker -------------------------------------------------------------------------------

    async def _open(self) -> None:
        self._outgoing.clear()
        self._moved_at = time.monotonic()  # an earlier client may have driven just now
        self._mode = True, self._moved_at
        ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._run(self._connection(ready))
        await ready

    async def _connection(self, ready: asyncio.Future[None]) -> None:
        try:
            async with self._client() as client:
                self._broker = client
                await subscribe(client, [f"{self._options.robot}/{name}" for name in SUBSCRIBED])
                if not ready.done():
                    ready.set_result(None)
                self._cancel_navigation()  # what an earlier connection or run has left
                self._say_session("Start")
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._receive(client))
                    tasks.create_task(self._send(client))
                    tasks.create_task(self._acknowledge())
        except* MqttError as errors:
            error = errors.exceptions[0]
            reason = f"{self.place}: {reason_of(error)}"
            if ready.done():
                self._lose(reason)
            else:
                ready.set_exception(AdapterError(reason))

    def _client(self) -> Client:
        stop = openmora.stamped("StopGiraff", time.time())
        return self._endpoint.client(
            keepalive=KEEPALIVE,
            timeout=CONNECTING,
            will=Will(f"{self._options.robot}/NavigationCommand", stop),
            socket_options=socket_options() if self._endpoint.transport == "tcp" else (),
        )

    async def _ask(self) -> None:
        if self._broker is None:
            raise AdapterError(f"{self.place} is not connected")
        try:
            await self._broker.publish(
                f"{self._options.robot}/ClientProbe",
                openmora.stamped("", time.time()),
                qos=1,
                timeout=math.inf,
            )
        except MqttError as error:
            raise AdapterError(f"{self.place}: {reason_of(error)}") from error

    async def _shut(self) -> None:
        self._broker = None
        self._outgoing.clear()

    async def close(self) -> None:
        """Brake, end the session of the robot's logger, and disconnect."""
        if not self._failure:
            self._say_session("Stop")
        await super().close()

    def _say_session(self, word: str) -> None:
        if self._options.user:
            self._say("SessionCommand", f"{word} {self._options.user}")

    async def _receive(self, client: Client) -> None:
        async for delivery in client.messages:
            payload = delivery.payload if isinstance(delivery.payload, bytes) else b""
            # a malformed message counts as missing: silence is detected
            with contextlib.suppress(openmora.DialectError):
                self._take(str(delivery.topic).rpartition("/")[2], *openmora.unstamped(payload))

    async def _send(self, client: Client) -> None:
        # asyncio.wait_for, which `publish` uses, loses a cancellation that arrives as it ends
        # (until Python 3.12).
        while not self._failure:
            topic, text = await self._outgoing.take()
            await client.publish(
                f"{self._options.robot}/{topic}", openmora.stamped(text, time.time()), qos=0
            )

    async def _acknowledge(self) -> None:
        while True:
            self._acks += 1
            ours = f"{self._acks} {openmora.milliseconds(time.time())}"
            self._say("ClientACK", f"{ours}|{self._robot_ack}|0 0")
            await asyncio.sleep(openmora.ACK_PERIOD)

    def _say(self, topic: str, text: str) -> None:
        self._outgoing.say((topic, text))

    def _command(self, text: str) -> None:
        self._say("NavigationCommand", text)

    # --- what it receives -------------------------------------------------------------------------

    def _take(self, topic: str, text: str, sent: float) -> None:
        match topic:
            case "Status":
                self._take_status(openmora.status_of(text), sent)
            case "LaserScan" if "scan" in self.profile.capabilities:
                stamp = self.readings.believed("scan", sent, time.time())
                self.readings.scanned(openmora.scan_of(text, stamp, self._options.range_max))
            case "Topology":
                self._nodes |= openmora.nodes_of(text)
            case "ErrorMsg":
                self._report_error(text)
            case "RobotACK":
                ours, _, robot = text.partition("|")
                self._robot_ack = robot.partition("|")[0] or "0 0"
                count = ours.partition(" ")[0]
                self._acked = int(count) if count.isdecimal() else 0

    def _take_status(self, status: openmora.OpenMoraStatus, stamp: float) -> None:
        now = time.monotonic()
        self._place = status.place
        self._located(status.pose, stamp)
        self.readings.charged(voltage=status.voltage, charging=status.charging)
        if status.autonomous != self._mode[0]:
            self._mode = status.autonomous, now
        self._watch_journey(status, now)
        is_ours = self.pending_actions.drive is not None or now - self._moved_at < MOTION_ENDS
        if status.autonomous and not is_ours:
            self._cancel_navigation()  # a late start, or left by an earlier run of the agent
        self._received()

    def _watch_journey(self, status: openmora.OpenMoraStatus, now: float) -> None:
        """Determine from mode and place when a journey ends, and whether at its goal."""
        pending = self.pending_actions.drive
        if pending is None or not pending.accepted or pending.failure:
            return
        if pending.over_at < math.inf:
            if not status.autonomous:
                self.pending_actions.end(pending.action_id, "FINISHED")
            else:  # the navigator would restart if the robot were moved
                self._cancel_navigation()
            return
        if pending.first_cancelled_at is not None:
            return  # the confirmation ends it
        pending.seen_running |= status.autonomous
        if not pending.seen_running and now - pending.began > openmora.SETTING_OUT:
            pending.failure = ReasonCode.DOES_NOT_START
        elif pending.kind == "dock":
            is_at_rest = pending.seen_running and not status.autonomous
            if is_at_rest and not self.readings.charger_contact and now - self._mode[1] > LANDING:
                self.pending_actions.end_drive("FAILED", ReasonCode.STOPPED_SHORT)
        else:
            self._watch_goto(pending, status, now)

    def _watch_goto(
        self, pending: PendingAction, status: openmora.OpenMoraStatus, now: float
    ) -> None:
        stays = now - max(self._stays_since(status, now), pending.began)
        if self._is_at_goal(pending):
            if stays > STAYED and (pending.goal is not None or not status.autonomous):
                pending.over_at = now
        elif pending.seen_running and not status.autonomous:
            self.pending_actions.end_drive("FAILED", ReasonCode.STOPPED_SHORT)
        elif stays > GIVEN_UP:
            pending.failure = ReasonCode.NOT_IN_TIME

    def _stays_since(self, status: openmora.OpenMoraStatus, now: float) -> float:
        """Return since when the robot has not moved, monotonic seconds."""
        pose = status.pose
        if pose is not None and math.dist((pose.x, pose.y), self._stood_at) > STAYS:
            self._stood_at, self._stood_since = (pose.x, pose.y), now
        return self._stood_since

    def _look(self, now: float) -> None:
        super()._look(now)
        self.readings.tilt = self._head.angle(now)

    # --- what it sends ----------------------------------------------------------------------------

    def _send_motion(self, velocity: Velocity) -> None:
        self._outgoing.drive(("NavigationCommand", f"Motion {openmora.motion(velocity)}"))
        self._moved_at = time.monotonic()

    def _turn_head(self, angle: float) -> None:
        self._command(f"Tilt {self._head_degrees(angle):.1f}")
        self._head.turn_to(angle, time.monotonic())

    async def _send_action(self, action: Action) -> None:
        # Half a second after a Motion, the robot cancels it, and any journey with it.
        await asyncio.sleep(max(0.0, self._moved_at + MOTION_MEMORY - time.monotonic()))
        owned = self.pending_actions.of(action.action_id)
        if not isinstance(action, Relocalize) and (not owned or owned.first_cancelled_at):
            raise ActionRefusedError(ReasonCode.CANCELLED)
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None:
                self._command(f"GoToPoint {x:.3f} {y:.3f}")
            case Goto(place=str(place)):
                self._command(f"GoToNode {place}")
            case Dock():
                self._command("GoToRecharge")
            case Relocalize(x=x, y=y) if x is not None and y is not None:
                # forwarded to RELOCALIZE_IN_AREA as it is (MQTTMosquitto/CMQTTMosquitto.cpp,
                # on_message)
                self._command(f"Relocalize {self._area(x, y)}")

    async def _withdraw(self, pending: PendingAction) -> bool:
        """See RemoteAdapter: confirmed by the manual mode, after the robot has read the cancel."""
        if pending.first_cancelled_at == pending.cancelled_at:
            self._acks_before = self._acks
        self._cancel_navigation()
        autonomous, since = self._mode
        since = max(since, pending.first_cancelled_at or math.inf)
        settled = time.monotonic() - since > (PLAN_STARTS if is_plan(pending) else 0.0)
        return self._acks_before < self._acked <= self._acks and not autonomous and settled

    def _send_cancel(self) -> None:
        self._command("StopGiraff")
        self._say("Debug", "PNAVIGATORREACTIVEPTG_CMD CANCEL")


class _Head:
    """Where the head should be by now; unknown before the first order."""

    def __init__(self, robot: RobotProfile) -> None:
        self._speed = robot.tilt.speed if robot.tilt else 1.0
        self._reach = robot.tilt.maximum - robot.tilt.minimum if robot.tilt else 0.0
        self._from: float | None = None
        self._to: float | None = None
        self._since = 0.0

    def turn_to(self, angle: float, now: float) -> None:
        self._from, self._to, self._since = self.angle(now), angle, now

    def angle(self, now: float) -> float | None:
        """Return the assumed angle in radians; None while it turns from an unknown one."""
        if self._to is None:
            return None
        turned = self._speed * (now - self._since)
        if self._from is None:
            return self._to if turned >= self._reach else None
        return self._from + min(max(self._to - self._from, -turned), turned)
