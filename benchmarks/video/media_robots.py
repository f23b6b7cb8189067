"""The robots that benchmarks/video/media.py measures, each in a process of its own behind a pipe.

`ours` is the media side with a synthetic camera, `slow` the same with two pictures a second and no
sound, `plain` is aiortc as it comes with the camera of `ours`, and `simulator` the media side with
the simulated robot, turning, and its child process.
"""

import asyncio
import contextlib
import functools
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Protocol

import av
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription

from robots.agent.adapters import registry
from robots.agent.media import MediaSide
from robots.agent.media.webrtc.sdp import parsed_candidate
from robots.api.messages import Candidate, SdpAnswer, SdpOffer, Signal, Velocity
from tests.support.media.loopback_peer import Exchange
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone

TURNING = Velocity(linear=0.0, angular=0.5)


class RunnableRobot(Protocol):
    """The interface of a robot that a process runs."""

    def start(self) -> None:
        pass

    def signal(self, peer: str, message: Signal) -> None:
        pass

    def close(self) -> None:
        pass


class RobotProcess:
    """A robot in another process, for this one's pages: it is their `media`, and feeds their
    exchange.
    """

    def __init__(self, kind: str, exchange: Exchange) -> None:
        context = get_context("spawn")
        self._pipe, other = context.Pipe()
        self._exchange = exchange
        self._process = context.Process(target=serve, args=(kind, other), daemon=False)
        self._process.start()
        assert self._pipe.recv() == "ready"
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def signal(self, peer: str, message: Signal) -> None:
        self._pipe.send((peer, message))

    def close(self) -> None:
        self._pipe.send(None)
        self._process.join(10.0)

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._exchange.reply(*self._pipe.recv())


def serve(kind: str, pipe: Connection) -> None:
    """Run a robot of `kind` until the pipe says None or ends."""
    kinds: dict[str, Callable[[Callable[..., None]], RunnableRobot]] = {
        "ours": _ours,
        "slow": functools.partial(_ours, fps=2.0, has_sound=False),
        "plain": PlainRobot,
        "simulator": SimulatedRobot,
    }
    robot = kinds[kind](lambda peer, message: pipe.send((peer, message)))
    robot.start()
    pipe.send("ready")
    with contextlib.suppress(EOFError):
        while (call := pipe.recv()) is not None:
            robot.signal(*call)
    robot.close()


def _ours(
    reply: Callable[..., None], fps: float = 30.0, *, has_sound: bool = True
) -> RunnableRobot:
    return MediaSide(
        video=SyntheticCamera(fps),
        audio=SyntheticMicrophone() if has_sound else None,
        viewers=8,
        on_command=lambda *_: None,
        reply=reply,
    )


class SimulatedRobot:
    """The media side of a simulated Giraff that turns on the spot, so that every picture is new."""

    def __init__(self, reply: Callable[..., None]) -> None:
        self._adapter: Any = registry.create("simulator", "giraff", {"seed": "1"})
        self._media = MediaSide(
            video=self._adapter.video(),
            audio=self._adapter.audio(),
            viewers=8,
            on_command=lambda *_: None,
            reply=reply,
        )
        self._ready, self._end = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._turn()))

    def start(self) -> None:
        self._thread.start()
        self._ready.wait()
        self._media.start()

    def signal(self, peer: str, message: Signal) -> None:
        self._media.signal(peer, message)

    def close(self) -> None:
        self._media.close()
        self._end.set()
        self._thread.join()

    async def _turn(self) -> None:
        await self._adapter.connect()
        self._ready.set()
        while not self._end.is_set():
            self._adapter.apply(TURNING)
            await asyncio.sleep(0.05)
        await self._adapter.close()


class PlainRobot:
    """aiortc as its examples use it: a track of frames, an encoder in the sender."""

    def __init__(self, reply: Callable[..., None]) -> None:
        self._reply = reply
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._connections: dict[str, RTCPeerConnection] = {}

    def start(self) -> None:
        self._thread.start()

    def signal(self, peer: str, message: Signal) -> None:
        asyncio.run_coroutine_threadsafe(self._take(peer, message), self._loop)

    def close(self) -> None:
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result(5.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    async def _take(self, peer: str, message: Signal) -> None:
        if isinstance(message, SdpOffer):
            connection = self._connections[peer] = RTCPeerConnection(
                RTCConfiguration(iceServers=[])
            )
            await connection.setRemoteDescription(RTCSessionDescription(message.sdp, "offer"))
            connection.addTrack(CameraTrack())
            await connection.setLocalDescription(await connection.createAnswer())
            self._reply(peer, SdpAnswer(sdp=connection.localDescription.sdp))
        elif isinstance(message, Candidate):
            candidate = parsed_candidate(
                message.candidate, message.sdp_mid, message.sdp_m_line_index
            )
            if candidate is not None:
                await self._connections[peer].addIceCandidate(candidate)
        else:
            await self._connections.pop(peer).close()

    async def _close(self) -> None:
        for connection in self._connections.values():
            await connection.close()


class CameraTrack(MediaStreamTrack):
    """The synthetic camera as a track of aiortc's."""

    kind = "video"

    def __init__(self) -> None:
        super().__init__()
        self._camera = SyntheticCamera()
        self._camera.start()
        self._began: float | None = None

    async def recv(self) -> av.VideoFrame:
        frame = await asyncio.get_running_loop().run_in_executor(None, self._camera.read, 1.0)
        assert frame is not None
        self._began = self._began or time.time()
        picture = av.VideoFrame.from_ndarray(frame.image, format="rgb24")
        picture.pts, picture.time_base = (
            int((frame.stamp - self._began) * 90_000),
            Fraction(1, 90_000),
        )
        return picture
