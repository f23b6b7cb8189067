"""The drive page alone: a server and a robot in one thread, without database, broker or agent
processes.

The page, the safety kernel, the media side and the simulated robot are the real ones. The server
between them is this module, so that a test can cut, mute and end things at will.
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
from robots.api import codec, floorplan, messages as m, picture
from robots.api.errors import Rejection
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import model_of
from sessions import protocol
from tests.support.collected import collected_files
from tests.support.media.scene_source import SceneSource
from tests.support.media.synthetic_camera import SyntheticCamera
from tests.support.paths import ROOT
from tests.support.patience import patient

OFFICE = ROOT / "robots/world/plans/office"
ROBOT = "giraff"
STEP = "/study/step/"  # the next page of a study
PRACTICE = "/practice/robot/"
TICK = 0.02
SUFFIXES = {
    m.VelocityCommand: "command/velocity",
    m.CommandHeartbeat: "command/heartbeat",
    m.PointCommand: "command/point",
    m.RouteRequest: "command/route",
}
RENEWAL, STATUS = 500, 50  # ticks
FPS = 6.0  # of the robot's camera: what a computer without GPU can play beside other tests
HTML = "text/html; charset=utf-8"
SMALL = b'<link rel="icon" href="data:,"><h1>%s</h1>'
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; media-src"
    " 'self' blob:; connect-src 'self'; object-src 'none'"
)


class FakeRobotPage:
    """Serves one robot's drive page at `url` and is that robot.

    `messages` are those of all pages, (transport, suffix, message); `applied` the accepted velocity
    commands, (transport, command).
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
        self.kernel = Kernel(model.limits, 0.3, frozenset({"velocity", "video"}))
        self.model = model
        own = {name: getattr(model, name) for name in ("limits", "footprint", "camera", "tilt")}
        self.factsheet: dict[str, Any] = {"name": ROBOT, "series": "Giraff", **own}
        self.factsheet |= {"laser": m.Laser(x=model.laser.x), "capabilities": ("velocity", "video")}
        self.camera = camera or SyntheticCamera(fps=FPS)
        if isinstance(self.camera, SceneSource):
            self.camera.simulation = self.simulation
        self.media = MediaSide(
            video=self.camera, audio=None, viewers=4, on_command=self._on_channel, reply=self._reply
        )
        self.messages: list[tuple[str, str, Any]] = []
        self.applied: list[tuple[str, m.VelocityCommand]] = []
        self.study = study  # the page's part of experiments.participation.drive_config
        self.terms: protocol.GrantedTerms | None = None
        self.photos: dict[str, bytes] = {}  # the server's JPEGs, by action id
        self.practice: dict[str, Any] | None = None  # the server's answer; PRACTICE is a page
        self.others: list[dict[str, Any]] = []  # other robots in the landing page's list
        self.reason = ""  # why the robot is not offered to the queue
        self.operates = False  # whether the visitor is an operator of the robot
        self.still: bytes | None = None  # a JPEG for pictures through the server
        self.battery = m.Battery(charge=0.82)
        self.errors: tuple[str, ...] = ()
        self.refused: collections.Counter[str] = collections.Counter()  # of the whole test
        self.online = True
        self.may_drive = True
        self.muted = False  # the robot sends nothing on data channels
        self.deaf_to_channel = False
        self.stopped = False  # the web process keeps its sockets and sends nothing
        self.faults: tuple[protocol.Fault, ...] = ()  # that the server reports
        self.denies: dict[str, str] = {}  # suffix of a page's request to the reason of `denied`
        self.closed_to_sockets = False
        self.answers = threading.Event()  # cleared: the robot's answers wait
        self.answers.set()
        self.url = ""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._ended: asyncio.Event | None = None
        self._pages: dict[str, _Page] = {}
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

    def received(self, suffix: str, transport: str | None = None) -> list[Any]:
        """Return all messages of a suffix from pages, or those that arrived on one transport."""
        return [
            message
            for on, one, message in list(self.messages)
            if one == suffix and transport in (None, on)
        ]

    def do(self, call: Any, *arguments: Any) -> None:
        """Run something on the server's loop."""
        assert self._loop is not None
        self._loop.call_soon_threadsafe(call, *arguments)

    def cut_sockets(self) -> None:
        """Abort every WebSocket."""
        self.do(lambda: [page.connection.transport.abort() for page in list(self._pages.values())])

    @property
    def session(self) -> str:
        """The id of the running session, empty without one."""
        return self._lease.session if self._lease else ""

    def end(self, outcome: str) -> None:
        """End the session, as a session manager would."""
        self.do(self._end, outcome)

    def offer_turn(self, seconds: float) -> None:
        """End the session, and offer the robot to the first of the queue."""
        self.do(self._offer_turn, seconds)

    def keep_waiting(self, reason: str) -> None:
        """Tell the queue, now and later, why the robot is not offered."""
        self.reason = reason
        self.do(lambda: [self._say_queued(place) for place in range(1, len(self._queue) + 1)])

    def tell(self, suffix: str, message: m.Message) -> None:
        """Send a message to every page."""
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
        server.close()  # not waited for: a browser keeps connections without any request open

    def _http(self, _connection: ServerConnection, request: Request) -> Response | None:
        path = urlsplit(request.path).path
        if path in {"/socket", f"/{protocol.CHECK_PATH}"}:
            return Response(503, "busy", Headers()) if self.closed_to_sockets else None
        file = collected_files() / path.removeprefix("/static/")
        # first, as a page requests a hundred of them
        if path.startswith("/static/") and file.is_file():
            kind = mimetypes.guess_type(path)[0] or "application/octet-stream"
            return _response(file.read_bytes(), kind)
        if path in (made := self._made()):
            return _response(*made[path])
        return Response(http.HTTPStatus.NOT_FOUND, "Not Found", Headers([("Content-Length", "0")]))

    def _made(self) -> dict[str, tuple[bytes, str]]:
        """Return the bodies and types that are made here, by address."""
        listed = [{"actionId": name, "url": f"/snapshots/{name}"} for name in self.photos]
        return {
            "/": (self.html().encode(), HTML),
            "/floorplan.json": (self._plan_json(), "application/json"),
            "/manifest.webmanifest": (b"{}", "application/manifest+json"),
            "/snapshots": (json.dumps({"snapshots": listed}).encode(), "application/json"),
            **{f"/snapshots/{name}": (jpeg, "image/jpeg") for name, jpeg in self.photos.items()},
            "/practice": (json.dumps(self.practice).encode(), "application/json"),
            "/robots.json": (json.dumps({"robots": self.others}).encode(), "application/json"),
            PRACTICE: (SMALL % b"Another robot", HTML),
            STEP: (SMALL % b"The next step", HTML),
        }

    def html(self, language: str = "en") -> str:
        """Return the page as Django renders it."""
        config = {
            "robot": ROBOT,
            "title": "Giraff",
            "socket": "/socket",
            "floorplan": "/floorplan.json",
            "factsheet": msgspec.to_builtins(self.factsheet),
            "snapshots": "/snapshots",
            "study": self.study,
            "check": f"/{protocol.CHECK_PATH}",
            "operates": self.operates,
            "practice": "/practice" if self.practice else None,
            "robots": "/robots.json",
        }
        robot = SimpleNamespace(name=ROBOT, shown_title="Giraff")
        with translation.override(language):
            return render_to_string("sessions/drive.html", {"robot": robot, "config": config})

    def _plan_json(self) -> bytes:
        grid = {"resolution": 0.05, "origin": [-0.3, -0.3, 0.0], "width": 252, "height": 164}
        return json.dumps({**grid, "plan": json.loads((OFFICE / "plan.json").read_text())}).encode()

    async def _page(self, connection: ServerConnection) -> None:
        if connection.request.path == f"/{protocol.CHECK_PATH}":
            async for word in connection:
                await connection.send(word)
            return
        page = _Page(connection, f"p{secrets.token_hex(4)}", lambda: self.stopped)
        self._pages[page.peer] = page
        page.greet(online=self.online, may_drive=self.may_drive, may_observe=True)
        self._tell_room()
        try:
            with contextlib.suppress(ConnectionClosed):
                async for frame in connection:
                    self._receive(page, frame if isinstance(frame, str) else frame.decode())
        finally:
            self._pages.pop(page.peer, None)
            if page in self._queue:
                self._queue.remove(page)

    def _receive(self, page: "_Page", frame: str) -> None:
        suffix, _, payload = frame.partition("\n")
        decode = codec.decode if suffix.startswith("command/") else protocol.decode
        try:
            message = decode(suffix, payload)
        except Rejection as rejection:
            page.say("denied", protocol.Denied(suffix=suffix, reason=rejection.reason))
            self.messages.append(("mqtt", "rejected", rejection))
            return
        self.messages.append(("mqtt", suffix, message))
        if suffix in self.denies:
            page.say("denied", protocol.Denied(suffix=suffix, reason=self.denies[suffix]))
            return
        if suffix.startswith("command/"):
            self._command(suffix, message, CommandSender("mqtt", page.peer), page.peer)
        else:
            self._serve(page, message)

    def _serve(self, page: "_Page", message: Any) -> None:
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
            session = take.session or secrets.token_hex(8)
            self._grant(page, session, lease.epoch + 1 if lease else 1, resumed=False)
        else:
            self._queue.append(page)
            self._say_queued(len(self._queue))

    def _say_queued(self, place: int) -> None:
        page = self._queue[place - 1]
        queued = protocol.Queued(session=page.peer, place=place, minutes=4.0, reason=self.reason)
        page.say("session/queued", queued)

    def _grant(self, page: "_Page", session: str, epoch: int, *, resumed: bool) -> None:
        page.watches = False
        same = {"session": session, "epoch": epoch, "peer": page.peer, "limits": m.LeaseLimits()}
        renewal = self._lease.renewal + 1 if self._lease else 0
        self._lease = m.Lease(**same, who="Ana", renewal=renewal, stamp=time.time(), ttl=60.0)
        self.kernel.take_lease(self._lease, retained=False, now=time.monotonic())
        self.media.lease_changed(page.peer)
        granted = protocol.Granted(**same, resumed=resumed, terms=self.terms)
        page.say("session/granted", granted)

    def _holds(self, page: "_Page") -> bool:
        return self._lease is not None and self._lease.peer == page.peer

    def _end(self, outcome: str) -> None:
        lease, self._lease = self._lease, None
        self.kernel.take_lease(None, retained=False, now=time.monotonic())
        self.media.lease_changed(None)
        if lease is not None and lease.peer in self._pages:
            ended = protocol.Ended(session=lease.session, outcome=outcome)
            self._pages[lease.peer].say("session/ended", ended)
        self._tell_room()

    def _offer_turn(self, seconds: float) -> None:
        self._end("completed")
        page = self._queue.pop(0)
        page.say("session/offered", protocol.Offered(session=page.peer, seconds=seconds))

    def _tell(self, suffix: str, message: m.Message) -> None:
        for page in self._pages.values():
            page.say(suffix, message)

    def _tell_room(self) -> None:
        room = protocol.RoomState(
            driver="Ana" if self._lease else None,
            driving=self._lease is not None,
            observers=sum(page.watches for page in self._pages.values()),
            waiting=len(self._queue),
        )
        self._tell("room", room)

    # --- the robot --------------------------------------------------------------------------------

    def _reply(self, peer: str, message: m.SignalReply) -> None:
        self.answers.wait(10)
        self.do(lambda: peer in self._pages and self._pages[peer].say("signal/reply", message))

    def _on_channel(self, peer: str, role: m.Role, message: ReceivedPacket) -> None:
        self.do(self._receive_channel, peer, role, message)

    def _receive_channel(self, peer: str, role: m.Role, message: ReceivedPacket) -> None:
        if self.deaf_to_channel:
            return
        if isinstance(message, Rejection):
            raise message
        suffix = SUFFIXES.get(type(message), "command/action")
        self.messages.append(("datachannel", suffix, message))
        if role == "driver" or suffix in {"command/action", "command/point"}:
            self._command(suffix, message, CommandSender("datachannel", peer, role=role), peer)

    def _command(self, suffix: str, message: Any, sender: CommandSender, peer: str) -> None:
        now, unix = time.monotonic(), time.time()
        if suffix == "command/heartbeat":
            self.kernel.clocks.on_heartbeat(peer, sender.transport, message, now=now, unix=unix)
            self.kernel.heartbeat(peer, sender.transport, now)
        elif suffix == "command/velocity":
            verdict = self.kernel.velocity(message, sender, now=now, unix=unix)
            if verdict.reason is None:
                self.applied.append((sender.transport, message))
                self._report.append(_applied(message, sender.transport, verdict.age or 0.0))
        elif suffix == "command/picture" and self.still is not None:
            self._pages[peer].show(picture.frame(picture.pack(unix, self.still)))
        elif isinstance(message, m.Photo):
            done = {"action_id": message.action_id, "status": "FINISHED", "type": "photo"}
            self._say("action", m.ActionStatus(**done, stamp=unix))
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
            if self.online:
                self._report_motion(tick, now)
            if tick % STATUS == 0:
                self._tell("server/status", protocol.ServerStatus(faults=self.faults))
            if tick % RENEWAL == 0 and self._lease is not None:
                self._lease = msgspec.structs.replace(
                    self._lease, renewal=self._lease.renewal + 1, stamp=time.time()
                )
                self.kernel.take_lease(self._lease, retained=False, now=now)
            await asyncio.sleep(TICK)

    def _report_motion(self, tick: int, now: float) -> None:
        if tick % 10 == 0:
            self._say("heartbeat", self.kernel.clocks.beat(now, time.time()))
        if tick % 12 == 0:
            self._say("state", self._state())
        if tick % 4 == 0:
            self._say("pose", m.PoseUpdate(stamp=time.time(), **self._motion()))
        if tick % 15 == 0:
            self._say("scan", self._scan())

    def _motion(self) -> dict[str, Any]:
        x, y, theta = self.simulation.pose
        pose = m.Pose(x=x, y=y, theta=theta)
        return {"pose": pose, "velocity": self._velocity(), "tilt": self.simulation.tilt}

    def _velocity(self) -> m.Velocity:
        motion = self.simulation.motion
        return m.Velocity(linear=motion.linear, angular=motion.angular)

    def _scan(self) -> m.Scan:
        laser, found = self.model.laser, self.simulation.scan().tolist()
        return m.Scan(
            stamp=time.time(),
            angle_min=laser.angle_min,
            angle_increment=laser.angle_increment,
            range_max=laser.range_max,
            ranges=tuple(round(one, 3) if math.isfinite(one) else None for one in found),
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
            **self._motion(),
            battery=self.battery,
            docked=self.simulation.docked,
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
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.connection, self.peer, self.is_stopped = connection, peer, is_stopped
        self.watches = False
        self._tasks: set[asyncio.Task[None]] = set()

    def greet(self, **can: bool) -> None:
        hello = protocol.Hello(peer=self.peer, stamp=time.time(), robot=ROBOT, **can)
        self.say("hello", hello)

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
    same = {name: getattr(command, name) for name in ("seq", "stamp", "method")}
    return m.AppliedCommand(
        **same, way=way, age=age, linear=command.linear, angular=command.angular
    )


def _response(body: bytes, kind: str) -> Response:
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body))})
    headers.update({"Content-Security-Policy": POLICY, "Cache-Control": "no-store"})
    return Response(http.HTTPStatus.OK, "OK", headers, body)


def _port(server: Server) -> int:
    return next(iter(server.sockets)).getsockname()[1]
