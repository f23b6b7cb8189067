"""Sends frames to one page, as fast as its network takes them."""

import asyncio
import time
from collections.abc import Awaitable, Callable

from prometheus_client import Histogram

from robots.api.messages import Message
from robots.bridge.bridge import BUCKETS
from sessions import protocol
from sessions.consumers.relay import Outgoing, outgoing
from sessions.consumers.send_queue import SendQueue

FULL_POLL_SECONDS = 0.02
DRAIN_SECONDS = 2.0  # longest wait for queued frames before the connection is closed
SEND_SECONDS = Histogram(
    "telepresence_relay_to_page_seconds",
    "Time from a message for a page to its WebSocket.",
    buckets=BUCKETS,
)


class Sender:
    """Frames for one page.

    Args:
        send: gives a frame to the server.
        close: ends the connection with a code.
        is_full: tells whether the server still holds frames that the network has not taken
            (sessions/backpressure.py).
    """

    def __init__(
        self,
        send: Callable[[str | bytes], Awaitable[None]],
        close: Callable[[int], Awaitable[None]],
        is_full: Callable[[], bool],
    ) -> None:
        self._send, self._close, self._is_full = send, close, is_full
        self._ending: asyncio.Task[None] | None = None
        self.queue = SendQueue()
        self._pumping = asyncio.get_running_loop().create_task(self._pump())

    @property
    def closed(self) -> bool:
        """Tell whether the connection is about to close."""
        return self._ending is not None

    def post(self, suffix: str, message: Message) -> None:
        """Send the page a message of the server, which is never dropped."""
        self.put(outgoing(suffix, message))

    def notify(self, notice: protocol.Notice) -> None:
        """Send the page a notice."""
        self.put(Outgoing(protocol.notice_frame(notice)))

    def put(self, out: Outgoing) -> None:
        """Send the page a frame; close the connection of a page that is too slow."""
        if not self.queue.put(out.frame, droppable=out.droppable):
            self.end(protocol.TOO_SLOW)

    def put_picture(self, frame: bytes) -> None:
        """Send the page a picture, unless a newer one comes before its network takes this one."""
        self.queue.put_picture(frame)

    def end(self, code: int) -> None:
        """Close the connection after the frames that are already queued, once."""
        if self._ending is None:
            self._ending = asyncio.get_running_loop().create_task(self._close_when_sent(code))

    def abandon(self) -> None:
        """Send nothing more: the page has closed."""
        self._pumping.cancel()

    async def _close_when_sent(self, code: int) -> None:
        drain = code not in {protocol.TOO_SLOW, protocol.FLOODED}
        await self.queue.wait_empty(DRAIN_SECONDS if drain else 0.0)
        await self._close(code)

    async def _pump(self) -> None:
        while True:
            await self._send(await self.queue.take())
            SEND_SECONDS.observe(time.monotonic() - self.queue.taken_from)
            while self._is_full():  # noqa: ASYNC110 -- the server has no event for it
                await asyncio.sleep(FULL_POLL_SECONDS)
