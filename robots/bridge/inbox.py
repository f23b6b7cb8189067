"""Where aiomqtt queues what arrives, for a server that takes every message the moment it comes."""

import asyncio
from collections.abc import Callable

import aiomqtt
import structlog

log = structlog.stdlib.get_logger(__name__)


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """Hands every message on by itself: a task and a turn of the loop less for each (measured: a
    quarter of the CPU).
    """

    def __init__(self, receive: Callable[[aiomqtt.Message], None], maxsize: int = 0) -> None:
        super().__init__(maxsize)
        self._receive = receive

    def put_nowait(self, item: aiomqtt.Message) -> None:
        """Hand a message on. aiomqtt would take an exception for the end of the connection, and
        meet a retained message again on the next one.
        """
        try:
            self._receive(item)
        except Exception:
            log.exception("message_failed", topic=str(item.topic))
