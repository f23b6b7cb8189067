"""Processes that print JSON lines, among them a whole agent and its driver, seen from outside."""

import json
import signal
import subprocess
import sys
import threading

from tests.support.paths import ROOT
from tests.support.virtual_time import RealTime


def wait(condition, within=10.0, what="what was waited for"):
    RealTime.wait(condition, within, what)


class JsonProcess:
    """Starts when it is made. Each line that it prints is an event, with its monotonic time as
    `at`; lines that are no JSON object are skipped.
    """

    def __init__(self, command, environment=None):
        self.process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._events = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            if line.startswith("{"):
                self._events.append(json.loads(line))

    def events(self, since=0.0):
        return [each for each in list(self._events) if each["at"] >= since]

    def wait_for(self, wanted, since=0.0, within=20.0):
        """Return the first event that is wanted."""
        found = lambda: [event for event in self.events(since) if wanted(event)]
        wait(found, within, lambda: f"an event such as the last ones, {self.events()[-8:]},")
        return found()[0]

    def request(self, *words):
        self.process.stdin.write(" ".join(words) + "\n")
        self.process.stdin.flush()

    def freeze(self, *, on):
        self.process.send_signal(signal.SIGSTOP if on else signal.SIGCONT)

    def kill(self):
        self.process.kill()
        self.process.wait()


class AgentProcess(JsonProcess):
    """A module of this folder, started with a JSON object, once it is `ready`."""

    def __init__(self, module, *, prefix=(), environment=None, ready="ready", **wish):
        name = f"tests.support.agents.{module}"
        super().__init__([*prefix, sys.executable, "-m", name, json.dumps(wish)], environment)
        if ready:
            self.wait_for(lambda event: ready in event, within=60.0)

    def reported(self, since=0.0):
        """Return the status of the last action and the last state, as words."""
        actions = [each for each in self.events(since) if "status" in each]
        states = [each for each in self.events(since) if "mode" in each]
        return " ".join(
            [f"{each['status']} {each['reason']};" for each in actions[-1:]]
            + [f"{each['mode']} {each['inhibited']} {each['errors']}" for each in states[-1:]]
        )
