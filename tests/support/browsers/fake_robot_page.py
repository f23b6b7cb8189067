"""The drive page alone: a server and a robot in one thread, without database, broker or agent
processes.

The page, the safety kernel, the media side and the simulated robot are the real ones; what stands
between them is a few lines here, so that a test can cut, mute and end things at will.
"""

import asyncio
import collections
import contextlib
import http
import json
import math
import mimetypes
import secrets
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Self
from urllib.parse import urlsplit

import msgspec
from django.template.loader import render_to_string
from django.utils import translation
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from robots.agent.media import MediaSide
from robots.agent.media.webrtc.packet_gate import ReceivedPacket
from robots.agent.safety.kernel import Kernel
from robots.agent.safety.permissions import CommandSender
from robots.agent.simulator.physics.simulation import Simulation
from robots.api import codec, floorplan, picture
from robots.api import messages as m
from robots.api.errors import Rejection
from robots.world.robot_models import model_of
from sessions import protocol
from tests.support.collected import collected_files
from tests.support.media.scene_source import SceneSource
from tests.support.media.synthetic_camera import SyntheticCamera
from tests.support.paths import ROOT
from tests.support.patience import patient

OFFICE = ROOT / "robots/world/plans/office"
ROBOT = "giraff"
STEP = "/study/step/"  # where a study goes on
PRACTICE = "/practice/robot/"
TICK = 0.02
SUFFIXES = {
    m.VelocityCommand: "command/velocity",
    m.CommandHeartbeat: "command/heartbeat",
    m.PointCommand: "command/point",
}
RENEWAL, STATUS = 500, 50  # ticks
FPS = 6.0  # of the robot's camera: what a computer without a graphics card plays beside other tests
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; media-src"
    " 'self' blob:; connect-src 'self'; object-src 'none'"
)


