"""What waits for a loop that hangs is bounded."""

import asyncio
import math
import threading

from robots.agent.loop_calls import LoopCalls


class HungLoop:
    """A loop in a thread that runs nothing until `resume`."""

    def __init__(self, calls):
        self._go_on = threading.Event()
        self.calls = calls
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()))

    async def _main(self):
        self._ending = asyncio.Event()
        self.calls.loop = asyncio.get_running_loop()
        self._go_on.wait()
        await self._ending.wait()

    def __enter__(self):
        self._thread.start()
        while self.calls.loop is None:
            pass
        return self

    def resume(self):
        self._go_on.set()
        self.calls.post(lambda: self._ending.set(), most=math.inf)
        self._thread.join(10.0)

    def __exit__(self, *_):
        self.resume()


def test_calls_to_a_hung_loop_are_dropped_beyond_their_number_and_counted(caplog):
    done = []
    with HungLoop(LoopCalls("media")) as hung:
        for number in range(100):
            hung.calls.post(done.append, number, most=10)
        for number in range(100, 105):
            hung.calls.post(done.append, number, most=15)
        hung.calls.post(done.append, "vital", most=math.inf)
        hung.resume()
    assert done == [*range(10), *range(100, 105), "vital"]
    assert "loop_calls_dropped" in caplog.text
    assert "90" in caplog.text


def test_a_loop_that_continues_accepts_calls_again():
    done = []

    async def main():
        calls = LoopCalls("media")
        calls.loop = asyncio.get_running_loop()
        for _ in range(3):
            for number in range(5):
                calls.post(done.append, number, most=2)
            await asyncio.sleep(0)

    asyncio.run(main())
    assert done == [0, 1] * 3


def test_a_call_that_raises_does_not_hold_up_the_next():
    done = []

    async def main():
        calls, errors = LoopCalls("media"), []
        calls.loop = asyncio.get_running_loop()
        calls.loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
        calls.post(lambda: 1 / 0)
        calls.post(done.append, "next")
        await asyncio.sleep(0)
        assert [type(error) for error in errors] == [ZeroDivisionError]

    asyncio.run(main())
    assert done == ["next"]


def test_calls_are_ignored_before_and_after_the_loop():
    calls = LoopCalls("media")
    calls.post(lambda: 1 / 0)
    calls.loop = asyncio.new_event_loop()
    calls.loop.close()
    calls.post(lambda: 1 / 0)
