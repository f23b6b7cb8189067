"""No child outlives its parent, and a process that was started with signals ignored still ends by
them, and cleans up once.
"""

import os
import signal
import subprocess
import sys

import psutil
import pytest

from robots.process import ending as processes
from tests.support.browsers.running_demo import disposition
from tests.support.sessions.site import ROOT, wait_for

CLEANS_UP = """
import sys, time
from robots.process.ending import interrupted_by_signals
try:
    with interrupted_by_signals():
        try:
            print("ready", flush=True)
            time.sleep(600)
        finally:
            print("cleaning", flush=True)
            time.sleep(1.0)
            print("cleaned", flush=True)
except KeyboardInterrupt:
    print("ended", flush=True)
"""
PARENT = """
import subprocess, sys, time
from robots.process.ending import tied_to_parent
sleeps = [sys.executable, "-c", "import time; time.sleep(600)"]
child = subprocess.Popen(sleeps, start_new_session=True, preexec_fn=tied_to_parent())
print(child.pid, flush=True)
time.sleep(600)
"""


def python(code: str, *, background: bool) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=disposition(background=background),
    )


@pytest.mark.parametrize("background", [True, False], ids=["background", "foreground"])
@pytest.mark.parametrize("number", processes.END_SIGNALS)
def test_only_the_first_signal_interrupts(number, background):
    with python(CLEANS_UP, background=background) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert process.stdout.readline() == "cleaning\n"
        for again in processes.END_SIGNALS:
            process.send_signal(again)
        assert process.stdout.read() == "cleaned\nended\n"
    assert process.returncode == 0


def test_signal_handlers_are_restored():
    before = [signal.getsignal(number) for number in processes.END_SIGNALS]
    with pytest.raises(KeyboardInterrupt), processes.interrupted_by_signals():
        signal.raise_signal(signal.SIGTERM)
    assert [signal.getsignal(number) for number in processes.END_SIGNALS] == before


def test_child_ends_when_its_parent_is_killed():
    with python(PARENT, background=False) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    assert psutil.wait_procs([child], timeout=20)[1] == []


def test_child_whose_parent_died_before_it_was_tied_ends_at_once(monkeypatch):
    """The kernel sends the signal only if it was requested before the parent's death."""
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    with monkeypatch.context() as patch:
        patch.setattr(os, "getpid", lambda: dead.pid)
        tie = processes.tied_to_parent()
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], preexec_fn=tie)
    wait_for(lambda: child.poll() is not None, 20, "the end of a child without its parent")
    assert child.returncode == -signal.SIGKILL
