"""Which part of the server is at fault, by the messages that arrive."""

import pytest

from robots.api.messages import Connection, ManagerStatus
from robots.bridge.known import KnownRobot
from robots.bridge.server_watch import BROKER, ROBOT, SESSION_MANAGER, ServerWatch

STEP = 0.05


class Server:
    """A broker, a session manager and a robot that each can be stopped, and a web process that
    watches; times are virtual.
    """

    def __init__(self):
        self.now = 100.0
        self.watch, self.robot = ServerWatch(), KnownRobot("giraff", needed_since=0.0)
        self.watch.link_changed(self.now, up=True)
        self.robot.take("connection", Connection(boot="b", state="ONLINE", stamp=0.0), self.now)
        self.lives = {BROKER, SESSION_MANAGER, ROBOT}
        self.status = ManagerStatus(stamp=0.0)
        self.asked = False

    def run(self, seconds):
        """Let time pass; return the faults at its end."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            step = round(self.now / STEP)
            if {BROKER, SESSION_MANAGER} <= self.lives and step % 10 == 0:
                self.watch.on_status(self.status, self.now)
            if {BROKER, ROBOT} <= self.lives and step % 4 == 0:
                self.robot.take("heartbeat", None, self.now)
            if self.asked and BROKER in self.lives:
                self.watch.answered()
            self.asked = self.watch.wants_probe(self.now) or (
                self.asked and BROKER not in self.lives
            )
        return self.watch.faults(self.robot, self.now)

    def until(self, expected):
        """Let time pass until that is found; return the seconds."""
        began = self.now
        while self.run(STEP) != expected:
            assert self.now - began < 10.0, self.watch.faults(self.robot, self.now)
        return self.now - began


@pytest.fixture
def server():
    made = Server()
    assert made.run(5.0) == ()
    return made


@pytest.mark.parametrize("part", [SESSION_MANAGER, BROKER, ROBOT])
def test_a_stopped_part_is_named_within_two_seconds_until_it_continues(server, part):
    for _ in range(2):
        server.lives.remove(part)
        assert server.until((part,)) < 1.8
        assert server.run(20.0) == (part,)
        server.lives.add(part)
        assert server.until(()) < 1.0


@pytest.mark.parametrize("part", [SESSION_MANAGER, BROKER, ROBOT])
def test_no_other_part_is_named_during_a_fault(server, part):
    server.lives.remove(part)
    found = [server.run(STEP) for _ in range(200)]
    assert found == sorted(found)
    assert set(found) == {(), (part,)}


def test_a_broker_that_fails_after_the_session_manager_is_named_instead(server):
    server.lives.remove(SESSION_MANAGER)
    server.until((SESSION_MANAGER,))
    server.lives.remove(BROKER)
    assert server.until((BROKER,)) < 1.8


def test_a_lost_broker_is_named_at_once_and_its_clients_have_time_to_reconnect(server):
    server.watch.link_changed(server.now, up=False)
    assert server.watch.faults(server.robot, server.now) == (BROKER,)
    server.lives -= {SESSION_MANAGER, ROBOT}
    server.watch.link_changed(server.now, up=True)
    assert server.run(1.0) == ()
    assert server.run(1.0) == (SESSION_MANAGER, ROBOT)


def test_faults_of_the_session_manager_are_passed_on_while_it_reports_them(server):
    server.status = ManagerStatus(stamp=0.0, faults=("database", "disk_low"))
    server.until(("database", "disk_low"))
    server.status = ManagerStatus(stamp=0.0)
    assert server.until(()) < 1.0


def test_a_robot_that_went_offline_is_no_fault(server):
    server.robot.take("connection", Connection(boot="b", state="OFFLINE", stamp=0.0), server.now)
    server.lives.remove(ROBOT)
    assert server.run(10.0) == ()
