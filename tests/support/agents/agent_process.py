"""A whole agent and its driver as a process (ordered_agent.py), seen from outside."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time

from tests.support.paths import ROOT
from tests.support.patience import patient


def wait(condition, seconds=10.0):
    deadline = time.monotonic() + patient(seconds)
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class AgentProcess:
    """Starts when it is made; `events` are the lines that it has printed."""

    def __init__(self, adapter, profile, options, directory, *, prefix=(), plan=""):
        wish = {
            "adapter": adapter,
            "profile": profile,
            "options": options,
            "directory": str(directory),
            "plan": plan,
        }
        module = [sys.executable, "-m", "tests.support.agents.ordered_agent", json.dumps(wish)]
        self.process = subprocess.Popen(
            [*prefix, *module],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.events = []
        threading.Thread(target=self._read, daemon=True).start()
        self.wait_for(lambda event: "ready" in event, 40.0)

    def _read(self):
        for line in self.process.stdout:
            self.events.append(json.loads(line))

    def request(self, *words):
        self.process.stdin.write(" ".join(words) + "\n")
        self.process.stdin.flush()

    def wait_for(self, wanted, seconds=10.0, since=0.0):
        deadline = time.monotonic() + patient(seconds)
        while time.monotonic() < deadline:
            for event in [each for each in self.events if each["at"] >= since]:
                if wanted(event):
                    return event
            time.sleep(0.02)
        raise AssertionError(f"no such event among {self.events[-8:]}")

    def signal(self, number):
        os.kill(self.process.pid, number)

    def end(self):
        with contextlib.suppress(ProcessLookupError):
            self.signal(signal.SIGCONT)
        self.process.kill()
        self.process.wait()

    def said(self):
        """Return the last status of an action and the last state, as words."""
        actions = [each for each in self.events if "action" in each]
        states = [each for each in self.events if "mode" in each]
        return " ".join(
            [
                f"{actions[-1]['action']} {actions[-1]['status']} {actions[-1]['reason']};"
                if actions
                else "",
                f"{states[-1]['mode']} {states[-1]['inhibited']} {states[-1]['errors']}"
                if states
                else "",
            ]
        )
