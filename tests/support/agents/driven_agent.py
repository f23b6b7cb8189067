"""`python -m tests.support.agents.driven_agent JSON`: an agent with its driver, in one process,
made to be killed and stopped.

Everything between the adapter and the driver is the agent's own. The driver drives all the time
with dated orders (orders.py), and releases the keys when a stop holds the robot. JSON: `adapter`,
`profile`, `options`, `directory`, and `began`, the monotonic time from which orders are dated.
"""

import json
import sys
import time
from pathlib import Path

from robots.agent.adapters import registry
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.agents.orders import DatedOrders

RENEWAL = 1.0


def drive(rig, orders):
    epoch, renewal, renewed = 0, 0, 0.0
    while True:
        now = time.monotonic()
        if rig.kernel.leases.live(now) is None:
            epoch, renewal, renewed = epoch + 1, 0, now
            rig.lease(epoch=epoch)
            rig.know_clock()
        if now - renewed > RENEWAL:
            renewal, renewed = renewal + 1, now
            rig.lease(epoch=epoch, renewal=renewal)
        if rig.kernel.inhibited(now):
            rig.push(0.0, epoch=epoch)
        else:
            linear, angular = orders.now()
            rig.push(linear, angular=angular, epoch=epoch)
        time.sleep(0.05)


def main(text):
    wish = json.loads(text)
    adapter = registry.create(wish["adapter"], wish["profile"], wish["options"])
    rig = ThreadedControlRig(Path(wish["directory"]), robot=adapter)
    rig.control.start(rig.media)
    rig.wait(lambda: rig.link.connected and rig.kernel.fault is None, 20.0)
    drive(rig, DatedOrders(wish["began"]))


if __name__ == "__main__":
    main(sys.argv[1])
