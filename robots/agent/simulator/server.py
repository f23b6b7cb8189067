"""The simulated robot as a process: clock, connections, pictures and sound around one `Simulation`.

It is the robot, so it outlives its agent: what stops the wheels when the agent is dead or stuck is
the simulation's own watchdog, which counts from the last velocity that came in here. When the
driver is gone for good, the process ends, but only after the robot stands.
"""

import asyncio
import contextlib
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import structlog

from robots.agent import framing
from robots.agent.simulator import wire
from robots.agent.simulator.microphone import Microphone
from robots.agent.simulator.physics.drive import STILL, WheelMotion
from robots.agent.simulator.physics.realtime import Playback
from robots.agent.simulator.physics.simulation import Simulation, StartError
from robots.agent.simulator.render.frame_ring import FrameWriter
from robots.agent.simulator.render.thread import CameraThread, Renderer
from robots.api.geometry import Pose2D, wrap_angle

STATE_PERIOD = 0.02
SOUND_PERIOD = 0.02
FIRST_DRIVER = 60.0  # seconds that a child waits for its first driver
# bytes unread by a client, after which it misses news instead of costing memory
BACKLOG = 256 << 10

log = structlog.stdlib.get_logger(__name__)


@dataclass(eq=False)
class SimulatorClient:
    """One connection and what it is for."""

    writer: asyncio.StreamWriter
    role: wire.Role | None = None
    missed: int = field(default=0)

    def say(self, message: wire.SimulatorMessage) -> None:
        """Send without waiting; a client that does not read misses it."""
        self.say_bytes(framing.pack(message))

    def say_bytes(self, data: bytes) -> None:
        transport = self.writer.transport
        if transport.is_closing():
            return
        if transport.get_write_buffer_size() > BACKLOG:
            self.missed += 1
            return
        self.writer.write(data)


