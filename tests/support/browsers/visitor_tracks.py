"""A tone and a colour in place of a visitor's microphone and camera, and an aiortc page that sends
them as our drive page does.
"""

import asyncio
import time
from fractions import Fraction

import av
import numpy as np
from aiortc import MediaStreamTrack

from tests.support.media.loopback_peer import LoopbackPage

RATE, BLOCK = 48_000, 960


class ToneTrack(MediaStreamTrack):
    """A sine of `hertz` at half of full scale."""

    kind = "audio"

    def __init__(self, hertz: float) -> None:
        super().__init__()
        self._hertz, self._sent, self._began = hertz, 0, time.monotonic()

    async def recv(self) -> av.AudioFrame:
        await asyncio.sleep(max(0.0, self._began + self._sent / RATE - time.monotonic()))
        times = (np.arange(BLOCK) + self._sent) / RATE
        samples = (16_384 * np.sin(2 * np.pi * self._hertz * times)).astype(np.int16)
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = RATE, self._sent, Fraction(1, RATE)
        self._sent += BLOCK
        return frame


class ColourTrack(MediaStreamTrack):
    """320 x 240 of one colour (red, green, blue), 15 a second."""

    kind = "video"

    def __init__(self, colour: tuple[int, int, int]) -> None:
        super().__init__()
        self._image = np.full((240, 320, 3), colour, dtype=np.uint8)
        self._sent, self._began = 0, time.monotonic()

    async def recv(self) -> av.VideoFrame:
        await asyncio.sleep(max(0.0, self._began + self._sent / 15 - time.monotonic()))
        frame = av.VideoFrame.from_ndarray(self._image, format="rgb24")
        frame.pts, frame.time_base = self._sent * 6000, Fraction(1, 90_000)
        self._sent += 1
        return frame


class SpeakingPage(LoopbackPage):
    """A page that sends sound and video unasked; the robot decides whether to play them."""

    def send(self, *, hertz: float, colour: tuple[int, int, int]) -> None:
        """Add both tracks; call it before `connect`."""
        self.audio.direction = "sendrecv"
        self.audio.sender.replaceTrack(ToneTrack(hertz))
        self.connection.addTransceiver(ColourTrack(colour), direction="sendonly")
