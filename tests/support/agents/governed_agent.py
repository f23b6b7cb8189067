"""`python -m tests.support.agents.governed_agent JSON`: as navigating_agent.py, with the agent's
own control loop and kernel, and a driver whose heartbeats do not tire.

Lines on standard input: `goto`, to `goal` or 60 m ahead; `dock`; `stop`; `drive`, the driver holds
a key; `hang`, the control thread hangs for HANG seconds, and the driver releases the key RELEASED
seconds after it began. JSON: `adapter`, `profile`, `options`, `directory` and `goal`. Each event is
a JSON line.
"""

import json
import sys
import threading
import time
from pathlib import Path

from robots.agent.adapters import registry
from robots.api.messages import Dock, Goto, Stop
from tests.support.agents.control_rig import ThreadedControlRig, own

RENEWAL = 1.0  # s
HANG = 4.0  # s
RELEASED = 1.0  # s
SPEED = 0.3  # m/s


def report(**event):
    print(json.dumps({"at": time.monotonic(), **event}), flush=True)


def press(rig, released):
    while not released.wait(0.05):
        rig.push(SPEED)
    rig.push(0.0)


def hang():
    report(hung=True)
    time.sleep(HANG)


def obey(rig, goal):
    released = threading.Event()
    for line in sys.stdin:
        match line.strip():
            case "goto":
                rig.act(own(Goto, "action", x=goal[0], y=goal[1], theta=0.0))
            case "dock":
                rig.act(own(Dock, "action"))
            case "stop":
                rig.act(own(Stop, "stop"))
            case "drive":
                threading.Thread(target=press, args=(rig, released), daemon=True).start()
            case "hang":
                rig.post(hang)
                time.sleep(RELEASED)
                released.set()


def main(wish):
    adapter = registry.create(wish["adapter"], wish["profile"], wish["options"])
    rig = ThreadedControlRig(Path(wish["directory"]), robot=adapter)
    rig.control.start(rig.media)
    rig.wait(lambda: rig.link.connected and rig.kernel.fault is None, 30.0)
    rig.grant()
    report(control=adapter.profile.navigation_control, connected=True)
    words = rig, wish.get("goal", (60.0, 0.0))
    threading.Thread(target=obey, args=words, daemon=True).start()
    renewal, renewed, sent = 0, time.monotonic(), 0
    while True:
        rig.beat(of=rig.link.wait("heartbeat", since=rig.link.count, within=30.0))
        if time.monotonic() - renewed > RENEWAL:
            renewal, renewed = renewal + 1, time.monotonic()
            rig.lease(renewal=renewal)
        for suffix, message in rig.link.sent[sent:]:
            sent += 1
            if suffix == "action":
                report(action=message.action_id, progress=message.status, reason=message.reason)
            elif suffix == "state" and message.errors:
                report(errors=message.errors)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
