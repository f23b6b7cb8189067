"""The interpreter of a process that must answer within milliseconds."""

import sys

from tests.support.programs.finished import run

SCRIPT = """
import gc, sys
from robots.agent import agent

class Agent:
    def run(self, built):
        built()
        print(gc.get_freeze_count(), len(gc.get_objects()), sys.getswitchinterval())

agent.run_until_signalled(Agent())
"""


def test_loaded_modules_are_excluded_from_garbage_collection():
    """Otherwise each collection delays the control loop by up to four ticks."""
    printed = run(sys.executable, "-c", SCRIPT, check=True).stdout.split()
    frozen, collected, switch_interval_s = map(float, printed)
    assert frozen > 20_000
    assert collected < 1_000
    assert switch_interval_s < 0.001
