"""Ending tasks."""

import asyncio
import gc

import pytest

from robots.cancellation import cancel


async def test_what_a_task_raises_late_is_dropped_though_nobody_waits_for_it_any_more():
    told = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _loop, context: told.append(context["message"]))
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
    assert told == []
