"""An agent whose control thread hangs, or whose terminal takes no lines, in a process."""

import contextlib
import fcntl
import os
import socket
import subprocess
import sys
import time

import pytest

from robots.agent.control.loop import CLOSE_TIME
from robots.agent.watchdog import EXIT_HUNG, HANG_S, Systemd
from robots.api import messages as m
from tests.support.architectures.installed_adapters import install
from tests.support.paths import ROOT
from tests.support.patience import patient

HANGING = """
import pathlib
import time

from tests.support.agents.scripted_robot import ScriptedRobot

class Hanging(ScriptedRobot):
    def apply(self, velocity):
        while pathlib.Path("hang").exists():
            time.sleep(0.1)
        return super().apply(velocity)

def create(profile_name, options):
    return Hanging()
"""


@contextlib.contextmanager
def agent_process(folder, broker, stderr, **environment):
    """Run an agent whose installed adapter hangs while the file `hang` is in the folder."""
    install(folder, "telepresence-hanging", "hanging", text=HANGING)
    command = (sys.executable, "-m", "robots.agent", "giraff", "--mqtt", broker.url)
    process = subprocess.Popen(
        [*command, "--adapter", "hanging", "--profile", "x", "--var", str(folder / "var")],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{folder}"} | environment,
        stderr=stderr,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.broker
def test_process_whose_control_thread_hangs_logs_where_and_ends(broker, ear, tmp_path):
    notified = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    notified.bind(str(tmp_path / "notify"))
    notified.settimeout(patient(10.0))
    with (
        notified,
        (tmp_path / "log").open("w+") as log,
        agent_process(tmp_path, broker, log, NOTIFY_SOCKET=str(tmp_path / "notify")) as agent,
    ):
        ear.wait("state", lambda s: s.pose.x == 1.0)
        assert [notified.recv(100) for _ in range(2)] == [b"READY=1", b"WATCHDOG=1"]
        (tmp_path / "hang").touch()
        hung = time.monotonic()
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        assert agent.wait(patient(HANG_S)) == EXIT_HUNG
        assert time.monotonic() - hung > HANG_S / 2, "a late thread was ended"
        log.seek(0)
        logged = log.read()
    assert "thread_hung" in logged
    assert "in apply" in logged, "the line where it hangs"
    ear.wait("connection", lambda c: c.state != "ONLINE")
    (tmp_path / "hang").unlink()


@pytest.mark.nightly
@pytest.mark.broker
def test_process_whose_control_thread_hangs_ends_on_sigterm(broker, ear, tmp_path):
    with (tmp_path / "log").open("w+") as log, agent_process(tmp_path, broker, log) as agent:
        ear.wait("state", lambda s: s.pose.x == 1.0)
        (tmp_path / "hang").touch()
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        agent.terminate()
        assert agent.wait(patient(CLOSE_TIME)) == EXIT_HUNG
        log.seek(0)
        assert "where=closing" in log.read()


@pytest.mark.broker
def test_agent_with_a_blocked_terminal_works_and_stops(broker, ear, tmp_path):
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writer, b"x"):
            pass
    os.set_blocking(writer, True)
    with agent_process(tmp_path, broker, writer):
        ear.wait("state", lambda s: s.pose.x == 1.0)
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        ear.wait("state", lambda s: s.safety.stop_id == "s1")
    os.close(reader)
    os.close(writer)


@pytest.mark.parametrize("name", ["notify", ""], ids=["path", "abstract"])
def test_service_manager_is_notified_of_start_and_watchdog(tmp_path, name):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(name and str(tmp_path / name))
        manager.settimeout(5.0)
        address = os.fsdecode(manager.getsockname()).replace("\0", "@")
        systemd = Systemd({"NOTIFY_SOCKET": address})
        systemd.ready()
        for _ in range(100):
            systemd.alive()
        assert [manager.recv(100) for _ in range(2)] == [b"READY=1", b"WATCHDOG=1"]
        manager.setblocking(False)
        with pytest.raises(BlockingIOError):
            manager.recv(100)


def test_missing_or_dead_service_manager_is_ignored(tmp_path):
    Systemd({}).ready()
    Systemd({"NOTIFY_SOCKET": str(tmp_path / "gone")}).ready()
