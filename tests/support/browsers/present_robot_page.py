"""The drive page and the page of the robot's own display, both real, with a robot whose loudspeaker
and display can be measured.
"""

import json
import secrets
import time
from typing import Any
from urllib.parse import urlsplit

import msgspec
from django.template.loader import render_to_string
from django.utils import translation
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from robots.agent.control.calls import CallControl
from robots.agent.control.receipts import Receipts
from robots.agent.control.remote_pointer import Pointing
from robots.agent.media import MediaSide
from robots.agent.robot_interface import FROM_PAGE
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from robots.simulator.outputs import MeasuringDisplay, MeasuringSpeaker
from sessions import protocol
from sessions.consumers.authorization import Halt, Publish
from sessions.consumers.screen_authorization import ScreenAuthorization
from tests.support.browsers.fake_robot_page import HTML, ROBOT, FakeRobotPage, _Page, _response
from tests.support.media.synthetic_camera import SyntheticMicrophone

CAPABILITIES = ("velocity", "video", "audio", "say", "call", "point", "photo", "tilt")
ABLE = (*CAPABILITIES, "goto", "dock", "undock", "relocalize", "scan", "assist")
SCREEN = "/screen-socket"
PERMITTED = (m.Call, m.AnswerCall, m.Knock, m.Say, m.ConfirmWords, m.Tilt, m.ClearEStop, m.Photo)


