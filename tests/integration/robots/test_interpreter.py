"""The interpreter of a process that has to answer within milliseconds."""

import subprocess
import sys

from tests.support.paths import ROOT

SCRIPT = """
import gc, sys
from robots.agent import agent

class Agent:
    def run(self, built):
        built()
        print(gc.get_freeze_count(), len(gc.get_objects()), sys.getswitchinterval())

agent.run_until_signalled(Agent())
"""


def test_an_agent_keeps_the_collector_from_all_that_it_has_loaded():
    """Else each of its rounds holds up the control loop for as long as four ticks."""
    told = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    frozen, looked_through, switch = int(told[0]), int(told[1]), float(told[2])
    assert frozen > 20_000
    assert looked_through < 1_000
    assert switch < 0.001
