"""How long the event loop was blocked."""

import asyncio
import contextlib
import time


@contextlib.asynccontextmanager
async def longest_gap():
    """Yield a function that returns the longest time in seconds for which the loop was blocked."""
    gaps = [0.0]

    async def tick():
        at = time.monotonic()
        while True:
            await asyncio.sleep(0.01)
            gaps.append(time.monotonic() - at - 0.01)
            at = time.monotonic()

    ticking = asyncio.create_task(tick())
    await asyncio.sleep(0)
    try:
        yield lambda: max(gaps)
        await asyncio.sleep(0.02)
    finally:
        ticking.cancel()
