"""Several threads of a new web process read definitions at the same time."""

import sys

import pytest

from tests.support.programs.finished import run

# A new process whose threads switch as often as possible.
THREADS = """
import json, sys, threading
{first}
sys.setswitchinterval(1e-6)
gate = threading.Barrier(4)
def work():
    gate.wait()
    {read}
threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""
READ = {
    "a study": (
        "from experiments.definition.schema import from_stored",
        "from_stored(json.load(open('experiments/definitions/exploration.json')))",
    ),
    "a questionnaire": (
        "from surveys.definition import from_stored",
        "from_stored(json.load(open('surveys/definitions/experience.json')))",
    ),
    "the terms of a session": (
        "import msgspec; from sessions.leases.terms import Terms",
        "msgspec.convert({'control_network': {'seed': 1}}, Terms)",
    ),
    "a message": (
        "from robots.api import codec",
        "codec.decode('command/heartbeat', '{\"n\": 1, \"stamp\": 1.0}')",
    ),
}


@pytest.mark.parametrize("what", READ)
def test_several_threads_may_be_the_first_to_read(what):
    first, read = READ[what]
    done = run(sys.executable, "-c", THREADS.format(first=first, read=read))
    assert (done.returncode, done.stderr) == (0, "")
