"""Reliable cancellation of tasks.

Before Python 3.12, `asyncio.wait_for`, which aiomqtt uses, sometimes loses a cancellation that
arrives together with its result. Therefore a task is cancelled repeatedly, until it has ended.
"""

import asyncio
from collections.abc import Awaitable
from typing import Any

AGAIN_S = 0.5


async def cancel(*tasks: "asyncio.Future[Any]") -> None:
    """Cancel tasks and wait until they have ended. Their exceptions are dropped, also when this
    wait is cancelled.
    """
    for task in tasks:
        task.add_done_callback(_drop)
    pending = {task for task in tasks if not task.done()}
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=AGAIN_S)


async def until_one_ends(*works: Awaitable[Any]) -> None:
    """Run awaitables concurrently until one ends, and cancel the others; raise its exception."""
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
