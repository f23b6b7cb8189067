"""Decodes one stream of a device, a file or an address, in a thread of its own: a device that hangs hangs nobody else.

Each start has a thread and a state of its own. A thread that does not come back from its device is left behind, and whatever it
still says counts for nothing.
"""

import itertools
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Literal

import av

from robots.agent.adapters.contract import AdapterError
from robots.agent.devices.words import DeviceWords

log = logging.getLogger(__name__)

PATIENCE = 0.5  # s to wait for the thread's end
NETWORK_TIMEOUT = (5.0, 5.0)  # s to open an address, and to read from it
CLOCKS_AGREE = 2.0  # s between a picture's own time and now, up to which its own is believed
LEAP = 1.0  # s: a file whose times leap more is begun anew
FAILURES = (av.FFmpegError, OSError, ValueError)

Take = Callable[[Any, float], None]


class Reader:
    """Reads one stream while it runs.

    Args:
        name: for sentences, such as `camera`.
        words: what to read.
        kind: which of its streams.
        take: called in the reader's thread with each decoded frame and the Unix time when it was captured.
    """

    def __init__(self, name: str, words: DeviceWords, kind: Literal["video", "audio"], take: Take) -> None:
        self.name, self.words, self.kind = name, words, kind
        self._take = take
        self._run: _Run | None = None

    def start(self) -> None:
        """Begin to read; idempotent while it runs."""
        if self._run is None:
            self._run = _Run(self)
            self._run.thread.start()

    def stop(self) -> None:
        """Stop reading; idempotent. Waits for the device half a second at most."""
        run, self._run = self._run, None
        if run is not None:
            run.ending.set()
            run.thread.join(PATIENCE)
            if run.thread.is_alive():
                log.warning("device_hangs name=%s address=%s", self.name, self.words.address)

    def check(self) -> None:
        """Raise AdapterError with the reason when the device is gone."""
        if self._run is not None and self._run.failure:
            raise AdapterError(f"the {self.name} {self.words.address} {self._run.failure}")

    @property
    def failed(self) -> bool:
        """Tell whether the device is gone."""
        return self._run is not None and bool(self._run.failure)

    def deliver(self, run: "_Run", frame: Any, stamp: float) -> None:
        """Hand on what a run has read, unless it is one of before."""
        if run is self._run and not run.ending.is_set():
            self._take(frame, stamp)


class _Run:
    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        self.ending = threading.Event()
        self.failure = ""
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
        except FAILURES as error:
            self.failure = f"cannot be read: {_reason(error)}"

    def _read_once(self) -> bool:
        """Read to the end; tell whether there was anything."""
        words, some = self.reader.words, False
        with av.open(words.address, format=words.format or None, options=words.options, timeout=NETWORK_TIMEOUT) as container:
            for frame, stamp in self._paced(self._frames(container)) if not words.live else self._as_they_come(self._frames(container)):
                some = True
                self.reader.deliver(self, frame, stamp)
        return some

    def _frames(self, container: Any) -> Iterator[Any]:
        streams = container.streams.video if self.reader.kind == "video" else container.streams.audio
        if not streams:
            raise ValueError(f"there is no {self.reader.kind} in it")
        for frame in container.decode(streams[0]):
            if self.ending.is_set():
                return
            yield frame

    def _as_they_come(self, frames: Iterator[Any]) -> Iterator[tuple[Any, float]]:
        for frame in frames:
            now = time.time()
            yield frame, frame.time if frame.time is not None and 0.0 <= now - frame.time < CLOCKS_AGREE else now

    def _paced(self, frames: Iterator[Any]) -> Iterator[tuple[Any, float]]:
        """Give a file's frames at their times, without catching up on what a slow computer has missed."""
        began = last = None
        for frame in frames:
            at, now = frame.time or 0.0, time.monotonic()
            if began is None or last is None or not 0.0 <= at - last < LEAP or now - (began + at) > LEAP:
                began = now - at
            last = at
            if self.ending.wait(max(0.0, began + at - now)):
                return
            yield frame, time.time()


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", "") or str(error) or type(error).__name__
