"""A page without a browser: an aiortc connection that offers as our pages do and notes what it
gets.
"""

import asyncio
from dataclasses import dataclass, field
from typing import Any, Self

from aiortc import RTCConfiguration, RTCDataChannel, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

from robots.agent.media import MediaSide
from robots.agent.media.webrtc.packet_gate import ReceivedPacket
from robots.api.codec import decode_frame
from robots.api.messages import Bye, Role, SdpAnswer, SdpOffer, SignalReply
from tests.support.patience import until


@dataclass
class Exchange:
    """The signalling between a MediaSide and its pages, in place of the agent's control side."""

    loop: asyncio.AbstractEventLoop
    replies: list[tuple[str, SignalReply]] = field(default_factory=list)
    heard: list[tuple[str, Role, ReceivedPacket]] = field(default_factory=list)

    def reply(self, peer: str, message: SignalReply) -> None:
        self.loop.call_soon_threadsafe(self.replies.append, (peer, message))

    def on_command(self, peer: str, role: Role, heard: ReceivedPacket) -> None:
        self.loop.call_soon_threadsafe(self.heard.append, (peer, role, heard))

    def byes(self, peer: str) -> list[str]:
        return [
            message.reason
            for name, message in self.replies
            if name == peer and isinstance(message, Bye)
        ]

    def answers(self, peer: str) -> list[str]:
        return [
            message.sdp
            for name, message in self.replies
            if name == peer and isinstance(message, SdpAnswer)
        ]


class LoopbackPage:
    """One page. `pictures` are (RTP timestamp, is key frame) as they arrive, `images` the decoded
    pictures' arrays.
    """

    def __init__(
        self, media: MediaSide, exchange: Exchange, peer: str, *, decode: bool = True
    ) -> None:
        self.media, self.exchange, self.peer = media, exchange, peer
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.video = self.connection.addTransceiver("video", direction="recvonly")
        self.audio = self.connection.addTransceiver("audio", direction="recvonly")
        self.channel: RTCDataChannel = self.connection.createDataChannel(
            "control", ordered=False, maxRetransmits=0
        )
        self.messages: list[tuple[str, Any]] = []
        self.pictures: list[tuple[int, bool]] = []
        self.images: list[Any] = []
        self.sounds = 0
        self._decode = decode
        self._tasks: list[asyncio.Task[None]] = []
        self.channel.on("message", lambda frame: self.messages.append(decode_frame(frame)))
        self._note_pictures()

    async def offer_sdp(self) -> str:
        """Return the offer, with candidates."""
        await self.connection.setLocalDescription(await self.connection.createOffer())
        return self.connection.localDescription.sdp

    async def connect(self, role: Role = "observer", timeout: float = 10.0) -> None:
        """Offer, take the answer, and wait until media and data can flow."""
        answered = len(self.exchange.answers(self.peer))
        self.media.signal(self.peer, SdpOffer(sdp=await self.offer_sdp(), role=role))
        await until(lambda: len(self.exchange.answers(self.peer)) > answered, timeout, "an answer")
        await self.take_answer()
        await until(lambda: self.channel.readyState == "open", timeout, "an open data channel")

    async def take_answer(self) -> None:
        """Take the newest answer, and begin to watch and listen."""
        await self.connection.setRemoteDescription(
            RTCSessionDescription(self.exchange.answers(self.peer)[-1], "answer")
        )
        if self._decode:
            self._tasks = [
                asyncio.ensure_future(self._watch()),
                asyncio.ensure_future(self._listen()),
            ]

    async def lose_a_picture(self) -> None:
        """Send a PLI, as a decoder does that misses something."""
        await self.video.receiver._send_rtcp_pli(self.ssrc)

    def fall_silent(self) -> None:
        """Send no more RTCP, as a page does that hangs."""

        async def nothing(data: bytes) -> None:
            pass

        self.audio.receiver.transport._send_rtp = nothing

    @property
    def ssrc(self) -> int:
        """The stream that the robot's picture comes on."""
        return self.connection.remoteDescription and int(
            next(
                line
                for line in self.connection.remoteDescription.sdp.splitlines()
                if line.startswith("a=ssrc:")
            )
            .split(":")[1]
            .split()[0]
        )

    def shows(self, colour: tuple[int, int, int]) -> bool:
        """Return whether the newest image has this mean colour."""
        return bool(self.images) and is_near(self.images[-1].reshape(-1, 3).mean(axis=0), colour)

    def clocks(self) -> list[Any]:
        return [message for suffix, message in self.messages if suffix == "media"]

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.connection.close()

    def _note_pictures(self) -> None:
        receiver = self.video.receiver
        handle = receiver._handle_rtp_packet

        async def note(packet: Any, arrival_time_ms: int) -> None:
            # RFC 7741: S = 1 and partition 0 begin a picture, whose first byte has P = 0 when it is
            # a key frame.
            if len(packet.payload) > 4 and packet.payload[0] == 0x10:
                self.pictures.append((packet.timestamp, packet.payload[1] & 1 == 0))
            if self._decode:
                await handle(packet, arrival_time_ms)

        receiver._handle_rtp_packet = note

    async def _watch(self) -> None:
        try:
            while True:
                frame = await self.video.receiver.track.recv()
                self.images = [*self.images[-20:], frame.to_ndarray(format="rgb24")]
        except MediaStreamError:
            pass

    async def _listen(self) -> None:
        try:
            while True:
                await self.audio.receiver.track.recv()
                self.sounds += 1
        except MediaStreamError:
            pass


def is_near(seen: Any, colour: tuple[int, int, int]) -> bool:
    """Return whether a measured colour, None if there is none, is nearly the given one."""
    return seen is not None and all(
        abs(part - wanted) < 20 for part, wanted in zip(seen, colour, strict=True)
    )


class MediaRig:
    """A MediaSide and its pages, which close with it; an async context manager. `fields` are those
    of the MediaSide, by default without camera and microphone.
    """

    def __init__(self, **fields: Any) -> None:
        self.exchange = Exchange(asyncio.get_running_loop())
        replies = {"on_command": self.exchange.on_command, "reply": self.exchange.reply}
        defaults = {"video": None, "audio": None, "viewers": 3} | replies
        self.media = MediaSide(**defaults | fields)
        self.pages: list[LoopbackPage] = []

    async def __aenter__(self) -> Self:
        self.media.start()
        return self

    async def __aexit__(self, *_raised: object) -> None:
        for page in self.pages:
            await page.close()
        await asyncio.to_thread(self.media.close)

    def page(self, peer: str, kind: Any = LoopbackPage, **options: Any) -> Any:
        """Return a page that is not connected yet."""
        self.pages.append(kind(self.media, self.exchange, peer, **options))
        return self.pages[-1]
