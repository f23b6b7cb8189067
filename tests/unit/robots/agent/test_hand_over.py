"""Between driver and RCA the robot is measured at rest; a cancel ends there."""

from itertools import pairwise

import pytest

from robots.agent.ramp import ZERO
from robots.api import messages as m
from tests.support.agents.control_rig import own, staff, stamped
from tests.support.agents.scripted_robot import NavigatingRobot, still

ROBOT = NavigatingRobot


def goes(rig):
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.status("a1", "RUNNING")
    rig.wait(lambda: rig.robot.going)
    rig.sleep(0.1)


def velocities_since(rig, moment):
    return [velocity for _, velocity in rig.robot.velocities(moment)]


@pytest.mark.parametrize("hanging", [True, False], ids=["does not answer", "refuses"])
def test_a_robot_at_speed_brakes_before_its_architecture_gets_an_action(rig, hanging):
    rig.robot.hanging, rig.robot.refuses = hanging, "" if hanging else "no way there"
    rig.drive(0.5)
    asked = rig.now()
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.now() - asked < 0.5 / rig.robot.profile.limits.linear_braking + 0.1
    speeds = [velocity.linear for velocity in velocities_since(rig, asked)]
    assert speeds == sorted(speeds, reverse=True)
    rig.sleep(1.0)
    assert rig.robot.motion == ZERO
    if not hanging:
        assert rig.status("a1", "FAILED").reason == "no way there"


@pytest.mark.parametrize("docks", [False, True], ids=["travels", "docks"])
def test_a_contact_ends_autonomous_motion_except_docking(rig, docks):
    rig.act(own(m.Dock) if docks else own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.robot.going)
    rig.sleep(0.3)
    rig.robot.reading = still(contacts=1)
    if docks:
        rig.beat_for(1.0)
        assert rig.robot.cancelled == []
    else:
        assert rig.status("a1", "CANCELLED").reason == "collision"
        assert rig.robot.motion == ZERO
        assert rig.event("collision")


@pytest.mark.parametrize(
    "how", ["cancel", "lease_changed", "no_lease", "heartbeat_lost", "stopped", "manual"]
)
def test_navigation_is_cancelled_only_when_zeros_have_brought_the_robot_to_rest(rig, how):
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
    rig.beat_for(9.0)
    sent = velocities_since(rig, braking)
    assert len(sent) > 400, "zeros are sent for as long as the robot moves"
    assert sent[-300:] == [ZERO] * 300
    assert not any(
        a.action_id == "a1" and a.status == "CANCELLED" for a in rig.link.all("action")
    ), "the robot still drives"
    assert not any(a.action_id == "c1" and a.status == "FINISHED" for a in rig.link.all("action"))
    assert any(error.startswith("runs_on") for error in rig.state().errors)
    rig.robot.halt()
    rig.robot.ignores_cancel = False
    ended = rig.status("a1", "CANCELLED")
    assert ended.reason == ("cancelled" if how == "cancel" else how)
    assert rig.now() - begun > 9.0
    if how == "cancel":
        rig.status("c1", "FINISHED")
    rig.link.wait("state", lambda s: not s.errors, since=rig.link.count)
    rig.sleep(1.0)
    assert velocities_since(rig, rig.now() - 0.3) == [], "no zeros against another controller"


def test_an_architecture_that_drives_as_requested_is_no_error(rig):
    goes(rig)
    rig.beat_for(5.0)
    assert rig.robot.going
    assert rig.state().errors == ()


def test_a_driver_who_takes_over_drives_when_the_robot_is_at_rest(rig):
    goes(rig)
    begun = rig.now()
    rig.drive(0.3)
    assert rig.status("a1", "CANCELLED").reason == "manual"
    sent = velocities_since(rig, begun)
    braking = sent[: sent.index(ZERO) + 1]
    assert all(earlier.linear >= later.linear for earlier, later in pairwise(braking))
    assert rig.robot.told.linear == pytest.approx(0.3)


@pytest.mark.parametrize("fault", ["hangs", "fails"])
def test_zeros_are_sent_while_a_cancel_hangs_or_fails_and_its_error_is_reported(rig, fault):
    goes(rig)
    rig.robot.cancel_hangs = fault == "hangs"
    rig.robot.cancel_fails = "out of order" if fault == "fails" else ""
    stopped = rig.now()
    rig.act(stamped(m.Stop, "stop-1"), way="datachannel", peer="p2")
    rig.sleep(11.0)
    assert rig.kernel.fault is None, "the base still takes velocities"
    moments = [at for at, _ in rig.robot.velocities(stopped)]
    assert max(later - earlier for earlier, later in pairwise(moments)) < 0.05
    assert any(error.startswith("cancel: ") for error in rig.state().errors)
    rig.robot.cancel_hangs, rig.robot.cancel_fails = False, ""
    rig.status("a1", "CANCELLED", within=20.0)
    rig.link.wait("state", lambda s: not s.errors, since=rig.link.count)


def test_an_action_that_was_cancelled_before_the_robot_was_at_rest_is_never_begun(rig):
    rig.drive(0.5)
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.act(staff(m.Cancel, "c1"))
    assert rig.status("a1", "CANCELLED").reason == "cancelled"
    rig.sleep(2.0)
    assert rig.robot.started == []
