"""Pictures through the server, as JPEG, for pages that no WebRTC path reaches.

See pace.py for when and how large. A thread encodes while pages ask, so as to delay neither
commands nor the video of pages on WebRTC; the camera runs as it does for viewers.
"""

import threading
import time
from collections.abc import Callable

import structlog

from robots.agent.media.capture.capture import FAILURES
from robots.agent.media.codecs.encoder import fitted
from robots.agent.media.jpeg_fallback.pace import StillPace
from robots.agent.media.photos import reduced
from robots.agent.robot_interface import Frame
from robots.agent.thread_priority import ORDINARY, set_nice
from robots.api import picture, topics
from robots.api.messages import PictureRequest
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

LIMIT = next(topic.limit for topic in topics.TABLE if topic.suffix == picture.SUFFIX)
CLOSE_TIMEOUT = 4.0  # s


class JpegFallback:
    """Sends a picture for each request. All methods may be called from any thread.

    `snapshot` blocks for a fresh frame, or None; `send` is called in the thread of this class with
    each packed picture and the peers that wait for it.
    """

    def __init__(
        self,
        snapshot: Callable[[], Frame | None],
        send: Callable[[bytes, frozenset[str]], None],
        is_driver: Callable[[str], bool],
    ) -> None:
        self._snapshot, self._send = snapshot, send
        self._pace = StillPace(is_driver)
        self._changed = threading.Condition()
        self._closing = False
        self._thread: threading.Thread | None = None
        self.sent = 0

    def ask(self, peer: str, request: PictureRequest) -> None:
        """Take a page's request for one more picture."""
        with self._changed:
            self._pace.ask(peer, request.seen, request.round_trip, time.monotonic())
            if not self._closing and (self._thread is None or not self._thread.is_alive()):
                self._thread = threading.Thread(target=self._run, name="slow-pictures", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def expect(self, delay: float) -> None:
        """Note for how many seconds a network lab holds the driver's pictures."""
        with self._changed:
            self._pace.delay = delay

    def watching(self) -> frozenset[str]:
        """Return the peers that have asked within the last seconds."""
        with self._changed:
            return self._pace.watching(time.monotonic())

    def close(self) -> None:
        """End the thread; waits at most some seconds. Idempotent."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(CLOSE_TIMEOUT)

    def _run(self) -> None:
        set_nice(ORDINARY)  # the control loop started it, whose priority it must not have
        while self._wait_until_due():
            try:
                self._send_one()
            except FAILURES as error:
                log.warning("jpeg_fallback_failed", reason=reason_of(error))
                self._failed()

    def _wait_until_due(self) -> bool:
        with self._changed:
            while not self._closing and (wait := self._pace.wait(time.monotonic())) != 0.0:
                self._changed.wait(wait)
            return not self._closing

    def _send_one(self) -> None:
        frame = self._snapshot()
        if frame is None:
            self._failed()
            return
        layer = self._pace.layer()
        size = fitted(layer.tier, frame.width, frame.height)
        payload = picture.pack(frame.stamp, reduced(frame, *size, layer.quantizer))
        if len(payload) > LIMIT:
            with self._changed:
                self._pace.quality.too_large()
            self._failed()
            return
        with self._changed:
            waited = self._pace.sent(frame.stamp, time.monotonic())
        self.sent += 1
        self._send(payload, waited)

    def _failed(self) -> None:
        with self._changed:
            self._pace.failed(time.monotonic())
