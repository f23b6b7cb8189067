"""`python -m benchmarks.traffic.viewers`: viewers of a robot through the SFU, without browsers,
many in one process.

Each has its own WebSocket, authenticated by a session cookie, and a WebRTC connection to Janus. No
frame is decoded: a frame counts as seen when it has arrived completely, after a key frame. As pages
do, a viewer requests a new connection when frames stop, or when a request was refused or failed.
"""

import asyncio
import random
import time

import msgspec
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.server import broadcast
from websockets.exceptions import WebSocketException

from benchmarks.traffic import worker
from benchmarks.traffic.every import Timers
from experiments.bots.browser import open_websocket
from robots.agent.media.webrtc.aiortc_hooks import ask_key_frame
from robots.api import messages as m
from robots.api.codec import encode_frame
from sessions import protocol
from sessions.sfu.broadcast import Send, ToSfu
from tests.support.media.sfu_rig import SfuPage

BLIND = 2.0  # s without another picture, or since the SFU hung up, until the next attempt
CONNECT = 10.0  # s for which an attempt may take
AGAIN = (0.2, 1.0)  # s until the next WebSocket, drawn between
_REPLIES = msgspec.json.Decoder(m.SdpOffer | m.Bye)
DELTA = 0x01  # of the first byte of a picture: VP8's "depends on earlier ones" (RFC 6386, 9.1)


class WatchingPage(SfuPage):
    """A page whose server is a real one; `seen` has the Unix time of each picture."""

    def __init__(self, server: "LightViewer") -> None:
        super().__init__(server, "")
        self.seen: list[float] = []
        self._whole = False

    def want(self) -> None:
        """Ask for a connection, which begins with a picture that needs no other."""
        self._whole = False
        super().want()

    def _count_frame(self, data: bytes, _ticks: int) -> None:
        self._whole = self._whole or not data[0] & DELTA
        if self._whole:
            self.seen.append(time.time())
        elif self.connection is not None:
            for transceiver in self.connection.getTransceivers():
                if transceiver.kind == "video":
                    self._launch(ask_key_frame(transceiver.receiver))


class LightViewer:
    """One viewer of one robot.

    Args:
        url: the WebSocket's address, as http://.
        cookie: of the session in which this viewer is signed in.
    """

    def __init__(self, url: str, cookie: str) -> None:
        self._url = url
        self._headers = {"Cookie": f"sessionid={cookie}", "Origin": url.partition("/ws/")[0]}
        self._socket: ClientConnection | None = None
        self._watches, self._asked_at = False, 0.0
        self.page = WatchingPage(self)

    async def live(self) -> None:
        """Connect, and again whenever the connection is lost, for ever."""
        while True:
            try:
                self._socket = await open_websocket(self._url, self._headers)
                self._say("session/observe", protocol.Observe())
                while True:
                    self._hear(await self._socket.recv())
            except (WebSocketException, OSError):
                self._socket, self._watches = None, False
            await asyncio.sleep(random.uniform(*AGAIN))

    def look(self) -> None:
        now = time.time()
        newest = self.page.seen[-1] if self.page.seen else 0.0
        tries = newest <= self._asked_at and not self.page.byes
        if self._watches and now - max(self._asked_at, newest) > (CONNECT if tries else BLIND):
            self._asked_at = now
            self.page.byes.clear()
            self.page.want()

    def _hear(self, frame: str | bytes) -> None:
        assert isinstance(frame, str)
        suffix, _, payload = frame.partition("\n")
        if suffix == "session/observing":
            self._watches = True
        elif suffix == "signal/reply":
            self._tell(_REPLIES.decode(payload))

    # --- what a page asks of its server -----------------------------------------------------------

    def join(self, _peer: str, tell: Send) -> None:
        self._tell = tell

    def leave(self, _peer: str) -> None:
        pass

    def take(self, _peer: str, message: ToSfu) -> None:
        self._say(protocol.SIGNAL, message)

    def _say(self, suffix: str, message: m.Message) -> None:
        if self._socket is not None:
            broadcast([self._socket], encode_frame(suffix, message))  # without waiting, as a page


class Viewers:
    """The benchmark's requests to this process; see worker.py."""

    def __init__(self) -> None:
        self._timers = Timers()
        self._viewers: list[LightViewer] = []
        self._living: set[asyncio.Task[None]] = set()

    def add(self, viewers: list[list[str]]) -> int:
        """Let viewers come, given as [address of the WebSocket, cookie]; returns how many there
        are.
        """
        for url, cookie in viewers:
            viewer = LightViewer(url, cookie)
            self._viewers.append(viewer)
            self._timers.every(0.1, random.random(), viewer.look)
            self._living.add(asyncio.create_task(viewer.live()))
        return len(self._viewers)

    def all_saw(self, since: float) -> bool:
        return all(viewer.page.seen[-1:] > [since] for viewer in self._viewers)

    def seen(self) -> list[list[float]]:
        return [viewer.page.seen for viewer in self._viewers]


if __name__ == "__main__":
    worker.serve(Viewers)