class FakeRobotPage:
    """Serves one robot's drive page at `url` and is that robot.

    `heard` holds what the pages said: (page number, way, suffix, message). `applied` the accepted
    velocity commands.
    """

    def __init__(
        self,
        camera: Any = None,
        *,
        start: str = "lab-before-door",
        study: dict[str, Any] | None = None,
    ) -> None:
        self.plan = floorplan.decode((OFFICE / "plan.json").read_bytes())
        model = model_of("giraff")
        self.simulation = Simulation(model, self.plan, seed=1, start=start)
        self.limits = model.limits
        self.kernel = Kernel(model.limits, 0.3, frozenset({"velocity", "video"}))
        self.model = model
        self.factsheet: dict[str, Any] = {
            "name": ROBOT,
            "limits": self.limits,
            "footprint": model.footprint,
            "camera": model.camera,
        }
        self.factsheet |= {
            "tilt": model.tilt,
            "laser": m.Laser(x=model.laser.x),
            "series": "Giraff",
            "capabilities": ("velocity", "video"),
        }
        self.camera = camera or SyntheticCamera(fps=FPS)
        if isinstance(self.camera, SceneSource):
            self.camera.simulation = self.simulation
        self.media = MediaSide(
            video=self.camera, audio=None, viewers=4, on_command=self._on_channel, reply=self._reply
        )
        self.heard: list[tuple[int, str, str, Any]] = []
        self.applied: list[tuple[str, m.VelocityCommand]] = []
        self.study = study  # what experiments.participation.drive_config tells a page
        self.terms: protocol.GrantedTerms | None = None
        # action id to JPEG: what the server has of what was photographed
        self.photos: dict[str, bytes] = {}
        # where to practise, as the server says it; PRACTICE is a page for it
        self.practice: dict[str, Any] | None = None
        # what the landing page's list says of other robots
        self.others: list[dict[str, Any]] = []
        self.reason = ""  # why those who wait cannot have the robot
        self.operates = False  # whether whoever looks operates the robot
        self.still: bytes | None = None  # the JPEG that comes through the server
        self.battery = m.Battery(charge=0.82)
        self.errors: tuple[str, ...] = ()
        self.refused: collections.Counter[str] = collections.Counter()  # of the whole test
        self.online = True
        self.may_drive = True
        self.muted = False  # the robot's voice on data channels
        self.deaf_to_channel = False
        self.stopped = False  # the web process, which keeps its sockets and says nothing
        self.faults: tuple[protocol.Fault, ...] = ()  # what it says that fails
        self.denies: dict[str, str] = {}  # suffix of a page's request to the reason of `denied`
        self.closed_to_sockets = False
        self.answers = threading.Event()  # cleared: the robot's answers wait
        self.answers.set()
        self.url = ""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._ended: asyncio.Event | None = None
        self._pages: dict[str, _Page] = {}
        self._count = 0
        self._lease: m.Lease | None = None
        self._queue: list[_Page] = []
        self._report: collections.deque[m.AppliedCommand] = collections.deque(maxlen=64)
        self._seq = 0
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), daemon=True)

    def __enter__(self) -> Self:
        self.media.start()
        self._thread.start()
        assert self._ready.wait(patient(10))
        return self

    def __exit__(self, *_: object) -> None:
        assert self._loop is not None
        assert self._ended is not None
        self.media.close()
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(10)

    # --- for tests --------------------------------------------------------------------------------

    def said(self, suffix: str, way: str | None = None) -> list[Any]:
        """Return every message of a suffix that pages said."""
        return [
            message
            for _, on, said, message in list(self.heard)
            if said == suffix and way in (None, on)
        ]

    def do(self, call: Any, *arguments: Any) -> None:
        """Run something on the server's loop."""
        assert self._loop is not None
        self._loop.call_soon_threadsafe(call, *arguments)

    def cut_sockets(self) -> None:
        """Break every WebSocket without a goodbye."""
        self.do(lambda: [page.connection.transport.abort() for page in list(self._pages.values())])

    @property
    def session(self) -> str:
        """The id of the visit that is going on, or nothing."""
        return self._lease.session if self._lease else ""

    def end(self, outcome: str) -> None:
        """End the visit, as a session manager would."""
        self.do(self._end, outcome)

    def offer_turn(self, seconds: float) -> None:
        """End the visit, and offer the robot to the first who waits."""
        self.do(self._offer_turn, seconds)

    def keep_waiting(self, reason: str) -> None:
        """Say to those who wait, and will wait, why nobody can have the robot."""
        self.reason = reason
        self.do(lambda: [self._say_queued(place) for place in range(1, len(self._queue) + 1)])

    def tell(self, suffix: str, message: m.Message) -> None:
        """Say something to every page."""
        self.do(self._tell, suffix, message)

    # --- the server -------------------------------------------------------------------------------

    async def _main(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._ended = asyncio.Event()
        server = await serve(self._page, "127.0.0.1", 0, process_request=self._http)
        self.url = f"http://127.0.0.1:{_port(server)}/"
        self._ready.set()
        robot = asyncio.create_task(self._robot())
        await self._ended.wait()
        robot.cancel()
        # and nobody is waited for: a browser keeps connections on which it has not asked for
        # anything yet
        server.close()

    def _http(self, _connection: ServerConnection, request: Request) -> Response | None:
        path = urlsplit(request.path).path
        if path in {"/socket", f"/{protocol.CHECK_PATH}"}:
            return Response(503, "busy", Headers()) if self.closed_to_sockets else None
        file = collected_files() / path.removeprefix("/static/")
        # first, for there are a hundred of them a page
        if path.startswith("/static/") and file.is_file():
            return _response(
                file.read_bytes(), mimetypes.guess_type(path)[0] or "application/octet-stream"
            )
        if path in (made := self._made()):
            return _response(*made[path])
        return Response(http.HTTPStatus.NOT_FOUND, "Not Found", Headers([("Content-Length", "0")]))

    def _made(self) -> dict[str, tuple[bytes, str]]:
        """What is no file: address to body and kind."""
        listed = [{"actionId": name, "url": f"/snapshots/{name}"} for name in self.photos]
        return {
            "/": (self.html().encode(), "text/html; charset=utf-8"),
            "/floorplan.json": (self._plan_json(), "application/json"),
            "/manifest.webmanifest": (b"{}", "application/manifest+json"),
            "/snapshots": (json.dumps({"snapshots": listed}).encode(), "application/json"),
            **{f"/snapshots/{name}": (jpeg, "image/jpeg") for name, jpeg in self.photos.items()},
            "/practice": (json.dumps(self.practice).encode(), "application/json"),
            "/robots.json": (json.dumps({"robots": self.others}).encode(), "application/json"),
            PRACTICE: (
                b'<link rel="icon" href="data:,"><h1>Another robot</h1>',
                "text/html; charset=utf-8",
            ),
            STEP: (
                b'<link rel="icon" href="data:,"><h1>The next step</h1>',
                "text/html; charset=utf-8",
            ),
        }

    def html(self, language: str = "en") -> str:
        """Return the page as Django renders it."""
        factsheet = msgspec.to_builtins(self.factsheet)
        config = {
            "robot": ROBOT,
            "title": "Giraff",
            "socket": "/socket",
            "floorplan": "/floorplan.json",
            "factsheet": factsheet,
        }
        config |= {
            "snapshots": "/snapshots",
            "study": self.study,
            "check": f"/{protocol.CHECK_PATH}",
            "operates": self.operates,
        }
        config["practice"] = "/practice" if self.practice else None
        config["robots"] = "/robots.json"
        with translation.override(language):
            return render_to_string(
                "sessions/drive.html",
                {"robot": SimpleNamespace(name=ROBOT, shown_title="Giraff"), "config": config},
            )

    def _plan_json(self) -> bytes:
        grid = {"resolution": 0.05, "origin": [-0.3, -0.3, 0.0], "width": 252, "height": 164}
        return json.dumps({**grid, "plan": json.loads((OFFICE / "plan.json").read_text())}).encode()

    async def _page(self, connection: ServerConnection) -> None:
        if connection.request.path == f"/{protocol.CHECK_PATH}":
            async for word in connection:
                await connection.send(word)
            return
        self._count += 1
        page = _Page(connection, f"p{secrets.token_hex(4)}", self._count, lambda: self.stopped)
        self._pages[page.peer] = page
        page.say(
            "hello",
            protocol.Hello(
                peer=page.peer,
                stamp=time.time(),
                robot=ROBOT,
                online=self.online,
                may_drive=self.may_drive,
                may_observe=True,
            ),
        )
        self._tell_room()
        try:
            with contextlib.suppress(ConnectionClosed):
                async for frame in connection:
                    self._hear(page, frame if isinstance(frame, str) else frame.decode())
        finally:
            self._pages.pop(page.peer, None)
            if page in self._queue:
                self._queue.remove(page)

    def _hear(self, page: "_Page", frame: str) -> None:
        suffix, _, payload = frame.partition("\n")
        try:
            message = (
                codec.decode(suffix, payload)
                if suffix.startswith("command/")
                else protocol.decode(suffix, payload)
            )
        except Rejection as rejection:
            page.say("denied", protocol.Denied(suffix=suffix, reason=rejection.reason))
            self.heard.append((page.number, "mqtt", "rejected", rejection))
            return
        self.heard.append((page.number, "mqtt", suffix, message))
        if suffix in self.denies:
            page.say("denied", protocol.Denied(suffix=suffix, reason=self.denies[suffix]))
            return
        if suffix.startswith("command/"):
            self._command(suffix, message, CommandSender("mqtt", page.peer), page.peer)
        else:
            self._visit(page, message)

    def _visit(self, page: "_Page", message: Any) -> None:
        match message:
            case protocol.Take():
                self._take(page, message)
            case protocol.Observe():
                page.watches = True
                page.say("session/observing", protocol.Observing())
            case protocol.Leave() if self._holds(page):
                self._end("completed")
            case m.SdpOffer():
                role: m.Role = "driver" if self._holds(page) else "observer"
                self.media.signal(page.peer, msgspec.structs.replace(message, role=role))
            case m.Candidate() | m.Bye():
                self.media.signal(page.peer, message)
        self._tell_room()

    def _take(self, page: "_Page", take: protocol.Take) -> None:
        lease = self._lease
        if lease is not None and take.session == lease.session and take.peer == lease.peer:
            del self._pages[page.peer]
            page.peer = lease.peer
            self._pages[page.peer] = page
            self._grant(page, lease.session, lease.epoch, resumed=True)
        elif lease is None or take.session == lease.session:
            self._grant(
                page,
                take.session or secrets.token_hex(8),
                lease.epoch + 1 if lease else 1,
                resumed=False,
            )
        else:
            self._queue.append(page)
            self._say_queued(len(self._queue))

    def _say_queued(self, place: int) -> None:
        page = self._queue[place - 1]
        queued = protocol.Queued(session=page.peer, place=place, minutes=4.0, reason=self.reason)
        page.say("session/queued", queued)

    def _grant(self, page: "_Page", session: str, epoch: int, *, resumed: bool) -> None:
        limits = m.LeaseLimits()
        page.watches = False
        renewal = self._lease.renewal + 1 if self._lease else 0
        self._lease = m.Lease(
            session=session,
            epoch=epoch,
            peer=page.peer,
            who="Ana",
            renewal=renewal,
            stamp=time.time(),
            ttl=60.0,
            limits=limits,
        )
        self.kernel.take_lease(self._lease, retained=False, now=time.monotonic())
        self.media.lease_changed(page.peer)
        page.say(
            "session/granted",
            protocol.Granted(
                session=session,
                epoch=epoch,
                peer=page.peer,
                resumed=resumed,
                limits=limits,
                terms=self.terms,
            ),
        )

    def _holds(self, page: "_Page") -> bool:
        return self._lease is not None and self._lease.peer == page.peer

    def _end(self, outcome: str) -> None:
        lease, self._lease = self._lease, None
        self.kernel.take_lease(None, retained=False, now=time.monotonic())
        self.media.lease_changed(None)
        if lease is not None and lease.peer in self._pages:
            self._pages[lease.peer].say(
                "session/ended", protocol.Ended(session=lease.session, outcome=outcome)
            )
        self._tell_room()

    def _offer_turn(self, seconds: float) -> None:
        self._end("completed")
        page = self._queue.pop(0)
        page.say("session/offered", protocol.Offered(session=page.peer, seconds=seconds))

    def _tell(self, suffix: str, message: m.Message) -> None:
        for page in self._pages.values():
            page.say(suffix, message)

    def _tell_room(self) -> None:
        driver = "Ana" if self._lease else None
        others = sum(page.watches for page in self._pages.values())
        self._tell(
            "room",
            protocol.RoomState(
                driver=driver,
                driving=driver is not None,
                observers=others,
                waiting=len(self._queue),
            ),
        )

    # --- the robot --------------------------------------------------------------------------------

    def _reply(self, peer: str, message: m.SignalReply) -> None:
        self.answers.wait(10)
        self.do(lambda: peer in self._pages and self._pages[peer].say("signal/reply", message))

    def _on_channel(self, peer: str, role: m.Role, heard: ReceivedPacket) -> None:
        self.do(self._hear_channel, peer, role, heard)

    def _hear_channel(self, peer: str, role: m.Role, message: ReceivedPacket) -> None:
        if self.deaf_to_channel:
            return
        if isinstance(message, Rejection):
            raise message
        suffix = SUFFIXES.get(type(message), "command/action")
        self.heard.append((0, "datachannel", suffix, message))
        if role == "driver" or suffix in {"command/action", "command/point"}:
            self._command(suffix, message, CommandSender("datachannel", peer, role=role), peer)

    def _command(self, suffix: str, message: Any, sender: CommandSender, peer: str) -> None:
        now, unix = time.monotonic(), time.time()
        if suffix == "command/heartbeat":
            self.kernel.clocks.heard(peer, sender.way, message, now=now, unix=unix)
            self.kernel.heartbeat(peer, sender.way, now)
        elif suffix == "command/velocity":
            verdict = self.kernel.velocity(message, sender, now=now, unix=unix)
            if verdict.reason is None:
                self.applied.append((sender.way, message))
                self._report.append(_applied(message, sender.way, verdict.age or 0.0))
        elif suffix == "command/picture" and self.still is not None:
            self._pages[peer].show(picture.frame(picture.pack(unix, self.still)))
        elif isinstance(message, m.Photo):
            self._say(
                "action",
                m.ActionStatus(
                    action_id=message.action_id, status="FINISHED", stamp=unix, type="photo"
                ),
            )
        elif isinstance(message, m.Stop):
            self.kernel.stop(message, sender, now)
            self._say("state", self._state())

    async def _robot(self) -> None:
        tick = 0
        while True:
            tick += 1
            now = time.monotonic()
            decision = self.kernel.tick(now)
            if decision.velocity is not None:
                self.simulation.command(decision.velocity.linear, decision.velocity.angular)
                self.kernel.applied(decision.velocity)
            self.simulation.step(TICK)
            self.kernel.measured(self._velocity(), now)
            if tick % 10 == 0 and self.online:
                self._say("heartbeat", self.kernel.clocks.beat(now, time.time()))
            if tick % 12 == 0 and self.online:
                self._say("state", self._state())
            if tick % 4 == 0 and self.online:
                self._say(
                    "pose",
                    m.PoseUpdate(
                        stamp=time.time(),
                        pose=self._pose(),
                        velocity=self._velocity(),
                        tilt=self.simulation.tilt,
                    ),
                )
            if tick % 15 == 0 and self.online:
                self._say("scan", self._scan())
            if tick % STATUS == 0:
                self._tell("server/status", protocol.ServerStatus(faults=self.faults))
            if tick % RENEWAL == 0 and self._lease is not None:
                self._lease = msgspec.structs.replace(
                    self._lease, renewal=self._lease.renewal + 1, stamp=time.time()
                )
                self.kernel.take_lease(self._lease, retained=False, now=now)
            await asyncio.sleep(TICK)

    def _pose(self) -> m.Pose:
        x, y, theta = self.simulation.pose
        return m.Pose(x=x, y=y, theta=theta)

    def _velocity(self) -> m.Velocity:
        return m.Velocity(
            linear=self.simulation.motion.linear, angular=self.simulation.motion.angular
        )

    def _scan(self) -> m.Scan:
        laser = self.model.laser
        ranges = tuple(
            round(found, 3) if math.isfinite(found) else None
            for found in self.simulation.scan().tolist()
        )
        step = laser.angle_increment
        return m.Scan(
            stamp=time.time(),
            angle_min=laser.angle_min,
            angle_increment=step,
            range_max=laser.range_max,
            ranges=ranges,
        )

    def _state(self) -> m.State:
        self._seq += 1
        lease, refused = self._lease, dict(self.kernel.refused)
        applied = tuple(self._report)
        self._report.clear()
        self.kernel.refused.clear()
        self.refused.update(refused)
        return m.State(
            stamp=time.time(),
            boot="b1",
            seq=self._seq,
            session=lease.session if lease else None,
            epoch=lease.epoch if lease else 0,
            pose=self._pose(),
            velocity=self._velocity(),
            battery=self.battery,
            docked=self.simulation.docked,
            tilt=self.simulation.tilt,
            errors=self.errors,
            refused=refused,
            applied=applied,
            distance=self.simulation.distance,
            safety=m.Safety(
                stop_seq=self.kernel.stop_seq,
                stop_id=self.kernel.stop_id,
                inhibited=self.kernel.inhibited(time.monotonic()),
            ),
        )

    def _say(self, suffix: str, message: m.Message) -> None:
        self._tell(suffix, message)
        if not self.muted:
            self.media.telemetry(suffix, message)


class _Page:
    """One WebSocket."""

    def __init__(
        self,
        connection: ServerConnection,
        peer: str,
        number: int,
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.connection, self.peer, self.number, self.is_stopped = (
            connection,
            peer,
            number,
            is_stopped,
        )
        self.watches = False
        self._tasks: set[asyncio.Task[None]] = set()

    def say(self, suffix: str, message: m.Message) -> None:
        self.show(protocol.encode_frame(suffix, message))

    def show(self, frame: str | bytes) -> None:
        if self.is_stopped():
            return
        task = asyncio.ensure_future(self._send(frame))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _send(self, frame: str | bytes) -> None:
        with contextlib.suppress(ConnectionClosed):
            await self.connection.send(frame)


def _applied(command: m.VelocityCommand, way: m.Way, age: float) -> m.AppliedCommand:
    return m.AppliedCommand(
        seq=command.seq,
        stamp=command.stamp,
        method=command.method,
        way=way,
        age=age,
        linear=command.linear,
        angular=command.angular,
    )


def _response(body: bytes, kind: str) -> Response:
    kept = [
        ("Content-Type", kind),
        ("Content-Length", str(len(body))),
        ("Content-Security-Policy", POLICY),
        ("Cache-Control", "no-store"),
    ]
    headers = Headers(kept)
    return Response(http.HTTPStatus.OK, "OK", headers, body)


def _port(server: Server) -> int:
    return next(iter(server.sockets)).getsockname()[1]
