"""`python -m tests.support.agents.driving_agent ADDRESS LINEAR drive|media`: the smallest agent,
made to be killed.

ADDRESS is where a simulator runs, or `child` for one of its own.
"""

import asyncio
import sys
import threading

from robots.agent.adapters.registry import create
from robots.agent.adapters.simulator import adapter as simulator
from robots.api.messages import Velocity


def watch(adapter, seen: threading.Event) -> None:
    camera = adapter.video()
    camera.start()
    while True:
        if camera.read(1.0) is not None:
            seen.set()


async def drive(address: str, linear: float, media: bool) -> None:
    options = {"start": "corridor-centre"} if address == "child" else {"address": address}
    adapter = create("simulator", "giraff", options)
    await adapter.connect()
    seen = threading.Event()
    if media:
        threading.Thread(target=watch, args=(adapter, seen), daemon=True).start()
        await asyncio.to_thread(seen.wait)
    reported = False
    async for state in adapter.states():
        adapter.apply(Velocity(linear=linear, angular=0.0))
        if not reported and abs(state.velocity.linear) > 0.2:
            reported = True
            print("driving", flush=True)
            if address == "child":
                print(adapter.address, flush=True)


if __name__ == "__main__":
    # a process that is suspended, or a robot that waits for the processor, is not lost
    simulator.SILENCE = 30.0
    asyncio.run(drive(sys.argv[1], float(sys.argv[2]), sys.argv[3] == "media"))
