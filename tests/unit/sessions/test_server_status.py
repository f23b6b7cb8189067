"""The faults that a page receives, and their effect on driving."""

import json

import pytest

from robots.api import messages as m
from robots.bridge.known import KnownRobot
from sessions.consumers import relay

LEASE = m.Lease(session="s1", epoch=3, peer="p1", who="Ada", renewal=1, stamp=1.0, ttl=10.0)


@pytest.fixture
def robot():
    """A robot with a driver whose lease ends at 110 s."""
    known = KnownRobot("giraff")
    known.take("lease", LEASE, 100.0)
    return known


def fault(known, now, part):
    """Return what a page receives about a fault."""
    out = relay.status((part,), known, now)
    assert out.droppable
    suffix, _, frame = out.frame.partition("\n")
    assert suffix == "server/status"
    (found,) = json.loads(frame)["faults"]
    assert found.pop("part") == part
    return found


@pytest.mark.parametrize("part", ["broker", "session_manager", "database"])
def test_without_renewals_the_robot_stops_at_the_end_of_its_lease(robot, part):
    assert fault(robot, 103.5, part) == {"then": "stops", "seconds": 6.5}
    assert fault(robot, 110.0, part) == {"then": "stopped"}


@pytest.mark.parametrize("part", ["broker", "session_manager", "database", "robot"])
def test_visitors_wait_during_a_fault_without_a_driver(part):
    assert fault(KnownRobot("giraff"), 1.0, part) == {"then": "waits"}


@pytest.mark.parametrize(("part", "then"), [("robot", "stopped"), ("disk_full", "goes_on")])
def test_a_silent_robot_has_stopped_and_a_full_disk_stops_no_drive(robot, part, then):
    assert fault(robot, 101.0, part) == {"then": then}


def test_a_healthy_server_reports_no_fault(robot):
    assert relay.status((), robot, 101.0).frame == "server/status\n{}"
