"""The agent as a whole: how its process starts, fails, restarts and ends."""

import random
import signal
import statistics
import subprocess
import sys
import threading
import time
from dataclasses import replace

import pytest
from msgspec import structs

from robots.agent.agent import Agent, factsheet_of, main, new_boot
from robots.agent.config import ConfigError, load
from robots.agent.control.reports import Reports
from robots.agent.devices.equipment import equipment_of
from robots.agent.lab.in_force import Networks
from robots.agent.robot_interface import AdapterError
from robots.api import messages as m, network_words
from tests.support import words
from tests.support.agents.agent_server import AgentServer
from tests.support.agents.control_rig import ListeningMedia
from tests.support.agents.scripted_robot import ScriptedRobot
from tests.support.architectures.mqtt_ear import Ear
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import run
from tests.support.sessions.site import wait_for


def config(broker, tmp_path, **fields):
    found = load({"robot": "giraff", "mqtt_url": broker.url, "var": tmp_path / "var"}, {})
    return replace(found, adapter="scripted", **fields)


class RunningAgent:
    """An agent in a thread, with scripted robots."""

    def __init__(self, config, *robots):
        self.robots = list(robots) or [ScriptedRobot()]
        # `built`: how often the robot had been connected when the interpreter was set up
        self.made, self.built, self.media = [], [], []
        self.agent = Agent(
            config, make_adapter=self._adapter, make_media=self._media, rng=random.Random(1)
        )
        self._thread = threading.Thread(
            target=self.agent.run, args=[lambda: self.built.append(self.made[-1].connections)]
        )

    def _adapter(self, _config):
        self.made.append(self.robots.pop(0) if len(self.robots) > 1 else self.robots[0])
        return self.made[-1]

    def _media(self, *_):
        self.media.append(ListeningMedia())
        return self.media[-1]

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.agent.stop()
        self._thread.join(15.0)
        assert not self._thread.is_alive()


@pytest.mark.broker
def test_agent_publishes_online_factsheet_state_and_offline(broker, ear, tmp_path):
    with RunningAgent(config(broker, tmp_path)):
        sheet = ear.wait("factsheet")
        own = ("call", "point", "network_lab", "safety_test")
        assert sheet.capabilities == (*ScriptedRobot().profile.capabilities, *own)
        assert sheet.limits.deadman == 0.3
        assert ear.wait("state", lambda s: s.pose.x == 1.0).boot == sheet.boot
    assert ear.wait("connection", lambda c: c.state == "OFFLINE").boot == sheet.boot


@pytest.mark.broker
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("part", ["control thread", "media loop"])
def test_agent_restarts_with_a_new_boot_when_a_part_of_it_ends(
    broker, ear, tmp_path, monkeypatch, part
):
    with RunningAgent(config(broker, tmp_path), ScriptedRobot(), ScriptedRobot()) as running:
        first = ear.wait("state", lambda s: s.pose.x == 1.0).boot
        with monkeypatch.context() as patch:
            if part == "control thread":
                patch.setattr(Reports, "tick", lambda _: 1 / 0)
            else:
                running.media[0].ended = True
            wait_for(lambda: running.made[0].closed, 10, "the closing of the old robot")
        second = ear.wait("state", lambda s: s.boot != first and s.pose.x == 1.0)
        assert running.built == [0, 0], "the interpreter is set up before each run"
        assert second.boot > first
        ear.say("command/action", m.Stop(action_id="s2", stamp=0.0))
        ear.wait("state", lambda s: s.safety.stop_id == "s2")


@pytest.mark.broker
def test_agent_gets_the_brokers_address_from_its_server(broker, ear, tmp_path):
    answer = (200, {"robot": "giraff", "mqttUrl": broker.url, "iceServers": []})
    with (
        AgentServer((503, b""), answer) as server,
        RunningAgent(config(broker, tmp_path, mqtt_url=None, server=server.url, token="t")),
    ):
        ear.wait("connection", lambda c: c.state == "ONLINE")


@pytest.mark.broker
def test_agent_process_drives_the_simulated_robot_and_ends_on_sigterm(broker, ear, tmp_path):
    arguments = f"-m robots.agent giraff --mqtt {broker.url} --option camera=no --var"
    command = [sys.executable, *arguments.split(), str(tmp_path / "var")]
    agent = subprocess.Popen(command, cwd=ROOT)
    try:
        ear.wait("state", lambda s: s.safety.inhibited == "no_lease", within=30.0)
        drive_forwards(ear)
        ear.say("command/action", m.Stop(action_id="s1", stamp=0.0))
        ear.wait("state", lambda s: s.safety.stop_id == "s1")
        ear.wait("state", lambda s: s.safety.stop_id == "s1" and s.velocity.linear == 0.0)
        agent.send_signal(signal.SIGTERM)
        assert agent.wait(20.0) == 0
        assert ear.wait("connection", lambda c: c.state == "OFFLINE")
    finally:
        agent.kill()
        agent.wait()


