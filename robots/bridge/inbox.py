"""The queue of aiomqtt's received messages, for a server that handles each one at once."""

import asyncio
from collections.abc import Callable

import aiomqtt
import structlog

log = structlog.stdlib.get_logger(__name__)


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """Calls `receive` at once, without a task for each message (saves a quarter of the CPU)."""

    def __init__(self, receive: Callable[[aiomqtt.Message], None], maxsize: int = 0) -> None:
        super().__init__(maxsize)
        self._receive = receive

    def put_nowait(self, item: aiomqtt.Message) -> None:
        """Pass a message on. aiomqtt would end the connection for an exception, and the next one
        would receive a retained message again.
        """
        try:
            self._receive(item)
        except Exception:
            log.exception("message_failed", topic=str(item.topic))
