"""Decodes one stream of a device, a file or an address in a thread, which may hang.

Each start has its own thread and state. A thread that hangs in its device is left behind, and its
later output is ignored. While too many are left behind, the device counts as broken.
"""

import errno
import itertools
import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import av
import structlog

from robots.agent.devices.device_address import DeviceSetting
from robots.agent.robot_interface import AdapterError

log = structlog.stdlib.get_logger(__name__)

FAILURES = (av.FFmpegError, OSError, ValueError)


@dataclass(frozen=True)
class ReaderLimits:
    """Times in seconds."""

    network: float = 25.0  # FFmpeg's own, after all others: it says less about why
    # to the first frame: cameras of the network take up to 3 to be opened, and up to 10 from one
    # whole picture to the next
    opening: float = 20.0
    ending: float = 0.5  # to wait for the thread's end
    # between a picture's own time and now, up to which its own is believed
    clocks_agree: float = 2.0
    leap: float = 1.0  # a file whose times leap more is restarted
    left_behind: int = 3  # threads that may hang in the device


LIMITS = ReaderLimits()


class ReaderStage(Enum):
    """The progress of opening a device; the value names the missing step."""

    CALLED = "does not answer"
    OPENED = "answers but sends nothing"
    SENDING = "has sent no key frame"
    SHOWN = ""


# Of FFmpeg's errors those that an owner can do something about, the special before the general.
REASONS: tuple[tuple[type[Exception], str], ...] = (
    (av.HTTPUnauthorizedError, "wrong user name or password (401)"),
    (av.HTTPForbiddenError, "this user may not see it (403)"),
    (av.HTTPNotFoundError, "it has no such stream (404)"),
    (av.HTTPServerError, "it reports an error of its own (5XX)"),
    (av.ConnectionRefusedError, "connection refused"),
    (av.DecoderNotFoundError, "its codec is not supported"),
    (av.ExitError, "it does not answer"),
)
BROKEN = "input/output error: it was cut off, or TLS could not be agreed"  # FFmpeg's EIO

Take = Callable[[Any, float], None]


class DeviceReader:
    """Reads one stream while it runs; `name` is for sentences, such as `camera`. `take` is called
    in the reader's thread with each decoded frame and its capture time (Unix s).
    """

    def __init__(
        self,
        name: str,
        words: DeviceSetting,
        kind: Literal["video", "audio"],
        take: Take,
        limits: ReaderLimits = LIMITS,
    ) -> None:
        self.name, self.words, self.kind, self.limits = name, words, kind, limits
        self._take = take
        self._run: _Run | None = None
        self._left_behind: list[threading.Thread] = []

    def start(self) -> None:
        """Start reading; idempotent. Raises AdapterError when too many threads hang in it."""
        if self._run is not None:
            return
        self._left_behind = [thread for thread in self._left_behind if thread.is_alive()]
        if len(self._left_behind) >= self.limits.left_behind:
            raise AdapterError(f"the {self.name} {self.words.place} hangs: reconnect it")
        self._run = _Run(self)
        self._run.thread.start()

    def stop(self) -> None:
        """Stop reading; idempotent. Waits at most half a second for the device."""
        run, self._run = self._run, None
        if run is not None:
            run.ending.set()
            run.thread.join(self.limits.ending)
            if run.thread.is_alive():
                log.warning("device_hung", name=self.name, address=self.words.place)
                self._left_behind.append(run.thread)

    def check(self) -> None:
        """Raise AdapterError when the device is gone, or was not opened in time."""
        if self._run is None:
            return
        failure = self._run.failure
        is_late = time.monotonic() - self._run.began > self.limits.opening
        if not failure and is_late and self._run.stage is not ReaderStage.SHOWN:
            failure = f"{self._run.stage.value} within {self.limits.opening:g} s"
        if failure:
            raise AdapterError(f"the {self.name} {self.words.place} {failure}")

    @property
    def failed(self) -> bool:
        return self._run is not None and bool(self._run.failure)

    def deliver(self, run: "_Run", frame: Any, stamp: float) -> None:
        """Pass on a frame, unless it is of an earlier run."""
        if run is self._run and not run.ending.is_set():
            run.stage = ReaderStage.SHOWN
            self._take(frame, stamp)


class _Run:
    def __init__(self, reader: DeviceReader) -> None:
        self.reader = reader
        self.ending = threading.Event()
        self.failure = ""
        self.stage = ReaderStage.CALLED
        self.began = time.monotonic()
        self.thread = threading.Thread(target=self._read, name=f"device-{reader.name}", daemon=True)

    def _read(self) -> None:
        try:
            for _ in itertools.count():
                if not self._read_once():
                    self.failure = "gives nothing"
                elif self.reader.words.live and not self.ending.is_set():
                    self.failure = "has ended"
                if self.failure or self.ending.is_set():
                    return
        except Exception as error:
            self.failure = f"cannot be read: {reason_of(error)}"
            if not isinstance(error, FAILURES):
                raise

    def _read_once(self) -> bool:
        words, some = self.reader.words, False
        limits = (self.reader.limits.network,) * 2
        form = words.format or None
        with av.open(
            words.address, format=form, options=words.options, timeout=limits
        ) as container:
            frames = self._frames(container)
            for frame, stamp in self._stamped(frames) if words.live else self._paced(frames):
                some = True
                self.reader.deliver(self, frame, stamp)
        return some

    def _frames(self, container: Any) -> Iterator[Any]:
        streams = getattr(container.streams, self.reader.kind)
        if not streams:
            raise ValueError(f"it contains no {self.reader.kind}")
        if streams[0].codec_context is None:
            raise ValueError("its codec is not supported")
        self.stage = ReaderStage.OPENED
        for packet in container.demux(streams[0]):
            if self.stage is ReaderStage.OPENED:
                self.stage = ReaderStage.SENDING
            for frame in _decoded(packet):
                if self.ending.is_set():
                    return
                yield frame
            if self.ending.is_set():
                return

    def _stamped(self, frames: Iterator[Any]) -> Iterator[tuple[Any, float]]:
        """Yield live frames with their own times if these are plausible."""
        for frame in frames:
            now = time.time()
            age = math.inf if frame.time is None else now - frame.time
            yield frame, frame.time if 0.0 <= age < self.reader.limits.clocks_agree else now

    def _paced(self, frames: Iterator[Any]) -> Iterator[tuple[Any, float]]:
        """Yield a file's frames at their times, without catching up after a delay."""
        began, last = 0.0, math.inf  # the first frame begins
        leap = self.reader.limits.leap
        for frame in frames:
            at, now = frame.time or 0.0, time.monotonic()
            if not (0.0 <= at - last < leap and now - (began + at) <= leap):
                began = now - at
            last = at
            if self.ending.wait(max(0.0, began + at - now)):
                return
            yield frame, time.time()


def _decoded(packet: Any) -> Iterator[Any]:
    """Yield a packet's frames; one that lacks an earlier frame waits for a key frame."""
    try:
        yield from packet.decode()
    except av.InvalidDataError:
        log.debug("packet_undecodable")


def reason_of(error: Exception) -> str:
    """Return why FFmpeg failed, without the address, which may contain a password."""
    for kind, reason in REASONS:
        if isinstance(error, kind):
            return reason
    if getattr(error, "errno", None) == errno.EIO:
        return BROKEN
    return getattr(error, "strerror", "") or str(error) or type(error).__name__