class PresentRobotPage(FakeRobotPage):
    """A FakeRobotPage with a head, a voice and a display, whose page is at `screen_url`.

    `asked` are the permitted actions, `pointed` the forwarded dots, (transport, pointer). With
    `loses_words` messages of the visitor get lost. With `from_page` the screen's page provides
    camera and microphone. Without `devices` the robot has no loudspeaker and display of its own.
    """

    def __init__(
        self,
        *,
        from_page: bool = False,
        devices: bool = True,
        capabilities: tuple[str, ...] = CAPABILITIES,
        **options: Any,
    ) -> None:
        super().__init__(**options)
        self.capabilities = capabilities
        self.kernel.capabilities = frozenset(capabilities)
        self.speaker, self.display = MeasuringSpeaker(), MeasuringDisplay()
        self.calls = CallControl()
        self.media = MediaSide(
            video=FROM_PAGE if from_page else self.camera,
            audio=FROM_PAGE if from_page else SyntheticMicrophone(),
            viewers=4,
            on_command=self._on_channel,
            reply=self._reply,
            outputs=(self.speaker, self.display) if devices else (None, None),
        )
        self.pointing, self.receipts = Pointing(), Receipts()
        self.pointed: list[tuple[str, m.Pointer]] = []
        self.tilt = 0.0
        self.loses_words = False
        self.asked: list[Any] = []
        self.is_study = False
        # by language, as a page makes a hundred requests
        self._rendered: dict[str, str] = {}
        self._screens: dict[str, tuple[_Page, ScreenAuthorization]] = {}

    @property
    def screen_url(self) -> str:
        return self.url + "screen"

    def tell_screens(self, suffix: str, message: m.Message) -> None:
        """Send a message to the pages of the robot's screen."""
        self.do(lambda: [page.say(suffix, message) for page, _ in self._screens.values()])

    def html(self, language: str = "en") -> str:
        if language not in self._rendered:
            page, usual = super().html(language), '"capabilities": ["velocity", "video"]'
            assert usual in page
            own = f'"capabilities": {json.dumps(self.capabilities)}'
            self._rendered[language] = page.replace(usual, own)
        return self._rendered[language]

    def screen_html(self, language: str = "en") -> str:
        config = {"robot": ROBOT, "title": "Giraff", "socket": SCREEN, "key": "/key", "csrf": "x"}
        with translation.override(language):
            return render_to_string("sessions/screen.html", {"title": "Giraff", "config": config})

    def _http(self, connection: ServerConnection, request: Request) -> Response | None:
        path = urlsplit(request.path).path
        if path == SCREEN:
            return None
        pages = {
            "/screen": self.screen_html,
            "/spanish-screen": lambda: self.screen_html("es"),
            "/spanish": lambda: self.html("es"),
        }
        if path in pages:
            return _response(pages[path]().encode(), HTML)
        return super()._http(connection, request)

    async def _page(self, connection: ServerConnection) -> None:
        if connection.request is None or urlsplit(connection.request.path).path != SCREEN:
            await super()._page(connection)
            return
        room = ScreenAuthorization(f"screen{secrets.token_hex(4)}", "Giraff")
        page = _Page(connection, room.peer)
        self._screens[room.peer] = (page, room)
        page.greet(online=True, may_drive=False, may_observe=False)
        self._tell_room()
        try:
            async for frame in connection:
                self._receive_screen(room, frame)
        finally:
            self._screens.pop(room.peer, None)
            self.media.signal(room.peer, m.Bye(reason="left"))

    def _receive_screen(self, room: ScreenAuthorization, frame: str | bytes) -> None:
        for effect in room.receive(frame, None, time.monotonic()):
            if isinstance(effect, Halt):
                self._command("command/action", effect.message, CommandSender("mqtt"), room.peer)
            elif isinstance(effect, Publish) and effect.suffix.startswith("signal/"):
                self.media.signal(room.peer, effect.message)
            elif isinstance(effect, Publish):
                message = effect.message
                if isinstance(message, m.Action):
                    message = msgspec.structs.replace(message, stamp=time.time())
                self._command(effect.suffix, message, CommandSender("mqtt"), room.peer)

    def _tell_room(self) -> None:
        super()._tell_room()
        lease = self._lease
        shown = protocol.Screen(
            title="Giraff",
            session=lease.session if lease else None,
            visitor="Ana" if lease else None,
            study=bool(lease) and self.is_study,
        )
        for page, _ in self._screens.values():
            page.say("screen", shown)

    def _tell(self, suffix: str, message: m.Message) -> None:
        super()._tell(suffix, message)
        if suffix in {"state", "words", "action"}:
            for page, _ in self._screens.values():
                page.say(suffix, message)

    def _reply(self, peer: str, message: m.SignalReply) -> None:
        if screen := self._screens.get(peer):
            self.do(screen[0].say, "signal/reply", message)
        else:
            super()._reply(peer, message)

    def _command(self, suffix: str, message: Any, sender: CommandSender, peer: str) -> None:
        now, unix = time.monotonic(), time.time()
        if isinstance(message, m.PointCommand):
            self._point(message, sender, peer, now)
        elif self.loses_words and isinstance(message, m.Say):
            return
        elif isinstance(message, m.EStop):
            self.kernel.estop(message, sender, now=now, unix=unix)
            self._say("state", self._state())
        elif not isinstance(message, PERMITTED):
            super()._command(suffix, message, sender, peer)
        else:
            reason = self._permit(message, sender, now, unix)
            if isinstance(message, m.Photo):
                super()._command(suffix, message, sender, peer)
                return
            status = "FAILED" if reason else "FINISHED"
            fields = {"action_id": message.action_id, "status": status, "reason": reason or ""}
            self._say("action", m.ActionStatus(stamp=unix, **fields))

    def _permit(self, message: Any, sender: CommandSender, now: float, unix: float) -> str | None:
        """Do what is permitted; return why an action is not."""
        reason = self.kernel.permit(message, sender, now=now, unix=unix)
        if reason is None and isinstance(message, m.Knock):
            lease = self.kernel.leases.live(now)
            reason = self.calls.knock(message.action_id, lease, now, audible=self.media.audible)
            if reason is None:
                self.media.ring()
        if reason is None and self._is_known(message):
            self._tell_receipt(message.action_id)  # as Actions.take of the agent
        elif reason is None:
            self.asked.append(message)
            self._obey(message, now)
        return reason

    def _point(self, command: m.PointCommand, sender: CommandSender, peer: str, now: float) -> None:
        lease = self.kernel.leases.live(now)
        by = self.pointing.take(
            peer, command, sender, lease, shown=self.calls.shows_screen(lease, now), now=now
        )
        if by is None or lease is None:
            return
        pointer = m.Pointer(stamp=time.time(), by=by, at=command.at)
        self.pointed.append((sender.transport, pointer))
        self.media.point(pointer)
        screens = [page for page, _ in self._screens.values()]
        drivers = [page for peer, page in self._pages.items() if peer == lease.peer]
        for page in screens if by == "driver" else drivers:
            page.say("pointer", pointer)

    def _is_known(self, message: Any) -> bool:
        return isinstance(message, m.Say) and any(
            one.action_id == message.action_id for one in self.asked
        )

    def _tell_receipt(self, action_id: str) -> None:
        lease, found = self._lease, self.receipts.of(action_id)
        page = self._pages.get(lease.peer) if lease else None
        if page is not None and found is not None:
            fields = {"action_id": action_id, "session": found[0], "state": found[1]}
            page.say("receipt", m.Receipt(stamp=time.time(), **fields))

    def _obey(self, message: Any, now: float) -> None:
        lease = self.kernel.leases.live(now)
        match message:
            case m.Call() if lease:
                self.calls.ask(message, lease, now)
            case m.AnswerCall() if message.knock is not None:
                self.calls.answer_knock(message.knock, accept=message.accept, lease=lease, now=now)
            case m.AnswerCall():
                self.calls.answer(accept=message.accept, lease=lease, now=now)
            case m.Tilt():
                self.tilt = message.angle
            case m.ClearEStop():
                self.kernel.clear_estop(now)
            case m.Say() if lease:
                here = message.role == "screen"
                same = {name: getattr(message, name) for name in ("action_id", "text", "language")}
                same |= {"stamp": time.time(), "session": lease.session, "receipts": not here}
                by, who = ("screen", message.user) if here else ("driver", lease.who)
                words = m.Words(**same, by=by, who=who, aloud=message.aloud and not here)
                if not here:
                    self.receipts.sent(message.action_id, lease.session)
                self._tell("words", words)
            case m.ConfirmWords() if lease:
                if self.receipts.confirm(message.target, message.state, lease.session)[1]:
                    self._tell_receipt(message.target)
        self._say("state", self._state())

    def _state(self) -> m.State:
        now = time.monotonic()
        lease = self.kernel.leases.live(now)
        passing = self.calls.passing(lease, now)
        self.media.let_through(audio=passing.audio, video=passing.video, volume=passing.volume)
        latch = self.kernel.latch
        state = super()._state()
        safety = msgspec.structs.replace(
            state.safety, estop=latch is not None, estop_source=latch.label if latch else None
        )
        return msgspec.structs.replace(
            state,
            call=self.media.confirm(self.calls.state(lease, now)),
            screens=self.media.screens,
            knockable=self.calls.knockable(lease, audible=self.media.audible),
            knock=self.calls.knocking(lease, now),
            tilt=self.tilt,
            safety=safety,
        )
