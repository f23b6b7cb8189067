"""The simulated robot, in a process of its own: started as a child of the agent, or found at an
address.

Options: `plan` (a shipped site or a folder), `seed`, `start`, `charge`, `people` (the number who
walk about), `door-changes` (seconds between random changes of doors), `fps` (images per second),
`linger`, `camera` ("no": without images), `sensors` (for obstacles, some of "laser", "sonar",
"bumper", with commas), or `address` (host:port of a running `python -m robots.simulator`,
whose profile must be the same).
"""

import asyncio
import contextlib
import dataclasses
import math
import subprocess
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from typing import Any

import numpy as np
import structlog

from robots.agent.adapters.common.progress_queue import ProgressQueue
from robots.agent.adapters.common.remote_adapter import check_tilt
from robots.agent.adapters.common.robot_profile import nearest
from robots.agent.adapters.simulator.child import end, launch
from robots.agent.adapters.simulator.media import SimulatorCamera, SimulatorMicrophone
from robots.agent.ramp import ZERO, caps
from robots.agent.robot_interface import (
    NOWHERE,
    ActionProgress,
    ActionRefusedError,
    AdapterError,
    AudioSource,
    Profile,
    RcaState,
    Sonar,
    SonarEcho,
    VideoSource,
)
from robots.api.geometry import Pose2D
from robots.api.messages import Action, Battery, Capability, Config, Laser, Scan, Tilt, Velocity
from robots.api.reasons import ReasonCode
from robots.process import framing
from robots.process.logs import reason_of
from robots.simulator import wire
from robots.simulator.outputs import MeasuringDisplay, MeasuringSpeaker
from robots.simulator.physics.simulation import StartError, start_pose
from robots.world.robot_models import RobotModel, UnknownProfileError, model_of
from robots.world.sites import SiteError, load_plan

NUMBERS: dict[str, tuple[Callable[[Any], float], str]] = {
    "seed": (int, "a whole number"),
    "people": (int, "a whole number"),
    "charge": (float, "a number from 0 to 1"),
    "door-changes": (float, "a number of seconds"),
    "fps": (float, "a number"),
    "linger": (float, "a number of seconds"),
}
OPTIONS = (*NUMBERS, "plan", "start", "camera", "sensors", "address")
SENSORS = ("laser", "sonar", "bumper")
GREETING_TIME = 4.0
SILENCE = 1.0  # s; a state comes 50 times a second
FRESH = 0.25  # s that a state permits another velocity
BACKLOG = 64 << 10
TILT_REACHED = 0.005
LONGEST_TILT = 15.0
BRAKING_TIME = 3.0
NEWEST = 10  # states that wait for a slow reader

log = structlog.stdlib.get_logger(__name__)


def create(profile_name: str, options: Mapping[str, Any]) -> "SimulatorAdapter":
    """Return an adapter, nothing started; AdapterError for a wrong profile, plan or option."""
    unknown = sorted(set(options) - set(OPTIONS))
    if unknown:
        raise AdapterError(
            f"the simulator has no option {unknown[0]}; {nearest(unknown[0], OPTIONS)}"
        )
    for name, (kind, expected) in NUMBERS.items():
        try:
            kind(str(options.get(name, 0)))
        except ValueError as error:
            raise AdapterError(
                f"the simulator's option {name} must be {expected}, not {options[name]!r}"
            ) from error
    try:
        model = model_of(profile_name)
        plan, directory = load_plan(str(options.get("plan", "office")))
    except (UnknownProfileError, SiteError) as error:
        raise AdapterError(str(error)) from error
    has_camera = str(options.get("camera", "yes")) != "no"
    known = {**options, "plan": str(directory)}
    profile = fitted(
        profile_of(model, plan.map_id, has_camera=has_camera), model, _sensors(options)
    )
    start = None  # a robot at an address may be anywhere
    if not options.get("address"):
        try:
            start = start_pose(plan, model, str(options.get("start", "dock")))
        except StartError as error:
            raise AdapterError(str(error)) from error
    profile = dataclasses.replace(profile, plan=str(directory), start=start)
    return SimulatorAdapter(profile, model, known)


