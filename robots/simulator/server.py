"""The simulated robot as a process: clock, connections, frames and sound around one `Simulation`.

It is the robot, so it outlives its agent: when the agent is dead or stuck, the simulation's own
watchdog stops the wheels, counting from the last velocity that arrived here. When the driver does
not reconnect, the process ends, but only after the robot is at rest.
"""

import asyncio
import contextlib
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import structlog

from robots.api.geometry import Pose2D, wrap_angle
from robots.process import framing
from robots.simulator import wire
from robots.simulator.microphone import Microphone
from robots.simulator.physics.drive import STILL, WheelMotion
from robots.simulator.physics.realtime import Playback
from robots.simulator.physics.simulation import Simulation, StartError
from robots.simulator.render.frame_ring import FrameWriter
from robots.simulator.render.thread import CameraThread

if TYPE_CHECKING:  # see thread.py
    from robots.simulator.render.camera import SceneCamera

STATE_PERIOD = 0.02
SOUND_PERIOD = 0.02
FIRST_DRIVER = 60.0  # seconds that a child waits for its first driver
BACKLOG = 256 << 10  # bytes that a client has not read, beyond which messages to it are dropped

log = structlog.stdlib.get_logger(__name__)


@dataclass(eq=False)
class SimulatorClient:
    writer: asyncio.StreamWriter
    role: wire.Role | None = None

    def send(self, message: wire.FromSimulator) -> None:
        self.send_bytes(framing.pack(message))

    def send_bytes(self, data: bytes) -> None:
        """Send without waiting; dropped for a client that does not read."""
        transport = self.writer.transport
        if not transport.is_closing() and transport.get_write_buffer_size() <= BACKLOG:
            self.writer.write(data)


class Server:
    """Serves one simulation; without `make_renderer` it has no camera.

    `linger` is how many seconds after its last driver the process lives on, None for ever.
    """

    def __init__(
        self,
        simulation: Simulation,
        make_renderer: "Callable[[], SceneCamera] | None",
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
        self._published = -1.0  # simulated time of the last published state
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
        """Note that the parent process has ended: do not wait for a first driver any longer."""
        self._alone_since = min(self._alone_since, time.monotonic())

    def _open_camera(self) -> None:
        if self._make_renderer is None:
            return
        loop = asyncio.get_running_loop()
        model = self.simulation.model.camera
        self._ring = FrameWriter(model.width, model.height)

        def ready(number: int, stamp: float) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has just ended
                loop.call_soon_threadsafe(self._send, "camera", wire.FrameReady(number, stamp))

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
        sim = self.simulation
        if sim.time > self._published and self._is_due("state", STATE_PERIOD, now):
            self._published = sim.time
            self._send("driver", lambda: self.playback.truth(measured=False))
        scans = self._is_due("scan", 1.0 / sim.model.laser.rate, now)
        if scans and sim.faults.laser != "silent":
            self._send("driver", self._scan)
        if self._sonar and self._is_due("sonar", sim.model.sonar.period, now):
            self._volley += 1
            self._send("driver", self._echoes)
        if self._is_due("sound", SOUND_PERIOD, now):
            self._send("microphone", self._sound)

    def _is_due(self, what: str, period: float, now: float) -> bool:
        if now < self._due[what]:
            return False
        self._due[what] = max(self._due[what] + period, now - period)
        return True

    def _send(
        self, role: wire.Role, message: wire.FromSimulator | Callable[[], wire.FromSimulator]
    ) -> None:
        """Send to all clients of a role a message, or the one that a function makes for them."""
        clients = [client for client in self._clients if client.role == role]
        if clients:
            data = framing.pack(message() if callable(message) else message)
            for client in clients:
                client.send_bytes(data)

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
            log.warning("client_refused", reason=str(error))
            client.send(wire.RoleRefused(str(error)))
        except (asyncio.IncompleteReadError, ConnectionError):
            log.debug("client_gone", role=client.role)
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
        """Handle a client's message; WireError when its role does not allow it."""
        self.playback.advance(time.monotonic(), time.time())
        match message:
            case wire.SimulatorHello(role) if client.role is None:
                self._welcome(client, role)
            case wire.AskTruth() if client.role == "observer":
                client.send(self.playback.truth())
            case wire.AskHistory(seconds) if client.role == "observer" and math.isfinite(seconds):
                client.send(wire.History(self.playback.history(seconds)))
            case _ if client.role == "driver":
                self._drive(message)
            case _ if client.role == "operator":
                client.send(self._inject_fault(message))
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

    def _inject_fault(self, message: wire.ToSimulator) -> wire.FromSimulator:
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
                other.role = None  # the newest driver is the agent that is alive
                other.writer.transport.abort()
        client.role = role
        sim = self.simulation
        client.send(wire.SimulatorWelcome(sim.model.series, sim.plan.map_id, os.getpid()))
        if role != "camera":
            return
        if self._ring is None or self._camera is None:
            raise framing.WireError("this robot was started without a camera")
        size = sim.model.camera.width, sim.model.camera.height
        client.send(wire.FrameRingOffer(self._ring.name, self._ring.slots, *size))
        self._camera.watch(watched=True)
