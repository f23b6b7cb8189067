"""The simulator as a process: its clients, its end, and a base that stops without its agent."""

import math
import signal
import socket
import sys
import time
from itertools import pairwise

import psutil
import pytest

from robots.agent.adapters.simulator.media import MediaSocket
from robots.process import framing
from robots.simulator import wire
from robots.simulator.wire import Faults
from robots.world.robot_models import GIRAFF
from tests.support.agents.simulators import (
    alive,
    driving_agent,
    eventually,
    memory_exists,
    simulator,
)
from tests.support.agents.truth import SimulatorOperator
from tests.support.programs.finished import run

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
SIMULATOR = (sys.executable, "-m", "robots.simulator")
QUIET = ("--no-camera", "--start", "corridor-centre")
ONE_STATE = 0.02  # s between two states


@pytest.fixture(scope="module")
def quiet():
    """A simulator that no test drives."""
    with simulator(*QUIET) as robot:
        yield robot


def replies(port: int, *messages: bytes) -> bytes:
    """Return what the simulator sends to a client until it closes the connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=5) as client:
        client.sendall(b"".join(messages))
        return b"".join(iter(lambda: client.recv(65536), b""))


def hello(role: wire.Role) -> bytes:
    return framing.pack(wire.SimulatorHello(role))


@pytest.mark.nightly
def test_resumed_agent_drives_again() -> None:
    with simulator(*QUIET, "--linger", "10") as robot, driving_agent(robot.address) as agent:
        onlooker = robot.onlooker()
        agent.send_signal(signal.SIGSTOP)
        assert eventually(lambda: onlooker.truth().linear == 0.0, 5.0)
        agent.send_signal(signal.SIGCONT)
        assert eventually(lambda: onlooker.truth().linear > 0.2, 5.0)


@pytest.mark.nightly
def test_new_agent_replaces_a_hung_one() -> None:
    with simulator(*QUIET, "--linger", "10") as robot, driving_agent(robot.address) as hanging:
        hanging.send_signal(signal.SIGSTOP)
        with driving_agent(robot.address, linear=-0.25):
            onlooker = robot.onlooker()
            assert eventually(lambda: onlooker.truth().linear < -0.2, 5.0)
        hanging.send_signal(signal.SIGCONT)
        assert hanging.wait(timeout=40) != 0  # its connection was closed


def test_process_ends_when_its_driver_has_left_and_the_robot_is_at_rest() -> None:
    with simulator(*QUIET, "--linger", "0.05") as robot:
        with driving_agent(robot.address) as agent:
            onlooker = robot.onlooker()
            seen = [onlooker.truth()]
            agent.kill()
            try:
                while True:
                    seen.append(onlooker.truth())
            except (AssertionError, OSError):
                ended = time.time()
        assert robot.process.wait(timeout=40) == 0
        assert seen[0].linear > 0.2
        # from the last truth, which may be early on a busy machine
        still_braked = seen[-1].linear / GIRAFF.limits.linear_braking
        assert ended >= seen[-1].stamp + still_braked - ONE_STATE


@pytest.mark.nightly
def test_simulator_of_a_killed_agent_ends_and_leaves_no_shared_memory() -> None:
    with driving_agent("child", media=True) as agent:
        address = agent.stdout.readline().strip()
        host, _, port = address.rpartition(":")
        line = MediaSocket((host, int(port)), "camera")
        welcome, pictures = line.read(20.0), line.read(20.0)
        assert isinstance(welcome, wire.SimulatorWelcome)
        assert isinstance(pictures, wire.FrameRingOffer)
        assert memory_exists(pictures.name)
        agent.kill()
        assert eventually(lambda: not alive(welcome.pid), 15.0)
        assert eventually(lambda: not memory_exists(pictures.name), 5.0)
        line.close()


@pytest.mark.parametrize(
    "fault",
    [signal.SIGTERM, signal.SIGINT, signal.SIGKILL],
    ids=["terminated", "interrupted", "killed"],
)
def test_ended_simulator_leaves_no_shared_memory(fault: signal.Signals) -> None:
    with simulator("--linger", "30") as robot:
        line = MediaSocket(("127.0.0.1", robot.port), "camera")
        line.read(20.0)
        name = line.read(20.0).name
        assert memory_exists(name)
        robot.process.send_signal(fault)
        robot.process.wait(timeout=40)
        assert eventually(lambda: not memory_exists(name), 5.0)
        line.close()


@pytest.mark.nightly
def test_frames_are_drawn_only_for_viewers() -> None:
    with simulator("--linger", "30") as robot:
        line = MediaSocket(("127.0.0.1", robot.port), "camera")
        numbers = []
        while len(numbers) < 10:
            message = line.read(20.0)
            assert message is not None
            if isinstance(message, wire.FrameReady):
                numbers.append((message.number, message.stamp))
        closed = time.time()
        line.close()
        assert [n for n, _ in numbers] == list(range(numbers[0][0], numbers[0][0] + 10))
        assert all(b > a for (_, a), (_, b) in pairwise(numbers))
        (begun, last) = numbers[0][1], numbers[-1]
        time.sleep(1.0)
        expected = (len(numbers) - 1) / (last[1] - begun)  # frames in this second
        opened = time.time()
        again = MediaSocket(("127.0.0.1", robot.port), "camera")
        first = next(
            m for m in iter(lambda: again.read(20.0), None) if isinstance(m, wire.FrameReady)
        )
        # since the last frame that was read, at the rate of the camera
        watched_for = closed - last[1] + max(0.0, first.stamp - opened)
        assert first.number <= last[0] + 1 + watched_for * GIRAFF.camera.fps + expected / 2
        again.close()


def order(linear: float) -> bytes:
    return framing.pack(wire.DriveOrder(linear, 0.0))


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        order(0.5),
        b"\x00\x00\x00\x02xx",
        hello("observer") * 2,
        hello("observer") + order(0.5),
        hello("driver") + order(math.nan),
        hello("driver") + order(math.inf),
    ],
    ids=["HTTP", "no hello", "noise", "two hellos", "an observer's", "not a number", "infinite"],
)
def test_bad_message_closes_only_its_own_connection_and_moves_nothing(quiet, sent: bytes) -> None:
    onlooker = quiet.onlooker()
    assert b"Refused" in replies(quiet.port, sent)
    assert (onlooker.truth().linear, onlooker.truth().commanded) == (0.0, (0.0, 0.0))


@pytest.mark.nightly
def test_operator_carries_the_robot_away_injects_faults_and_moves_doors() -> None:
    with simulator(*QUIET, "--seed", "3") as robot:
        fault, onlooker = SimulatorOperator(robot.port), robot.onlooker()
        assert fault.wish(wire.CarryTo(8.6, 4.4, 1.0)) == ""
        assert (onlooker.truth().x, onlooker.truth().y) == (8.6, 4.4)
        assert "desk-1 is in that spot" in fault.wish(wire.CarryTo(2.4, 7.2, 0.0))
        assert fault.wish(wire.SetDoors({"lab-door": "closed"})) == ""
        assert eventually(lambda: onlooker.truth().doors["lab-door"] == "closed")
        with driving_agent(robot.address, linear=0.25):  # there is less than a metre ahead
            assert eventually(lambda: onlooker.truth().linear > 0.05)
            assert fault.wish(wire.Break(Faults(wheels_stopped=True))) == ""
            assert eventually(lambda: onlooker.truth().linear == 0.0)
            assert fault.wish(wire.Break(Faults())) == ""
            assert eventually(lambda: onlooker.truth().linear > 0.05)
        fault.close()


@pytest.mark.nightly
def test_observer_gets_the_positions_of_walking_people() -> None:
    with simulator(*QUIET, "--people", "2") as robot:
        onlooker = robot.onlooker()
        before = onlooker.truth().people
        assert len(before) == 2
        assert eventually(lambda: onlooker.truth().people != before)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--profile", "r2d2"), "giraff, rhodon"),
        (("--plan", "castle"), "office"),
        (("--start", "moon"), "moon"),
        (("--listen", "0.0.0.0:0"), "loopback"),
        (("--listen", "127.0.0.1"), "loopback"),
        (("--people", "-1"), "--people"),
        (("--people", "1000"), "--people"),
        (("--door-changes", "-3"), "--door-changes"),
        (("--door-changes", "nan"), "--door-changes"),
    ],
)
def test_invalid_argument_is_refused_in_one_line(arguments: tuple[str, ...], words: str) -> None:
    done = run(*SIMULATOR, *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_busy_port_is_reported(quiet) -> None:
    done = run(*SIMULATOR, "--listen", quiet.address, *QUIET)
    assert done.returncode == 1
    assert "cannot listen" in done.stderr


def test_client_that_does_not_read_costs_no_memory_and_delays_no_other(quiet) -> None:
    with socket.create_connection(("127.0.0.1", quiet.port), timeout=5) as deaf:
        deaf.sendall(hello("driver"))
        onlooker = quiet.onlooker()
        begun = onlooker.truth().stamp
        assert eventually(lambda: onlooker.truth().stamp > begun + 1.5, 10.0)
        assert psutil.Process(quiet.process.pid).memory_info().rss < 300e6


def test_clients_that_disconnect_at_once_do_not_disturb_others(quiet) -> None:
    for _ in range(20):
        with socket.create_connection(("127.0.0.1", quiet.port), timeout=5) as client:
            client.sendall(hello("observer"))
    assert quiet.onlooker().truth().docked is False
