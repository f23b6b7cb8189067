"""Tasks that run until one of them ends, and tasks that are made to end.

On Python 3.11 `asyncio.wait_for`, which aiomqtt rests on, now and then swallows a cancellation that arrives together with what it
waits for. So a task is cancelled until it is done, and never only once.
"""

import asyncio
from collections.abc import Coroutine
from typing import Any

AGAIN_SECONDS = 0.5


async def end(*tasks: "asyncio.Task[Any]") -> None:
    """Cancel tasks and wait until they have ended; what they raise is dropped."""
    pending = {task for task in tasks if not task.done()}
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=AGAIN_SECONDS)
    await asyncio.gather(*tasks, return_exceptions=True)


async def until_one_ends(*works: Coroutine[Any, Any, None]) -> None:
    """Run things side by side until one of them ends, or raises, which is then raised here; the others are cancelled."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        await end(*tasks)
