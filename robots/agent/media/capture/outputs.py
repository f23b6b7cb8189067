"""The robot's own loudspeaker and display: the visitor's media, decoded in a thread of its own.

Decoding takes milliseconds, and a loudspeaker may block: neither belongs on an event loop. Media
that cannot be played in time are dropped, video up to the next key frame. A device that fails is
closed, and tried again after a growing pause while there is something to play.
"""

import queue
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import av
import numpy as np
import numpy.typing as npt
import structlog

from robots.agent.media.rtp import AUDIO_RATE, Kind
from robots.agent.robot_interface import AdapterError, Display, Speaker
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

DEPTH = 25  # sounds and pictures in the queue: half a second of sound
IDLE = 2.0  # s without media after which loudspeaker and display are stopped
CLOSE_TIMEOUT = 3.0  # s
FIRST_RETRY, LAST_RETRY = 0.5, 5.0  # s
NOTES = (659.25, 523.25)  # Hz
NOTE_SECONDS = (0.45, 1.0)
CHIME_LEVEL = 0.25  # of full scale
STEADY = 1.0  # s after which an opened device counts as working: some fail only after a while
FAILURES = (AdapterError, av.FFmpegError, OSError, ValueError)


class OutputFeed:
    """Plays sounds and shows frames as they arrive; `hear` and `see` of one thread never block."""

    def __init__(self, speaker: Speaker | None, display: Display | None) -> None:
        self.volume = 1.0
        self._waiting: queue.Queue[tuple[str, bytes] | None] = queue.Queue(DEPTH)
        self._whole = False  # the pictures in the queue start with a key frame and have no gap
        self._thread: threading.Thread | None = None
        self._players: dict[str, _Player] = {}
        if speaker is not None:
            self._players["audio"] = _Player("libopus", speaker, partial(self._play, speaker))
        if display is not None:
            self._players["video"] = _Player("vp8", display, partial(_show, display))
        self.dropped = 0

    @property
    def errors(self) -> tuple[str, ...]:
        """Return why loudspeaker and display failed when last used, a sentence each."""
        return tuple(player.failure for player in self._players.values() if player.failure)

    def start(self) -> None:
        """Start the thread, again after it died; devices start with the first thing for them."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._run, name="outputs", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread after the queue; waits at most some seconds."""
        if self._thread is not None and self._thread.is_alive():
            try:
                self._waiting.put(None, timeout=CLOSE_TIMEOUT)
            except queue.Full:
                return  # a loudspeaker blocks for ever: the thread is a daemon
            self._thread.join(CLOSE_TIMEOUT)

    def hear(self, opus: bytes) -> None:
        """Play 20 ms of Opus."""
        if self.has_speaker:
            self._put(("audio", opus))

    @property
    def has_speaker(self) -> bool:
        return "audio" in self._players

    def works(self, kind: Kind) -> bool:
        """Tell whether there is a device for it, which did not fail when last used."""
        return kind in self._players and not self._players[kind].failure

    def ring(self) -> None:
        """Play the chime of a knock; dropped when the queue is full."""
        if self.has_speaker:
            self._put(("ring", b""))

    def see(self, vp8: bytes, *, key: bool) -> bool:
        """Show a VP8 frame; False when it is dropped and a key frame must follow."""
        if "video" not in self._players:
            return True
        self._whole = (self._whole or key) and self._put(("video", vp8))
        return self._whole

    def _put(self, what: tuple[str, bytes]) -> bool:
        try:
            self._waiting.put_nowait(what)
        except queue.Full:
            self.dropped += 1
            return False
        return True

    # --- the thread -------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            try:
                what = self._waiting.get(timeout=IDLE)
            except queue.Empty:
                self._rest()
                continue
            if what is None:
                self._rest()
                return
            kind, data = what
            if kind == "ring":
                frame = av.AudioFrame.from_ndarray(chime()[None], format="s16", layout="mono")
                frame.sample_rate = AUDIO_RATE
                self._players["audio"].give([frame])
            else:
                self._players[kind].play(data)

    def _rest(self) -> None:
        for player in self._players.values():
            player.rest()

    def _play(self, speaker: Speaker, frame: av.AudioFrame) -> None:
        speaker.play((_mono(frame) * self.volume).astype(np.int16))


def _show(display: Display, frame: av.VideoFrame) -> None:
    display.show(frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False))


class _Player:
    """A decoder and its device, started on first use; nothing that they raise leaves it."""

    def __init__(self, codec: str, device: Speaker | Display, give: Callable[[Any], None]) -> None:
        decoder: Any = av.CodecContext.create(codec, "r")
        if codec == "libopus":
            decoder.sample_rate, decoder.layout = AUDIO_RATE, "mono"
        self._decoder = decoder
        self._device, self._give, self._running = device, give, False
        self._since = float("-inf")
        self._retry_at = float("-inf")
        self._pause = FIRST_RETRY
        self.failure = ""

    def play(self, data: bytes) -> None:
        try:
            # decoded also while the device pauses: later frames depend on it
            frames = self._decoder.decode(av.Packet(data))
        except FAILURES as error:
            log.warning(
                "visitor_output_undecodable", codec=self._decoder.name, reason=reason_of(error)
            )
            return
        self.give(frames)

    def give(self, frames: Iterable[Any]) -> None:
        if time.monotonic() < self._retry_at:
            return
        try:
            if not self._running:
                self._device.start()
                self._running, self._since = True, time.monotonic()
            for frame in frames:
                self._give(frame)
        except FAILURES as error:
            self._failed(reason_of(error))
        else:
            if self.failure and time.monotonic() - self._since > STEADY:
                self.failure, self._pause = "", FIRST_RETRY

    def rest(self) -> None:
        if self._running:
            self._running = False
            try:
                self._device.stop()
            except FAILURES as error:
                log.warning(
                    "visitor_output_stop_failed", codec=self._decoder.name, reason=reason_of(error)
                )

    def _failed(self, reason: str) -> None:
        log.warning(
            "visitor_output_failed",
            codec=self._decoder.name,
            reason=reason,
            retry=round(self._pause, 1),
        )
        self.failure = reason
        self._retry_at = time.monotonic() + self._pause
        self._pause = min(self._pause * 2, LAST_RETRY)
        self.rest()


def chime() -> npt.NDArray[np.int16]:
    """Return the sound of a knock, (n,) of 16 bit at 48 kHz: two notes, E5 and C5, which fade away;
    that of the robot's screen (static/js/pages/screen/chime.js) is the same.
    """
    length = int(sum(NOTE_SECONDS) * AUDIO_RATE)
    samples = np.zeros(length)
    start = 0
    for hertz, seconds in zip(NOTES, NOTE_SECONDS, strict=True):
        time_s = np.arange(length - start) / AUDIO_RATE
        tone = np.sin(2 * np.pi * hertz * time_s) + 0.3 * np.sin(4 * np.pi * hertz * time_s)
        # 5 ms to rise, so that it does not click
        samples[start:] += tone * np.exp(-5.0 * time_s) * np.minimum(1.0, time_s / 0.005)
        start += int(seconds * AUDIO_RATE)
    return (np.clip(samples * CHIME_LEVEL, -1.0, 1.0) * 32767).astype(np.int16)


def _mono(frame: av.AudioFrame) -> Any:
    samples = frame.to_ndarray().astype(np.float64)
    if frame.format.name.startswith("flt"):
        samples = samples * 32767.0
    if not frame.format.is_planar:
        samples = samples.reshape(-1, len(frame.layout.channels)).T
    return np.clip(samples.mean(axis=0), -32768, 32767)