def profile_of(model: RobotModel, map_id: str, *, has_camera: bool = True) -> Profile:
    """Return the profile of a simulated robot, which has a laser but no localization."""
    capabilities: list[Capability] = ["velocity", "scan", "audio", "doors"]
    capabilities += ["video"] if has_camera else []
    capabilities += ["tilt"] if model.tilt else []
    mount = model.laser.mount
    return Profile(
        series=model.series,
        rca="simulator",
        capabilities=tuple(capabilities),
        limits=model.limits,
        footprint=model.footprint,
        watchdog=model.watchdog,
        camera=model.camera if has_camera else None,
        tilt=model.tilt,
        laser=Laser(x=mount.x, y=mount.y, theta=mount.theta),
        map_id=map_id,
    )


def fitted(profile: Profile, model: RobotModel, sensors: Collection[str]) -> Profile:
    """Return the profile of a robot that has only these sensors for obstacles."""
    has_laser = "laser" in sensors
    cones = model.sonar
    sonars = tuple(
        Sonar(*mount, cones.width, cones.nearest, cones.farthest)
        for mount in cones.mounts(model.footprint)
    )
    return dataclasses.replace(
        profile,
        capabilities=tuple(name for name in profile.capabilities if name != "scan" or has_laser),
        laser=profile.laser if has_laser else None,
        sonars=sonars if "sonar" in sensors else (),
        bumper="bumper" in sensors,
    )


def _sensors(options: Mapping[str, Any]) -> tuple[str, ...]:
    named = tuple(
        name.strip() for name in str(options.get("sensors", "laser")).split(",") if name.strip()
    )
    unknown = sorted(set(named) - set(SENSORS))
    if unknown:
        raise AdapterError(
            f"the simulator has no sensor {unknown[0]}; {nearest(unknown[0], SENSORS)}"
        )
    return named


@dataclasses.dataclass
class _Tilting:
    action_id: str
    target: float
    deadline: float


