"""Between driver and RCA the robot is measured at rest; a cancel ends there."""

from itertools import pairwise

import pytest

from robots.agent.ramp import ZERO
from robots.api import messages as m
from tests.support.agents.control_rig import ControlRig, own, staff, stamped
from tests.support.agents.scripted_robot import NavigatingRobot, still


@pytest.fixture
def rig(tmp_path):
    with ControlRig(tmp_path, robot=NavigatingRobot()) as rig:
        rig.grant()
        yield rig


def goes(rig):
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.status("a1", "RUNNING")
    rig.wait(lambda: rig.robot.going)
    rig.sleep(0.1)


def beats(rig, seconds):
    """Let time pass, with the driver's heartbeats."""
    until = rig.now() + seconds
    while rig.now() < until:
        rig.beat()
        rig.sleep(0.2)


def told_since(rig, moment):
    return [velocity for _, velocity in rig.robot.velocities(moment)]


@pytest.mark.parametrize("hanging", [True, False], ids=["thinks for long", "refuses"])
def test_a_robot_at_speed_brakes_before_its_architecture_is_asked_to_drive_it(rig, hanging):
    rig.robot.hanging, rig.robot.refuses = hanging, "" if hanging else "no way there"
    rig.drive(0.5)
    asked = rig.now()
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.now() - asked < 0.5 / rig.robot.profile.limits.linear_braking + 0.1
    speeds = [velocity.linear for velocity in told_since(rig, asked)]
    assert speeds == sorted(speeds, reverse=True)
    rig.sleep(1.0)
    assert rig.robot.motion == ZERO
    if not hanging:
        assert rig.status("a1", "FAILED").reason == "no way there"


@pytest.mark.parametrize("docks", [False, True], ids=["travels", "docks"])
def test_a_contact_ends_what_an_architecture_does_by_itself_unless_it_docks(rig, docks):
    rig.act(own(m.Dock) if docks else own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.robot.going)
    rig.sleep(0.3)
    rig.robot.reading = still(contacts=1)
    if docks:
        beats(rig, 1.0)
        assert rig.robot.cancelled == []
    else:
        assert rig.status("a1", "CANCELLED").reason == "collision"
        assert rig.robot.motion == ZERO
        assert rig.link.wait("event", lambda e: e.type == "collision")


@pytest.mark.parametrize(
    "how", ["cancel", "lease_changed", "no_lease", "heartbeat_lost", "stopped", "manual"]
)
def test_however_navigation_ends_zeros_flow_until_the_robot_stands_and_only_then_it_is_cancelled(
    rig, how
):
    rig.robot.ignores_cancel = True
    goes(rig)
    begun = rig.now()
    if how == "cancel":
        rig.act(own(m.Cancel, "c1", target="a1"))
    elif how == "lease_changed":
        rig.lease(session="s2", epoch=2, peer="p2")
    elif how == "no_lease":
        rig.lease(renewal=1, ttl=0.3)
    elif how == "stopped":
        rig.act(stamped(m.Stop, "stop-1"), way="datachannel", peer="p2")
    elif how == "manual":
        rig.push(0.3)
    rig.wait(lambda: rig.robot.cancelled, within=5.0)
    braking = rig.now()
    beats(rig, 9.0)
    told = told_since(rig, braking)
    assert len(told) > 400, "zeros flow for as long as the robot moves"
    assert told[-300:] == [ZERO] * 300
    assert not any(
        a.action_id == "a1" and a.status == "CANCELLED" for a in rig.link.all("action")
    ), "the robot still drives"
    assert not any(a.action_id == "c1" and a.status == "FINISHED" for a in rig.link.all("action"))
    assert any(
        error.startswith("runs_on") for error in rig.link.wait("state", since=rig.link.count).errors
    )
    rig.robot.halt()
    rig.robot.ignores_cancel = False
    ended = rig.status("a1", "CANCELLED")
    assert ended.reason == ("cancelled" if how == "cancel" else how)
    assert rig.now() - begun > 9.0
    if how == "cancel":
        rig.status("c1", "FINISHED")
    rig.link.wait("state", lambda s: not s.errors, since=rig.link.count)
    rig.sleep(1.0)
    assert told_since(rig, rig.now() - 0.3) == [], "and then nobody is fought"


def test_an_architecture_that_drives_as_it_was_asked_to_is_no_error(rig):
    goes(rig)
    beats(rig, 5.0)
    assert rig.robot.going
    assert rig.link.wait("state", since=rig.link.count).errors == ()


def test_a_driver_who_takes_over_drives_when_the_robot_stands(rig):
    goes(rig)
    begun = rig.now()
    rig.drive(0.3)
    assert rig.status("a1", "CANCELLED").reason == "manual"
    told = told_since(rig, begun)
    first = next(index for index, velocity in enumerate(told) if velocity == ZERO)
    assert all(earlier.linear >= later.linear for earlier, later in pairwise(told[: first + 1])), (
        "it brakes first"
    )
    assert rig.robot.told.linear == pytest.approx(0.3)


@pytest.mark.parametrize("fault", ["hangs", "fails"])
def test_a_cancel_that_hangs_or_fails_takes_no_zero_from_the_base_and_is_named(rig, fault):
    goes(rig)
    rig.robot.cancel_hangs, rig.robot.cancel_fails = (
        fault == "hangs",
        "out of order" if fault == "fails" else "",
    )
    stopped = rig.now()
    rig.act(stamped(m.Stop, "stop-1"), way="datachannel", peer="p2")
    rig.sleep(11.0)
    assert rig.kernel.fault is None, "the base can be told what to do all the time"
    moments = [at for at, _ in rig.robot.velocities(stopped)]
    assert max(later - earlier for earlier, later in pairwise(moments)) < 0.05
    assert any(
        error.startswith("cancel: ")
        for error in rig.link.wait("state", since=rig.link.count).errors
    )
    rig.robot.cancel_hangs, rig.robot.cancel_fails = False, ""
    rig.status("a1", "CANCELLED", within=20.0)
    rig.link.wait("state", lambda s: not s.errors, since=rig.link.count)


def test_an_action_that_was_cancelled_before_the_robot_stood_is_never_begun(rig):
    rig.drive(0.5)
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.act(staff(m.Cancel, "c1"))
    assert rig.status("a1", "CANCELLED").reason == "cancelled"
    rig.sleep(2.0)
    assert rig.robot.started == []


def test_a_contact_stops_the_robot_and_lets_it_only_back_away(rig):
    rig.drive(0.5)
    rig.robot.reading = rig.robot.reading.__class__(**{**vars(rig.robot.reading), "contacts": 1})
    rig.link.wait("event", lambda e: e.type == "collision")
    rig.wait(lambda: rig.robot.told == ZERO)
    touched = rig.now()
    for _ in range(20):
        rig.push(0.5)
        rig.sleep(0.05)
    assert {velocity.linear for velocity in told_since(rig, touched)} == {0.0}
    assert rig.link.wait("state", since=rig.link.count).safety.inhibited == "collision"
    rig.drive(-0.2)
    rig.sleep(0.3)
    rig.drive(0.3)
    assert rig.link.wait("state", since=rig.link.count).safety.inhibited is None
