"""`python -m tests.support.agents.navigating_agent JSON`: an adapter that sends its robot to a
goal, in a process that is made to be killed and stopped.

It does with an adapter what the kernel does, and no more: it reconnects, forwards the navigation's
velocities where they pass through the agent, starts the action of a line on standard input (`goto X
Y` or `dock`), and after `cancel` cancels it every 0.5 s until that is confirmed. JSON: `adapter`,
`profile`, `options`. Each event is a JSON line.
"""

import asyncio
import contextlib
import json
import sys
import time

from robots.agent.adapters import registry
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.messages import Dock, Goto, Velocity

ZERO = Velocity(linear=0.0, angular=0.0)
ACTIONS = {
    "goto": lambda x, y: Goto(action_id="action", stamp=0.0, x=float(x), y=float(y), theta=0.0),
    "dock": lambda: Dock(action_id="action", stamp=0.0),
}


def report(**event):
    print(json.dumps({"at": time.monotonic(), **event}), flush=True)


async def pass_velocities(adapter):
    moving = False
    while True:
        with contextlib.suppress(AdapterError):
            wanted = adapter.wanted()
            if wanted is not None or moving:
                adapter.apply(wanted or ZERO)
                moving = wanted not in {None, ZERO}
        await asyncio.sleep(0.02)


async def read_progress(adapter):
    async for news in adapter.progress():
        report(status=news.status, reason=news.reason)


async def obey(adapter):
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin
    )
    while line := await reader.readline():
        word, *rest = line.decode().split()
        if word == "cancel":
            while not await adapter.cancel("action"):
                await asyncio.sleep(0.5)
            continue
        try:
            await adapter.start(ACTIONS[word](*rest))
        except AdapterError as error:
            report(failed=str(error), refused=isinstance(error, ActionRefusedError))


async def main(wish):
    adapter = registry.create(wish["adapter"], wish["profile"], wish["options"])
    report(control=adapter.profile.navigation_control)
    errors = ()
    work = [read_progress(adapter), pass_velocities(adapter), obey(adapter)]
    tasks = [asyncio.ensure_future(each) for each in work]
    while True:
        try:
            await adapter.connect()
            report(ready=True)
            async for state in adapter.states():
                if state.errors != errors:
                    errors = state.errors
                    report(errors=errors)
        except AdapterError as error:
            report(lost=str(error))
            await asyncio.sleep(0.5)
        assert not any(task.done() for task in tasks), tasks


if __name__ == "__main__":
    asyncio.run(main(json.loads(sys.argv[1])))
