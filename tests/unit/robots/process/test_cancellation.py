"""Cancelling tasks."""

import asyncio
import gc

import pytest

from robots.process.cancellation import cancel


async def test_a_late_exception_of_a_cancelled_task_is_dropped():
    reported = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _loop, context: reported.append(context["message"]))
    ends = asyncio.Event()

    async def raises_late():
        try:
            await asyncio.Future()
        finally:
            await ends.wait()
            raise KeyError("late")

    task = asyncio.create_task(raises_late())
    await asyncio.sleep(0)
    ending = asyncio.create_task(cancel(task))
    await asyncio.sleep(0)
    ending.cancel()
    with pytest.raises(asyncio.CancelledError):
        await ending
    ends.set()
    await asyncio.wait({task})
    del task
    gc.collect()
    await asyncio.sleep(0)
    assert reported == []
