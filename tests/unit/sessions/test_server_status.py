"""The faults that a page receives, and their effect on driving."""

import pytest

from robots.api import messages as m
from robots.bridge.known import KnownRobot
from sessions.consumers import relay

LEASE = m.Lease(session="s1", epoch=3, peer="p1", who="Ada", renewal=1, stamp=1.0, ttl=10.0)


@pytest.fixture
def driven():
    known = KnownRobot("giraff")
    known.take("lease", LEASE, 100.0)
    return known


def told(known, now, *faults):
    out = relay.status(faults, known, now)
    assert out.droppable
    return out.frame


@pytest.mark.parametrize("part", ["broker", "session_manager", "database"])
def test_without_who_renews_leases_the_robot_stops_when_its_own_runs_out(driven, part):
    assert (
        told(driven, 103.5, part)
        == f'server/status\n{{"faults":[{{"part":"{part}","then":"stops","seconds":6.5}}]}}'
    )
    assert (
        told(driven, 110.0, part)
        == f'server/status\n{{"faults":[{{"part":"{part}","then":"stopped"}}]}}'
    )


@pytest.mark.parametrize("part", ["broker", "session_manager", "database", "robot"])
def test_without_a_driver_visitors_go_on_waiting(part):
    assert (
        told(KnownRobot("giraff"), 1.0, part)
        == f'server/status\n{{"faults":[{{"part":"{part}","then":"waits"}}]}}'
    )


def test_a_robot_that_is_silent_has_stopped_by_itself(driven):
    assert (
        told(driven, 101.0, "robot")
        == 'server/status\n{"faults":[{"part":"robot","then":"stopped"}]}'
    )


def test_a_full_disk_stops_nobody(driven):
    assert (
        told(driven, 101.0, "disk_full")
        == 'server/status\n{"faults":[{"part":"disk_full","then":"goes_on"}]}'
    )


def test_a_server_that_is_well_says_so(driven):
    assert told(driven, 101.0) == "server/status\n{}"
