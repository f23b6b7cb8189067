"""A camera or a microphone in a thread of its own: started while in use, retried when it fails.

Reading blocks and encoding takes milliseconds, so neither may happen on an event loop. When a
source fails its viewers stay connected: they see the last frame and a reason, and the video resumes
when the source works again.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import av
import structlog

from robots.agent.robot_interface import AdapterError
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)


@dataclass(frozen=True)
class CaptureLimits:
    """Times in seconds."""

    # from the start to the first data: more than devices/reader.py waits, whose error says more
    opening: float = 25.0
    stall: float = 2.0  # without data
    # it keeps running after the last viewer, so that a page that reconnects does not restart it
    linger: float = 1.0
    read: float = 0.5
    first_retry: float = 0.25
    last_retry: float = 5.0


LIMITS = CaptureLimits()

# what a source or an encoder may raise: an adapter's or the system's error, a frame of the wrong
# shape, FFmpeg's errors
FAILURES = (AdapterError, OSError, ValueError, av.FFmpegError)


class CaptureSource(Protocol):
    """A camera or a microphone, as far as they are alike."""

    def start(self) -> None: ...

    def stop(self) -> None: ...


Status = Literal["idle", "starting", "live", "failed"]


@dataclass(frozen=True)
class CaptureState:
    """The state of a source: `idle` is not in use. `reason` is why it failed, also while it starts
    again.
    """

    status: Status
    reason: str = ""


class Capture:
    """Runs a source while it is wanted, in a thread of its own.

    `begin` is called before each start, to open a fresh encoder; `step` reads once, for at most the
    given seconds, and uses the data; it returns False without any. Both may raise FAILURES.
    """

    def __init__(
        self,
        name: str,
        source: CaptureSource,
        begin: Callable[[], None],
        step: Callable[[float], bool],
        limits: CaptureLimits = LIMITS,
    ) -> None:
        self._name = name
        self._limits = limits
        self._source = source
        self._begin = begin
        self._step = step
        self._changed = threading.Condition()
        self._wanted = 0
        self._unwanted_since = float("-inf")
        self._closing = False
        self._state = CaptureState("idle")
        self._thread: threading.Thread | None = None

    @property
    def state(self) -> CaptureState:
        return self._state

    def start(self) -> None:
        """Start the thread, again after an unexpected error."""
        if self._closing or (self._thread is not None and self._thread.is_alive()):
            return
        if self._thread is not None:
            log.error("capture_thread_died", source=self._name)
        self._thread = threading.Thread(target=self._run, name=f"capture-{self._name}", daemon=True)
        self._thread.start()

    def close(self, timeout: float = 3.0) -> None:
        """Stop the source and the thread; waits at most `timeout` seconds."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(timeout)

    def want(self, number: int) -> None:
        """Note that `number` more (or fewer, when negative) use the source."""
        with self._changed:
            self._wanted += number
            if self._wanted == 0:
                self._unwanted_since = time.monotonic()
            self._changed.notify_all()

    def _run(self) -> None:
        limits = self._limits
        delay = limits.first_retry
        while self._wait_until_wanted():
            try:
                self._set_state("starting", self._state.reason)
                self._begin()
                self._source.start()
                self._read_while_wanted()
                delay = limits.first_retry
                self._set_state("idle")
            except FAILURES as error:
                worked = self._state.status == "live"
                delay = limits.first_retry if worked else min(delay * 2, limits.last_retry)
                self._set_state("failed", reason_of(error))
            finally:
                self._stop_source()
            if self._state.status == "failed":
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, timeout=delay)

    def _read_while_wanted(self) -> None:
        limits = self._limits
        read_at, patience = time.monotonic(), limits.opening
        while not self._closing and (
            self._wanted > 0 or time.monotonic() - self._unwanted_since < limits.linger
        ):
            if self._step(limits.read):
                read_at, patience = time.monotonic(), limits.stall
                self._set_state("live")
            elif time.monotonic() - read_at > patience:
                raise AdapterError(f"the {self._name} sent no data for {patience:g} s")

    def _stop_source(self) -> None:
        try:
            self._source.stop()
        except FAILURES as error:
            log.warning("capture_stop_failed", source=self._name, reason=reason_of(error))

    def _wait_until_wanted(self) -> bool:
        with self._changed:
            self._changed.wait_for(lambda: self._closing or self._wanted > 0)
            return not self._closing

    def _set_state(self, status: Status, reason: str = "") -> None:
        state = CaptureState(status, reason)
        if state != self._state:
            log.info("capture_state", source=self._name, status=status, reason=str(reason))
            self._state = state