def drive_forwards(ear, *, command_age=None, until=None):
    """Publish a lease, synchronise the clocks, and drive over MQTT until the robot moves."""
    until = until or (lambda: any(s.velocity.linear > 0.1 for s in ear.all("state")[-3:]))
    limits = m.LeaseLimits(command_age=command_age)
    deadline = time.monotonic() + patient(16.0)
    number = 0
    while time.monotonic() < deadline:
        number += 1
        # an echo that a busy computer delayed makes every command look old: it is repeated
        if number % 20 == 1:
            lease = m.Lease(
                session="s1", epoch=1, peer="p1", who="Ada", renewal=number, stamp=time.time()
            )
            lease = structs.replace(lease, video="none", limits=limits)
            ear.say("lease", lease)
            beat, now = ear.wait("heartbeat", since=ear.count), time.time()
            echo = m.Echo(peer="robot", n=beat.n, stamp=beat.stamp, received=now)
            ear.say(
                "command/heartbeat", m.CommandHeartbeat(n=number, stamp=now, peer="p1", echo=echo)
            )
        # released at first, which a robot waits for after its start or a stop
        speed = 0.0 if number % 60 < 5 else 0.3
        own = {"session": "s1", "epoch": 1, "stamp": time.time(), "method": "script"}
        ear.say("command/velocity", words.velocity(number, linear=speed, **own))
        if until():
            return
        time.sleep(0.04)
    raise AssertionError(f"the robot does not move: {ear.all('state')[-1]}")


@pytest.mark.nightly
@pytest.mark.broker
def test_network_lab_delays_commands_by_about_its_delay(broker, tmp_path):
    ages = {}
    for text in ("delay=1", "delay=200,jitter=20"):
        networks = Networks(network_words.parse(text, seed=7))
        with (
            Ear(broker.port) as ear,
            RunningAgent(config(broker, tmp_path / text, networks=networks)),
        ):
            ear.wait("state", lambda s: s.safety.inhibited == "no_lease")
            drive_forwards(ear, command_age=1.0, until=lambda ear=ear: len(commands_of(ear)) >= 20)
            ages[text] = statistics.median(command.age for command in commands_of(ear))
            assert ear.all("state")[-1].control_network.lab == networks.control
    clean, worse = ages.values()
    assert 0.1 < worse - clean < 0.8, ages


def commands_of(ear):
    """Return the commands that have reached the wheels."""
    return [command for state in ear.all("state") for command in state.applied]


def test_clear_estop_releases_a_stored_emergency_stop(broker, tmp_path):
    running = RunningAgent(config(broker, tmp_path, clear_estop=True))
    running.agent._store.prepare()
    (tmp_path / "var" / "agent" / "giraff" / "estop.json").write_text("unreadable")
    with Ear(broker.port) as ear, running:
        assert not ear.wait("state").safety.estop


def test_wrong_settings_end_the_agent_with_a_sentence(broker, tmp_path, capsys):
    def refuse(_config):
        raise AdapterError("no such profile")

    (tmp_path / "file").write_text("")
    for make, wrong, sentence in (
        (refuse, {}, "no such profile"),
        (None, {"mqtt_url": "http://wrong"}, "mqtt://"),
        (None, {"var": tmp_path / "file"}, "cannot store an emergency stop"),
        (lambda _: ScriptedRobot(), {"loudspeaker": "t.mp4"}, r"^'t\.mp4' is not a loudspeaker"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            Agent(
                config(broker, tmp_path, **wrong), **({"make_adapter": make} if make else {})
            ).run()
    assert main(["giraff", "--var", str(tmp_path / "empty")]) == 1
    assert "no site is known" in capsys.readouterr().err


def test_manage_py_runs_the_same_agent():
    done = run(sys.executable, "manage.py", "run_robot", "Not_A_Name")
    assert done.returncode != 0
    assert "is not a valid robot name" in done.stderr
    assert "Traceback" not in done.stderr


LOADED = """
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
    printed = run(sys.executable, "-c", LOADED, check=True).stdout.split()
    frozen, collected, switch_interval_s = map(float, printed)
    assert frozen > 20_000
    assert collected < 1_000
    assert switch_interval_s < 0.001


def test_boots_sort_by_time():
    assert sorted(boots := [new_boot(at) for at in (1.0, 1.7e9, 1.8e9, 9e9)]) == boots


def test_robot_with_a_camera_can_take_photos(broker, tmp_path):
    robot = ScriptedRobot()
    robot.video = object
    settings = config(broker, tmp_path)
    assert "photo" in factsheet_of(robot, equipment_of(robot, settings), settings, "b").capabilities