class SimulatorAdapter:
    """See robot_interface.Adapter. One task reads, so that no state mixes two messages."""

    def __init__(self, profile: Profile, model: RobotModel, options: Mapping[str, Any]) -> None:
        self.profile = profile
        self._model = model
        self._options = dict(options)
        self._speaker, self._display = MeasuringSpeaker(), MeasuringDisplay()
        self._child: subprocess.Popen[bytes] | None = None
        self._address: tuple[str, int] | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None
        self._failure = "not connected"
        self._states: deque[RcaState] = deque(maxlen=NEWEST)
        self._progress = ProgressQueue()
        self._news = asyncio.Event()
        self._scan: Scan | None = None
        self._echoes: list[SonarEcho] = []
        self._odometry: Pose2D | None = None
        self._distance = 0.0
        self._truth: wire.Truth | None = None
        self._truth_at = -math.inf  # monotonic
        self._sent, self._may_move = ZERO, False
        self._tilting: _Tilting | None = None
        self._doors: dict[str, Any] = {}
        self._camera: SimulatorCamera | None = None
        self._microphone: SimulatorMicrophone | None = None

    @property
    def address(self) -> str:
        """The simulator's `host:port` for observers, "" before the first connection."""
        return "" if self._address is None else f"{self._address[0]}:{self._address[1]}"

    async def connect(self) -> None:
        """Start the simulator or find the running one; raises AdapterError when it is another."""
        await self._drop("reconnecting")
        self._address = await self._find()
        try:
            reader, writer = await self._greet(self._address)
        except AdapterError:
            if self._child is None or self._options.get("address"):
                raise
            child, self._child = self._child, None
            child.kill()  # it is ending, or hangs; start another one
            await asyncio.to_thread(end, child)
            self._address = await self._find()
            reader, writer = await self._greet(self._address)
        self._writer, self._failure = writer, ""
        # an earlier connection may have driven
        writer.write(framing.pack(wire.DriveOrder(0.0, 0.0)))
        writer.write(framing.pack(wire.SetDoors(self._doors)))
        self._reading = asyncio.create_task(self._read(reader))
        log.info("simulator_connected", address=self.address)

    async def _greet(
        self, address: tuple[str, int]
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        try:
            async with asyncio.timeout(GREETING_TIME):
                reader, writer = await asyncio.open_connection(*address)
                writer.write(framing.pack(wire.SimulatorHello("driver")))
                welcome = await wire.read_answer(reader)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, framing.WireError) as error:
            raise AdapterError(
                f"the simulator at {self.address} does not answer: {reason_of(error)}"
            ) from error
        if not isinstance(welcome, wire.SimulatorWelcome) or welcome.series != self.profile.series:
            writer.close()
            raise AdapterError(
                f"the simulator at {self.address} is "
                f"{getattr(welcome, 'series', welcome)!r}, not {self.profile.series!r}"
            )
        return reader, writer

    def apply(self, velocity: Velocity) -> Velocity:
        """Send a velocity within the base's limits; return the last one sent.

        A hung simulator executes its socket's content when it resumes. So each state permits one
        velocity that moves, and when states stop arriving, a zero follows. Raises AdapterError when
        the simulator is lost, or has stopped reading.
        """
        wanted = caps(self.profile.limits, None).clamp(velocity)
        if time.monotonic() - self._truth_at > FRESH:
            wanted = ZERO
        if wanted == ZERO or self._may_move:
            self._say(wire.DriveOrder(wanted.linear, wanted.angular))
            self._sent, self._may_move = wanted, False
        elif self._failure:
            raise AdapterError(self._failure)
        return self._sent

    async def start(self, action: Action) -> None:
        """Tilt the head; errors as in robot_interface.Adapter."""
        if not isinstance(action, Tilt):
            raise ActionRefusedError(ReasonCode.UNSUPPORTED)
        check_tilt(self.profile, action)
        self._say(wire.TiltTo(action.angle))
        self._end_tilt("CANCELLED", ReasonCode.REPLACED)
        self._tilting = _Tilting(action.action_id, action.angle, time.monotonic() + LONGEST_TILT)
        self._progress.put(ActionProgress(action.action_id, "RUNNING"))

    async def cancel(self, action_id: str) -> bool:
        """Stop the head where it is. No action of the simulator's own moves the base."""
        if self._tilting is not None and self._tilting.action_id == action_id:
            if self._truth is not None:
                self._say(wire.TiltTo(self._truth.tilt))
            self._end_tilt("CANCELLED", ReasonCode.CANCELLED)
        return True

    async def states(self) -> AsyncIterator[RcaState]:
        """Yield states, 50 a second; a slow reader misses the oldest. Raises AdapterError when the
        simulator is lost, or silent for a second.
        """
        while len(self._states) > 1:  # of unread states, only the newest counts
            self._states.popleft()
        while True:
            while self._states:
                yield self._states.popleft()
            if self._failure:
                raise AdapterError(self._failure)
            self._news.clear()
            try:
                async with asyncio.timeout(SILENCE):
                    await self._news.wait()
            except TimeoutError as error:
                raise AdapterError("the simulator has stopped sending data") from error

    async def progress(self) -> AsyncIterator[ActionProgress]:
        while True:
            yield await self._progress.get()

    def video(self) -> VideoSource | None:
        if self.profile.camera is None:
            return None
        self._camera = self._camera or SimulatorCamera(lambda: self._address)
        return self._camera

    def audio(self) -> AudioSource | None:
        self._microphone = self._microphone or SimulatorMicrophone(lambda: self._address)
        return self._microphone

    def speaker(self) -> MeasuringSpeaker:
        return self._speaker

    def display(self) -> MeasuringDisplay:
        return self._display

    def configure(self, config: Any) -> None:
        """Open and close the doors that a `Config` names, now or when connected."""
        if not isinstance(config, Config):
            return
        self._doors = dict(config.doors)
        if not self._failure:
            with contextlib.suppress(AdapterError):  # they are sent again on the next connection
                self._say(wire.SetDoors(self._doors))

    async def close(self) -> None:
        """Brake to standstill, and end the simulator if it is ours."""
        for source in (self._camera, self._microphone):
            if source is not None:
                source.stop()
        if not self._failure:
            with contextlib.suppress(AdapterError, TimeoutError):
                await self._stand()
                if self._child is not None:
                    self._say(wire.Shutdown())
        await self._drop("closed")
        if self._child is not None:
            child, self._child = self._child, None
            await asyncio.to_thread(end, child)

    async def _stand(self) -> None:
        async with asyncio.timeout(BRAKING_TIME):
            while not self._failure:
                self._say(wire.DriveOrder(0.0, 0.0))
                truth = self._truth
                if truth is not None and truth.linear == truth.angular == 0.0:
                    return
                await asyncio.sleep(0.02)

    async def _drop(self, why: str) -> None:
        self._failure = why
        self._news.set()
        if self._reading is not None:
            self._reading.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._reading
            self._reading = None
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        self._states.clear()
        self._truth = self._odometry = None
        self._truth_at, self._may_move = -math.inf, False
        self._distance = 0.0
        self._end_tilt("FAILED", ReasonCode.NOT_CONNECTED)

    async def _find(self) -> tuple[str, int]:
        given = self._options.get("address")
        if given:
            return _host_and_port(str(given))
        if self._child is not None and self._child.poll() is None and self._address is not None:
            return self._address
        self._child, line = await asyncio.to_thread(launch, self.profile.series, self._options)
        return _host_and_port(line)

    def _say(self, message: wire.SimulatorMessage) -> None:
        writer = self._writer
        if self._failure or writer is None or writer.transport.is_closing():
            raise AdapterError(self._failure or "the simulator is gone")
        if writer.transport.get_write_buffer_size() > BACKLOG:
            raise AdapterError("the simulator has stopped reading messages")
        writer.write(framing.pack(message))

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            async for body in framing.bodies(reader):
                self._take(wire.unpack_answer(body))
        except (OSError, asyncio.IncompleteReadError, framing.WireError) as error:
            self._failure = f"the simulator is gone: {reason_of(error)}"
            log.warning("simulator_lost", reason=str(error))
        finally:
            self._news.set()

    def _take(self, message: wire.FromSimulator) -> None:
        match message:
            case wire.Truth():
                self._truth, self._truth_at, self._may_move = message, time.monotonic(), True
                self._states.append(self._state(message))
                if self._tilting and abs(message.tilt - self._tilting.target) < TILT_REACHED:
                    self._end_tilt("FINISHED", "")
                elif self._tilting and self._truth_at > self._tilting.deadline:
                    self._end_tilt("FAILED", ReasonCode.NOT_IN_TIME)
                self._news.set()
            case wire.Ranges(stamp, ranges) if self.profile.laser is not None:
                self._scan = self._scan_of(stamp, ranges)
            case wire.Echoes(stamp, echoes) if self.profile.sonars:
                self._echoes += [SonarEcho(index, stamp, distance) for index, distance in echoes]

    def _state(self, truth: wire.Truth) -> RcaState:
        scan, self._scan = self._scan, None
        sonar, self._echoes = tuple(self._echoes), []
        before, odometry = self._odometry, Pose2D(*truth.odometry)
        self._distance += before.distance(odometry) if before is not None else 0.0
        self._odometry = odometry
        return RcaState(
            stamp=truth.stamp,
            pose=NOWHERE,
            velocity=Velocity(linear=truth.linear, angular=truth.angular),
            battery=Battery(charge=truth.charge, voltage=truth.voltage, charging=truth.docked),
            charger_contact=truth.docked,
            tilt=truth.tilt if self.profile.tilt else None,
            contacts=truth.contacts,
            distance=self._distance,
            scan=scan,
            errors=truth.errors,
            odometry=odometry,
            sonar=sonar,
            bumper=truth.bumper if self.profile.bumper else None,
        )

    def _scan_of(self, stamp: float, data: bytes) -> Scan:
        laser = self._model.laser
        found = np.frombuffer(data, dtype=np.float32).astype(np.float64)
        there = np.isfinite(found)
        ranges = tuple(
            value if seen else None
            for value, seen in zip(found.round(3).tolist(), there.tolist(), strict=True)
        )
        return Scan(
            stamp=stamp,
            angle_min=laser.angle_min,
            angle_increment=laser.angle_increment,
            range_max=laser.range_max,
            ranges=ranges,
        )

    def _end_tilt(self, status: Any, reason: str) -> None:
        if self._tilting is not None:
            self._progress.put(ActionProgress(self._tilting.action_id, status, reason))
            self._tilting = None


def _host_and_port(address: str) -> tuple[str, int]:
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise AdapterError(f"the simulator's address must be host:port, not {address!r}")
    return host, int(port)
