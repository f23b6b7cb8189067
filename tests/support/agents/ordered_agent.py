"""`python -m tests.support.agents.ordered_agent JSON`: a whole agent and its driver in one process,
which tests kill and freeze.

Everything between the adapter and the driver is the agent's. A line on standard input is what the
driver does from now on: `idle`, `drive`, `stop`, `goto X Y` or `dock`; with `hang` the control
thread hangs for HANG seconds. Standard output has a JSON line for each status of an action, and for
each state in which the inhibition, the mode or the errors differ from those of the state before.
JSON: `adapter`, `profile`, `options`, `directory`, and `plan` for a site where the agent navigates.
"""

import json
import sys
import threading
import time
from pathlib import Path

from robots.agent.adapters import registry
from robots.api import messages as m
from tests.support.agents.control_rig import ThreadedControlRig, own

RENEWAL = 1.0  # s
TICK = 0.05  # s
HANG = 4.0  # s
SPEED = 0.25  # m/s


class Driver:
    """Renews the lease, answers heartbeats, and does what the latest line requests."""

    def __init__(self, rig):
        self.rig, self.wish, self.actions = rig, ["idle"], 0
        self.renewal, self.renewed, self.reported = 0, -RENEWAL, 0
        self.last = self.answered = None

    def run(self):
        while True:
            now = time.monotonic()
            if now - self.renewed > RENEWAL:
                self.renewal, self.renewed = self.renewal + 1, now
                self.rig.lease(renewal=self.renewal, ttl=60.0)
            self.act()
            self.report()
            self.beat()
            time.sleep(TICK)

    def act(self):
        word, *rest = self.wish
        if word == "drive":
            held = self.rig.kernel.inhibited(time.monotonic())
            self.rig.push(0.0 if held else SPEED)
            return
        if word == "idle":
            return
        self.wish = ["idle"]
        self.actions += 1
        name = f"{word}-{self.actions}"
        match word:
            case "goto":
                self.rig.push(0.0)
                self.rig.act(own(m.Goto, name, x=float(rest[0]), y=float(rest[1])))
            case "dock":
                self.rig.push(0.0)
                self.rig.act(own(m.Dock, name))
            case "stop":
                self.rig.act(own(m.Stop, name))

    def beat(self):
        """Answer the latest heartbeat once, as pages do: a hung agent gets no answers."""
        beats = [message for suffix, message in self.rig.link.sent[-50:] if suffix == "heartbeat"]
        if beats and beats[-1] is not self.answered:
            self.answered = beats[-1]
            self.rig.beat(of=self.answered)

    def report(self):
        sent = self.rig.link.sent
        for suffix, message in sent[self.reported :]:
            if suffix == "action":
                tell(status=message.status, reason=message.reason)
            elif suffix == "state":
                shown = (message.safety.inhibited, message.mode, list(message.errors))
                if shown != self.last:
                    self.last = shown
                    tell(inhibited=shown[0], mode=shown[1], errors=shown[2])
        self.reported = len(sent)


def tell(**event):
    sys.stdout.write(json.dumps({"at": time.monotonic(), **event}) + "\n")
    sys.stdout.flush()


def hang():
    tell(hung=True)
    time.sleep(HANG)


def main(wish):
    adapter = registry.create(wish["adapter"], wish["profile"], wish["options"])
    if wish.get("plan"):
        adapter = registry.autonomous(adapter, wish["plan"])
    rig = ThreadedControlRig(Path(wish["directory"]), robot=adapter)
    rig.control.start(rig.media)
    rig.wait(lambda: rig.link.connected and rig.kernel.fault is None, 20.0)
    rig.grant(ttl=60.0)
    driver = Driver(rig)
    threading.Thread(target=driver.run, daemon=True).start()
    if wish.get("plan"):
        rig.wait(lambda: any(s.pose.localized for s in rig.link.all("state")), 40.0)
        simulator = adapter.inner
        tell(port=simulator.address, pids=[simulator._child.pid, adapter.node.pid])
    tell(ready=True, control=adapter.profile.navigation_control)
    for line in sys.stdin:
        if line.split() == ["hang"]:
            rig.post(hang)
        else:
            driver.wish = line.split()


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