class Server:
    """Serves one simulation; without `make_renderer` it has no camera.

    `linger` is how many seconds after its last driver the process lives on, None for ever.
    """

    def __init__(
        self,
        simulation: Simulation,
        make_renderer: Callable[[], Renderer] | None,
        *,
        linger: float | None,
        seed: int,
        sonar: bool = False,
    ) -> None:
        self.playback = Playback(simulation, time.monotonic(), time.time())
        self.simulation = simulation
        self._make_renderer = make_renderer
        self._linger = linger
        self._clients: set[SimulatorClient] = set()
        self._ended = asyncio.Event()
        self._alone_since = time.monotonic() + max(0.0, FIRST_DRIVER - (linger or 0.0))
        self._due = dict.fromkeys(("state", "scan", "sonar", "sound"), time.monotonic())
        self._told = -1.0
        self._sonar, self._volley = sonar, 0
        self._rng = np.random.default_rng([seed, 1])
        self._microphone: Microphone | None = None
        self._ring: FrameWriter | None = None
        self._camera: CameraThread | None = None

    async def run(self, host: str, port: int, announce: Callable[[str], None]) -> None:
        """Serve until the end; `announce` gets the address. OSError when it cannot be bound."""
        server = await asyncio.start_server(self._serve, host, port)
        try:
            self._open_camera()
            name, bound = server.sockets[0].getsockname()[:2]
            announce(f"{name}:{bound}")
            await self._tick()
        finally:
            server.close()
            self._close_camera()
            for client in tuple(self._clients):
                client.writer.transport.abort()

    def end(self) -> None:
        self._ended.set()

    def orphaned(self) -> None:
        """Hear that who started this process is dead: no first driver will come any more."""
        self._alone_since = min(self._alone_since, time.monotonic())

    def _open_camera(self) -> None:
        if self._make_renderer is None:
            return
        loop = asyncio.get_running_loop()
        model = self.simulation.model.camera
        self._ring = FrameWriter(model.width, model.height)

        def ready(number: int, stamp: float) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has just ended
                loop.call_soon_threadsafe(self._tell, "camera", wire.FrameReady(number, stamp))

        self._camera = CameraThread(
            self._make_renderer, self._ring, model.fps, lambda: self.playback.view, ready
        )

    def _close_camera(self) -> None:
        if self._camera is not None:
            self._camera.close()
        if self._ring is not None:
            self._ring.close()

    async def _tick(self) -> None:
        due = time.monotonic()
        while not self._ended.is_set():
            now = time.monotonic()
            self.playback.advance(now, time.time())
            self._publish(now)
            if self._is_over(now):
                log.info("driver_gone")
                return
            due = max(due + STATE_PERIOD, now)
            # waiting for the end instead would be a task each time
            await asyncio.sleep(max(0.0, due - time.monotonic()))

    def _publish(self, now: float) -> None:
        if self.simulation.time > self._told and self._is_due("state", STATE_PERIOD, now):
            self._told = self.simulation.time
            self._tell("driver", lambda: self.playback.truth(measured=False))
        if self._is_due("scan", 1.0 / self.simulation.model.laser.rate, now):
            self._tell_scan()
        if self._sonar and self._is_due("sonar", self.simulation.model.sonar.period, now):
            self._volley += 1
            self._tell("driver", self._echoes)
        if self._is_due("sound", SOUND_PERIOD, now):
            self._tell("microphone", self._sound)

    def _is_due(self, what: str, period: float, now: float) -> bool:
        if now < self._due[what]:
            return False
        self._due[what] = max(self._due[what] + period, now - period)
        return True

    def _tell(
        self, role: wire.Role, news: wire.SimulatorMessage | Callable[[], wire.SimulatorMessage]
    ) -> None:
        listeners = [client for client in self._clients if client.role == role]
        if not listeners:
            return
        data = framing.pack(news() if callable(news) else news)
        for client in listeners:
            client.say_bytes(data)

    def _tell_scan(self) -> None:
        if self.simulation.faults.laser != "silent":
            self._tell("driver", self._scan)

    def _scan(self) -> wire.Ranges:
        return wire.Ranges(
            self.playback.stamp(), self.simulation.scan().astype(np.float32).tobytes()
        )

    def _echoes(self) -> wire.Echoes:
        sounding = self.simulation.model.sonar.sounding(self._volley)
        distances = (
            distance if math.isfinite(distance) else None
            for distance in self.simulation.echoes(sounding)
        )
        return wire.Echoes(self.playback.stamp(), tuple(zip(sounding, distances, strict=True)))

    def _sound(self) -> wire.Sound:
        if self._microphone is None:
            self._microphone = Microphone(self._rng)
        motion, limits = self.simulation.motion, self.simulation.model.limits
        effort = max(abs(motion.linear) / limits.linear, abs(motion.angular) / limits.angular)
        return wire.Sound(self._microphone.block(effort).tobytes())

    def _is_over(self, now: float) -> bool:
        if self._linger is None or self._has("driver"):
            return False
        return now - self._alone_since > self._linger and self.simulation.motion == STILL

    def _has(self, role: wire.Role) -> bool:
        return any(client.role == role for client in self._clients)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = SimulatorClient(writer)
        self._clients.add(client)
        try:
            async for body in framing.bodies(reader, wire.COMMAND_LIMIT):
                self._take(client, wire.unpack_command(body))
        except framing.WireError as error:
            log.warning("client_refused", extra={"reason": str(error)})
            client.say(wire.RoleRefused(str(error)))
        except (asyncio.IncompleteReadError, ConnectionError):
            log.debug("client_gone", extra={"role": client.role})
        finally:
            self._leave(client)
            writer.close()

    def _leave(self, client: SimulatorClient) -> None:
        self._clients.discard(client)
        if client.role == "driver" and not self._has("driver"):
            self._alone_since = time.monotonic()
        if client.role == "camera" and self._camera is not None:
            self._camera.watch(watched=self._has("camera"))

    def _take(self, client: SimulatorClient, message: wire.ToSimulator) -> None:
        """Do what a client asks; raises WireError for what is not of its role."""
        self.playback.advance(time.monotonic(), time.time())
        match message:
            case wire.SimulatorHello(role) if client.role is None:
                self._welcome(client, role)
            case wire.AskTruth() if client.role == "observer":
                client.say(self.playback.truth())
            case wire.AskHistory(seconds) if client.role == "observer" and math.isfinite(seconds):
                client.say(wire.History(self.playback.history(seconds)))
            case _ if client.role == "driver":
                self._drive(message)
            case _ if client.role == "operator":
                client.say(self._inject_fault(message))
            case _:
                raise framing.WireError(
                    f"unexpected {type(message).__name__} from {client.role or 'a stranger'}"
                )

    def _drive(self, message: wire.ToSimulator) -> None:
        match message:
            case wire.DriveOrder(linear, angular) if math.isfinite(linear) and math.isfinite(
                angular
            ):
                self.simulation.command(*WheelMotion(linear, angular))
            case wire.TiltTo(angle) if math.isfinite(angle):
                self.simulation.tilt_target = angle
            case wire.SetDoors(doors):
                self.simulation.set_doors(doors)
            case wire.Shutdown():
                self._linger, self._alone_since = 0.0, time.monotonic()
            case _:
                raise framing.WireError(f"unexpected {message!r} from a driver")

    def _inject_fault(self, message: wire.ToSimulator) -> wire.SimulatorMessage:
        match message:
            case wire.SetDoors(doors):
                self.simulation.set_doors(doors)
            case wire.Break(faults):
                self.simulation.faults = faults
            case wire.CarryTo(x, y, theta) if all(map(math.isfinite, (x, y, theta))):
                try:
                    self.simulation.carry_to(Pose2D(x, y, wrap_angle(theta)))
                except StartError as error:
                    return wire.RoleRefused(str(error))
            case _:
                raise framing.WireError(f"unexpected {message!r} from an operator")
        return wire.Done()

    def _welcome(self, client: SimulatorClient, role: wire.Role) -> None:
        if role == "driver":
            for other in [c for c in self._clients if c.role == "driver"]:
                other.role = None  # the newest driver is the agent that lives
                other.writer.transport.abort()
        client.role = role
        client.say(
            wire.SimulatorWelcome(
                self.simulation.model.series, self.simulation.plan.map_id, os.getpid()
            )
        )
        if role == "camera":
            self._show(client)

    def _show(self, client: SimulatorClient) -> None:
        if self._ring is None or self._camera is None:
            raise framing.WireError("this robot was started without a camera")
        model = self.simulation.model.camera
        client.say(
            wire.FrameRingOffer(self._ring.name, self._ring.slots, model.width, model.height)
        )
        self._camera.watch(watched=True)
