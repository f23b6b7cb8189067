"""Ten practices in a row, and every process of the demo killed in turn during a drive, which goes
on.
"""

import contextlib

import psutil
import pytest

from tests.support.browsers.demo_visitors import PARTS, PRACTICE, People, demo_with_people
from tests.support.patience import patient
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.soak]


@pytest.fixture(scope="module")
def people(tmp_path_factory, browser):
    with demo_with_people(tmp_path_factory.mktemp("demo") / "var", browser) as people:
        people.ana_sets_out()
        yield people


def practice_robot(people: People) -> psutil.Process | None:
    return child_of(people.demo.member("run_practice"), PRACTICE)


def child_of(process: psutil.Process, program: str) -> psutil.Process | None:
    """Return the living child that runs a program."""
    for child in process.children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):  # or a zombie
            if any(program in word for word in child.cmdline()):
                return child
    return None


def test_ten_practices_in_a_row_each_get_a_new_robot(people):
    robots = set()
    for _ in range(10):
        people.cy_begins_to_practise()
        robot = practice_robot(people)
        assert robot is not None
        robots.add(robot.pid)
        people.cy_stops_practising()
        assert psutil.wait_procs([robot], timeout=patient(15))[1] == []
        people.ana_drives()
    assert len(robots) == 10
    assert " ended: " not in people.demo.said()


@pytest.mark.parametrize("part", PARTS)
def test_killed_part_is_named_and_restarted_and_the_drive_goes_on(people, part):
    (death,) = people.kill(part)
    assert "SIGKILL" in death
    assert ".log)" in death
    people.ana_drives()


def test_part_that_loses_its_child_is_named_with_its_own_message(people):
    mosquitto = child_of(people.demo.member("run_broker"), "mosquitto")
    assert mosquitto is not None
    (death,) = people.kill_members({"broker": mosquitto})
    assert "mosquitto ended with code -9" in death
    people.ana_drives()


@pytest.mark.parametrize("program", ["robots.simulator", "robots.agent.autonomy"])
def test_robot_restarts_its_simulator_and_its_navigation(people, program):
    robot = people.demo.member("run_robot", "giraff")
    first = child_of(robot, program)
    assert first is not None
    first.kill()
    wait_for(lambda: child_of(robot, program) not in {None, first}, 30, f"another {program}")
    people.ana_drives()


def test_killed_practice_supervisor_leaves_no_robot_and_is_replaced(people):
    people.cy_begins_to_practise()
    robot = practice_robot(people)
    assert robot is not None
    family = [robot, *robot.children(recursive=True)]
    people.kill("practice supervisor")
    assert psutil.wait_procs(family, timeout=patient(10))[1] == []
    people.cy_sees_the_practice_robot()
    people.cy_stops_practising()
    people.cy_practises()
    people.ana_drives()
