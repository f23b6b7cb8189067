"""A robot's real media side, the real Janus, and pages that watch through it: everything between
them but the broker and the web server.
"""

import asyncio
import functools
from collections.abc import Callable, Coroutine
from typing import Any, Protocol, Self

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

from robots.agent.media import MediaSide
from robots.agent.media.webrtc.aiortc_hooks import on_encoded_frame
from robots.api import codec, topics
from robots.api.messages import Bye, Candidate, Message, SdpAnswer, SdpOffer, Stay
from sessions.protocol import WantOffer
from sessions.sfu.broadcast import Broadcast, Send, ToSfu
from sessions.sfu.janus import open_session
from sessions.sfu.mountpoint import mountpoint_of
from tests.support import words
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone
from tests.support.patience import until
from tests.support.programs.janus import SECRET, Janus
from tests.support.sessions.memory_bridge import MemoryBridge

ROBOT = "giraff"


class SfuRig(MemoryBridge):
    """The bridge of a web process, with a robot at its other end. `media` is the robot's, of this
    process unless another one is made.
    """

    def __init__(self, janus: Janus, *, media: Callable[["SfuRig"], Any] | None = None) -> None:
        super().__init__()
        self.janus = janus
        self.stored[ROBOT, "connection"] = codec.encode(words.online())
        self.camera = SyntheticCamera()
        self.media: Any = (media or SfuRig._new_media)(self)
        self.broadcasts: list[Broadcast] = []
        self.pages: list[SfuPage] = []
        self.over = 0

    async def __aenter__(self) -> Self:
        self.loop = asyncio.get_running_loop()
        if isinstance(self.media, MediaSide):
            self.media.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        for page in self.pages:
            await page.close()
        for broadcast in self.broadcasts:
            await broadcast.close()
        await asyncio.to_thread(self.media.close)

    def _new_media(self) -> MediaSide:
        return MediaSide(
            video=self.camera,
            audio=SyntheticMicrophone(),
            viewers=8,
            on_command=lambda *_: None,
            reply=self.reply,
        )

    def renew_media(self) -> None:
        """Restart the robot's program."""
        self.camera = SyntheticCamera()
        self.media = self._new_media()
        self.media.start()

    def broadcast(self, name: str = ROBOT) -> Broadcast:
        """Begin what one web process has of the robot; another `name` is another stream of it."""
        made = Broadcast(
            ROBOT,
            mountpoint_of("secret", name),
            self,
            functools.partial(open_session, self.janus.url, SECRET),
            self._count_end,
        )
        self.broadcasts.append(made)
        return made

    def page(self, broadcast: Broadcast) -> "SfuPage":
        made = SfuPage(broadcast, f"page-{len(self.pages)}")
        self.pages.append(made)
        return made

    def connections(self) -> int:
        """Return how many pages the robot sends its stream to."""
        return len(self.media.statistics())

    def send(self, robot: str, suffix: str, message: Message) -> bool:
        assert super().send(robot, suffix, message) or not self.connected
        if suffix.startswith("signal/") and self.connected:
            self.media.signal(suffix.removeprefix("signal/"), message)
        return self.connected

    def offers_to_robot(self) -> int:
        """Return how many connections the robot was asked for so far."""
        return sum(isinstance(message, SdpOffer) for _, _, message in self.sent)

    def told_viewers(self) -> list[int]:
        return [message.viewers for _, _, message in self.sent if isinstance(message, Stay)]

    def reply(self, peer: str, message: SdpAnswer | Candidate | Bye) -> None:
        topic = topics.of(ROBOT, f"signal/{peer}/reply")
        self.loop.call_soon_threadsafe(
            self.delivery.arrive, topic, codec.encode(message), self.loop.time()
        )

    def _count_end(self) -> None:
        self.over += 1


class PageServer(Protocol):
    """What a page has of its server: a Broadcast, or the way to one."""

    def join(self, peer: str, tell: Send) -> None: ...

    def take(self, peer: str, message: ToSfu) -> None: ...

    def leave(self, peer: str) -> None: ...


class SfuPage:
    """A page that watches through Janus, as static/js/protocol/sfu_peer.js does; `frames` and
    `sounds` are how many have arrived, `byes` why its connection ended.
    """

    def __init__(self, broadcast: PageServer, peer: str) -> None:
        self.broadcast, self.peer = broadcast, peer
        self.frames = self.sounds = 0
        self.byes: list[str] = []
        self.offers: list[SdpOffer] = []
        self.connection: RTCPeerConnection | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        broadcast.join(peer, self._tell)

    def want(self) -> None:
        self.broadcast.take(self.peer, WantOffer())

    async def watch(self) -> None:
        """Ask, and wait for the first frame."""
        offers = len(self.offers)
        self.want()
        await until(lambda: len(self.offers) > offers, 20.0, f"an offer ({self.byes})")
        before = self.frames
        await until(lambda: self.frames > before, 20.0, f"a frame ({self.byes})")

    def _tell(self, message: SdpOffer | Bye) -> None:
        if isinstance(message, Bye):
            self.byes.append(message.reason)
        else:
            self.offers.append(message)
            self._launch(self._answer(message.sdp))

    def _launch(self, doing: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(doing)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, sdp: str) -> None:
        if self.connection is not None:
            await self.connection.close()
        self.connection = connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        await connection.setRemoteDescription(RTCSessionDescription(sdp, "offer"))
        for transceiver in connection.getTransceivers():
            take = self._count_frame if transceiver.kind == "video" else self._count_sound
            on_encoded_frame(transceiver.receiver, take)
        await connection.setLocalDescription(await connection.createAnswer())
        self.broadcast.take(self.peer, SdpAnswer(sdp=connection.localDescription.sdp))

    def _count_frame(self, _data: bytes, _ticks: int) -> None:
        self.frames += 1

    def _count_sound(self, _data: bytes, _ticks: int) -> None:
        self.sounds += 1

    async def packets(self) -> int:
        """Return how many packets of video have arrived; aiortc waits for lost ones longer than
        browsers do before it makes frames of them.
        """
        assert self.connection
        return sum(
            stats.packetsReceived
            for stats in (await self.connection.getStats()).values()
            if stats.type == "inbound-rtp" and stats.kind == "video"
        )

    async def close(self) -> None:
        self.broadcast.leave(self.peer)
        if self.connection is not None:
            await self.connection.close()
