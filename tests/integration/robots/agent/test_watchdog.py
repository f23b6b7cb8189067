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
from tests.support.architectures.mqtt_ear import Ear
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto

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


@pytest.fixture
def ear(tmp_path):
    with Mosquitto(tmp_path) as broker, Ear(broker.port) as ear:
        ear.broker = broker
        yield ear


class AgentProcess:
    """An agent with an installed adapter, in the folder where its file `hang` makes it hang."""

    def __init__(self, folder, broker, stderr, **environment):
        install(folder, "telepresence-hanging", "hanging", text=HANGING)
        command = (sys.executable, "-m", "robots.agent", "giraff", "--mqtt", broker.url)
        self.process = subprocess.Popen(
            [*command, "--adapter", "hanging", "--profile", "x", "--var", str(folder / "var")],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": f"{ROOT}:{folder}"} | environment,
            stderr=stderr,
        )

    def __enter__(self):
        return self.process

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


@pytest.mark.broker
def test_a_process_whose_control_thread_hangs_logs_where_and_ends(ear, tmp_path):
    notified = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    notified.bind(str(tmp_path / "notify"))
    notified.settimeout(patient(10.0))
    with (
        notified,
        (tmp_path / "log").open("w+") as log,
        AgentProcess(tmp_path, ear.broker, log, NOTIFY_SOCKET=str(tmp_path / "notify")) as agent,
    ):
        ear.wait("state", lambda s: s.pose.x == 1.0)
        assert [notified.recv(100) for _ in range(2)] == [b"READY=1", b"WATCHDOG=1"]
        (tmp_path / "hang").touch()
        hung = time.monotonic()
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        assert agent.wait(patient(HANG_S)) == EXIT_HUNG
        assert time.monotonic() - hung > HANG_S / 2, "a thread that is only late is left alone"
        log.seek(0)
        said = log.read()
    assert "thread_hung" in said
    assert "in apply" in said, "the line where it hangs is named"
    ear.wait("connection", lambda c: c.state != "ONLINE")
    (tmp_path / "hang").unlink()


@pytest.mark.nightly
@pytest.mark.broker
def test_a_process_whose_control_thread_hangs_ends_when_it_is_told_to(ear, tmp_path):
    with (tmp_path / "log").open("w+") as log, AgentProcess(tmp_path, ear.broker, log) as agent:
        ear.wait("state", lambda s: s.pose.x == 1.0)
        (tmp_path / "hang").touch()
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        agent.terminate()
        assert agent.wait(patient(CLOSE_TIME)) == EXIT_HUNG
        log.seek(0)
        assert "where=closing" in log.read()


@pytest.mark.broker
def test_an_agent_whose_terminal_takes_no_lines_works_and_stops(ear, tmp_path):
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writer, b"x"):
            pass
    os.set_blocking(writer, True)
    with AgentProcess(tmp_path, ear.broker, writer):
        ear.wait("state", lambda s: s.pose.x == 1.0)
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        ear.wait("state", lambda s: s.safety.stop_id == "s1")
    os.close(reader)
    os.close(writer)


def test_the_service_manager_receives_that_the_process_started_and_works(tmp_path):
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        manager.settimeout(5.0)
        systemd = Systemd({"NOTIFY_SOCKET": address})
        systemd.ready()
        for _ in range(100):
            systemd.alive()
        assert [manager.recv(100) for _ in range(2)] == [b"READY=1", b"WATCHDOG=1"]
        manager.setblocking(False)
        with pytest.raises(BlockingIOError):
            manager.recv(100)


def test_an_abstract_address_of_the_service_manager_is_understood():
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("")
        address = manager.getsockname().decode().replace("\0", "@")
        manager.settimeout(5.0)
        Systemd({"NOTIFY_SOCKET": address}).ready()
        assert manager.recv(100) == b"READY=1"


def test_a_process_without_a_service_manager_or_with_a_dead_one_goes_on(tmp_path):
    Systemd({}).ready()
    Systemd({"NOTIFY_SOCKET": str(tmp_path / "gone")}).ready()
