"""The way out to one page: a mailbox, the task that empties it as fast as the page's network takes
it, and the last frame.
"""

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
LAST_WORDS_SECONDS = 2.0
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
        """Tell whether the end has been decided."""
        return self._ending is not None

    def post(self, suffix: str, message: Message) -> None:
        """Send the page something of the server's own, which is never dropped."""
        self.put(outgoing(suffix, message))

    def notify(self, notice: protocol.Notice) -> None:
        """Send the page a notice."""
        self.put(Outgoing(protocol.notice_frame(notice)))

    def put(self, out: Outgoing) -> None:
        """Send the page a frame; one that lets too much pile up is sent away."""
        if not self.queue.put(out.frame, droppable=out.droppable):
            self.end(protocol.TOO_SLOW)

    def put_picture(self, frame: bytes) -> None:
        """Send the page a picture, or a newer one when its network does not take
        this one in time.
        """
        self.queue.put_picture(frame)

    def end(self, code: int) -> None:
        """Close the connection after what is already posted, once."""
        if self._ending is None:
            self._ending = asyncio.get_running_loop().create_task(self._close_after_mail(code))

    def abandon(self) -> None:
        """The page is gone: send nothing more."""
        self._pumping.cancel()

    async def _close_after_mail(self, code: int) -> None:
        patience = 0.0 if code in {protocol.TOO_SLOW, protocol.FLOODED} else LAST_WORDS_SECONDS
        await self.queue.wait_empty(patience)
        await self._close(code)

    async def _pump(self) -> None:
        while True:
            await self._send(await self.queue.take())
            SEND_SECONDS.observe(time.monotonic() - self.queue.taken_from)
            while self._is_full():  # noqa: ASYNC110 -- the server has no event for it
                await asyncio.sleep(FULL_POLL_SECONDS)
