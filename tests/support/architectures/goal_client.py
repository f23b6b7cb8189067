"""An adapter in a process of its own that sends the robot to a goal, for tests to kill or freeze:
`python -m tests.support.architectures.goal_client WISH`, a JSON object of adapter, profile,
options, x and y. Each progress is a line on standard output.
"""

import asyncio
import contextlib
import json
import subprocess
import sys

from robots.agent.adapters import registry
from robots.api.geometry import Pose2D
from robots.api.messages import Goto
from tests.support.agents.agent_process import wait
from tests.support.paths import ROOT


@contextlib.contextmanager
def going(rig, ahead=3.0):
    """Yield the process while the robot drives to a point so many metres ahead."""
    place = rig.world.truth.compose(Pose2D(ahead, 0.0, 0.0))
    wish = {
        "adapter": rig.adapter_name,
        "profile": rig.profile,
        "options": rig.options(),
        "x": place.x,
        "y": place.y,
    }
    command = [sys.executable, "-m", "tests.support.architectures.goal_client", json.dumps(wish)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"RUNNING\n"
        wait(lambda: rig.world.sim.motion.linear >= 0.2)
        yield process
    finally:
        process.kill()
        process.wait()


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
