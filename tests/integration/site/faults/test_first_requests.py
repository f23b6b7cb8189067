"""What a web process reads first is read by several threads at once."""

import subprocess
import sys

import pytest

from tests.support.sessions.site import ROOT

# A process that has read nothing yet; its threads give way to each other wherever they can.
THREADS = """
import sys, threading
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
        (
            "import json; from experiments.definition.schema import from_stored; kept ="
            " json.load(open('experiments/definitions/exploration.json'))"
        ),
        "from_stored(kept)",
    ),
    "a questionnaire": (
        (
            "import json; from surveys.definition import from_stored; kept ="
            " json.load(open('surveys/definitions/experience.json'))"
        ),
        "from_stored(kept)",
    ),
    "the terms of a visit": (
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
    code = THREADS.format(first=first, read=read)
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
