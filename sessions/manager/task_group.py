"""Tasks that run until one of them ends."""

import asyncio
from collections.abc import Coroutine
from typing import Any

from robots.cancellation import cancel


async def until_one_ends(*works: Coroutine[Any, Any, None]) -> None:
    """Run things side by side until one of them ends, or raises, which is then raised here; the
    others are cancelled.
    """
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        await cancel(*tasks)
