"""Ending tasks for certain.

Until Python 3.12 `asyncio.wait_for`, which aiomqtt rests on, now and then forgets a cancellation
that arrives together with what it waits for. So a task is cancelled until it is done, and never
only once.
"""

import asyncio
from collections.abc import Awaitable
from typing import Any

AGAIN_S = 0.5


async def cancel(*tasks: "asyncio.Future[Any]") -> None:
    """Cancel tasks and wait until they have ended; what they raise is dropped, also when this is
    cancelled while it waits.
    """
    for task in tasks:
        task.add_done_callback(_drop)
    pending = {task for task in tasks if not task.done()}
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=AGAIN_S)


async def until_one_ends(*works: Awaitable[Any]) -> None:
    """Run things side by side until one of them ends, or raises, which is then raised here; the
    others are cancelled.
    """
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        await cancel(*tasks)


def _drop(task: "asyncio.Future[Any]") -> None:
    """Retrieve the exception of a task; otherwise asyncio logs that it was never retrieved."""
    if not task.cancelled():
        task.exception()
