"""An adapter in a process of its own that sends the robot to a goal, so that a test can kill or
freeze it: `python -m tests.support.architectures.goal_client WISH`, a JSON object of adapter,
profile, options, x and y. Each progress is a line on standard output.
"""

import asyncio
import json
import sys

from robots.agent.adapters import registry
from robots.api.messages import Goto


async def main(wish):
    adapter = registry.create(wish["adapter"], wish["profile"], wish["options"])
    await adapter.connect()

    async def report():
        async for news in adapter.progress():
            sys.stdout.write(f"{news.status}\n")
            sys.stdout.flush()

    reporting = asyncio.ensure_future(report())
    await adapter.start(Goto(action_id="g", stamp=0.0, x=wish["x"], y=wish["y"]))
    async for _ in adapter.states():
        pass
    reporting.cancel()


if __name__ == "__main__":
    asyncio.run(main(json.loads(sys.argv[1])))
