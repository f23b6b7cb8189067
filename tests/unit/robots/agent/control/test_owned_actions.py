"""The agent owns a moving action until the RCA confirms its end, whatever fails."""

from dataclasses import replace

import pytest

from robots.agent.ramp import ZERO
from robots.api import messages as m
from tests.support.agents.control_rig import ControlRig, own, staff, stamped
from tests.support.agents.scripted_robot import NavigatingRobot

ROBOT = NavigatingRobot


def go(rig, action=m.Goto, **fields):
    values = {"x": 1.0, "y": 1.0} if action is m.Goto else {}
    rig.act(own(action, **values, **fields))
    rig.wait(lambda: rig.robot.going)
    rig.sleep(0.2)


def stop(rig):
    rig.act(stamped(m.Stop, "stop-1"), way="datachannel", peer="p2")


@pytest.mark.parametrize("action", [m.Goto, m.Dock])
@pytest.mark.parametrize("seconds", [0.5, 4.0])
def test_action_is_cancelled_after_the_connection_was_lost(rig, action, seconds):
    go(rig, action)
    rig.robot.lost = "the cable is cut"
    rig.wait(lambda: rig.kernel.fault is not None)
    rig.sleep(seconds)
    assert rig.robot.cancelled == []
    rig.robot.lost = ""
    rig.wait(lambda: rig.kernel.fault is None, 10.0)
    rig.wait(lambda: not rig.robot.going, 1.0)
    assert rig.robot.cancelled[0] == "a1"
    rig.sleep(1.0)
    assert rig.robot.motion == ZERO


@pytest.mark.parametrize("ignored", [1, 5])
def test_cancel_is_repeated_until_it_is_confirmed(rig, ignored):
    rig.robot.ignored_cancels = ignored
    go(rig)
    began = rig.now()
    stop(rig)
    rig.wait(lambda: not rig.robot.going, 5.0)
    assert rig.now() - began < 0.5 * ignored + 0.2
    rig.wait(lambda: rig.robot.motion == ZERO)
    rig.status("a1", "CANCELLED")
    assert not rig.state().errors


@pytest.mark.parametrize("waits", [0.0, 1.0], ids=["at once", "after a rest"])
def test_architecture_that_ignores_every_cancel_is_braked_and_reported(rig, waits):
    rig.robot.ignores_cancel = True
    go(rig)
    if waits:
        rig.robot.going = False
    stop(rig)
    rig.sleep(waits)
    rig.robot.going = True
    moved = rig.now()
    runs_on = lambda state: any(error.startswith("runs_on") for error in state.errors)
    rig.link.wait("state", runs_on, since=rig.link.count, within=1.0)
    assert rig.now() - moved <= 0.5 + 0.1
    rig.beat_for(5.0)
    sent = [velocity for _, velocity in rig.robot.velocities(moved + 1.0)]
    assert sent == [ZERO] * len(sent)
    assert len(sent) > 150, "zeros are sent at 50 Hz"
    assert any(error.startswith("cancel: ") for error in rig.state().errors)
    cancels = len(rig.robot.cancelled)
    rig.sleep(2.0)
    assert len(rig.robot.cancelled) - cancels >= 3
    assert rig.link.all("action")[-1].status != "CANCELLED"


def test_action_that_is_accepted_after_its_failure_was_reported_is_cancelled(rig):
    rig.robot.hanging = True
    rig.lease(renewal=5, ttl=60.0)
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.beat_for(12.0)
    rig.status("a1", "FAILED")
    rig.robot.hanging = False
    rig.wait(lambda: "a1" in rig.robot.cancelled, 1.0)
    rig.robot.ignores_cancel = True
    rig.robot.going = True
    rig.sleep(0.6)
    assert any(error.startswith("runs_on") for error in rig.state().errors)
    assert rig.robot.told == ZERO


def test_action_that_was_refused_is_not_cancelled(rig):
    rig.robot.refuses = "no way there"
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.status("a1", "FAILED")
    rig.sleep(2.0)
    assert rig.robot.cancelled == []
    rig.drive(0.3)


@pytest.mark.parametrize("action", [m.Goto, m.Dock])
def test_action_waits_for_rest_that_was_measured_and_not_only_repeated(rig, action):
    rig.drive(0.3)
    rig.sleep(0.1)
    rig.robot.reading = replace(rig.robot.reading, is_measured=False)
    rig.act(own(action, **({"x": 1.0, "y": 1.0} if action is m.Goto else {})))
    rig.beat_for(2.0)
    assert rig.robot.started == []
    assert rig.robot.told == ZERO
    assert rig.now() - rig.robot.velocities()[-1][0] < 0.1, "zeros are still sent"
    rig.robot.reading = replace(rig.robot.reading, is_measured=True)
    rig.wait(lambda: rig.robot.started)


def test_new_goal_waits_for_the_end_of_the_one_before(rig):
    rig.robot.ignored_cancels = 4
    go(rig)
    rig.act(own(m.Goto, "a2", x=2.0, y=2.0))
    rig.beat_for(1.0)
    assert [action.action_id for action in rig.robot.started] == ["a1"]
    rig.beat_for(3.0)
    assert [action.action_id for action in rig.robot.started] == ["a1", "a2"]
    assert rig.robot.cancelled.count("a1") == 5


def test_new_goal_fails_when_the_one_before_never_ends(rig):
    rig.robot.ignores_cancel = True
    rig.lease(renewal=5, ttl=60.0)
    go(rig)
    rig.act(own(m.Goto, "a2", x=2.0, y=2.0))
    rig.beat_for(11.0)
    assert rig.status("a2", "FAILED").reason == "navigation_does_not_end"
    assert [action.action_id for action in rig.robot.started] == ["a1"]


@pytest.mark.parametrize("how", ["stop", "estop", "lost"])
def test_stop_and_loss_of_the_connection_cancel_the_motion_of_the_head(rig, how):
    rig.robot.finishes = False
    rig.act(own(m.Tilt, "t1", angle=0.3))
    rig.wait(lambda: rig.robot.started)
    if how == "stop":
        stop(rig)
    elif how == "estop":
        rig.act(staff(m.EStop, "e1"))
    else:
        rig.robot.lost = "the cable is cut"
        rig.wait(lambda: rig.kernel.fault is not None)
        rig.robot.lost = ""
    rig.wait(lambda: rig.robot.cancelled == ["t1"], 10.0)


def test_driver_waits_until_the_end_of_navigation_is_confirmed(rig):
    rig.robot.ignores_cancel = True
    go(rig)
    stop(rig)
    rig.robot.halt()
    rig.sleep(3.0)
    rig.push(0.0)
    rig.push(0.3)
    rig.sleep(0.1)
    assert rig.robot.told == ZERO
    assert rig.state().safety.inhibited == "unconfirmed"
    rig.robot.ignores_cancel = False
    rig.wait(lambda: not rig.kernel.is_end_unconfirmed)
    rig.drive(0.3)


def test_goal_that_waited_for_a_cancel_is_not_sent_after_a_stop(rig):
    """The end of the first goal is reported while its cancel is still under way."""
    rig.robot.cancel_hangs = True
    go(rig)
    rig.act(own(m.Cancel, "c1", target="a1"))
    rig.sleep(0.1)
    rig.robot.halt()
    rig.robot.report("a1", "CANCELLED")
    rig.sleep(0.6)
    rig.act(own(m.Goto, "a2", x=2.0, y=2.0))
    rig.sleep(0.4)
    rig.robot.cancel_hangs = False
    stop(rig)
    rig.sleep(4.0)
    assert [action.action_id for action in rig.robot.started] == ["a1"]
    assert rig.robot.motion == ZERO


def test_a_late_copy_of_a_stop_does_not_end_a_later_action(rig):
    rig.act(own(m.Stop, "stop-1", seq=1))
    rig.push(0.0)
    rig.seq += 5
    rig.push(0.0)
    go(rig)
    rig.act(own(m.Stop, "stop-1", seq=1))
    rig.sleep(0.3)
    assert rig.robot.going


def test_agent_cancels_an_action_before_it_ends(rig):
    rig.robot.ignored_cancels = 2
    go(rig)
    rig.close()
    assert rig.robot.cancelled.count("a1") == 3
    assert not rig.robot.going
    assert rig.robot.told == ZERO


class LockedRobot(NavigatingRobot):
    """One with a lock of its own, whose navigation takes a speed limit."""

    def __post_init__(self):
        super().__post_init__()
        self.locks, self.limited = [], []

    def set_lock(self, *, locked):
        self.locks.append(locked)

    def limit_speed(self, linear):
        self.limited.append(linear)


@pytest.mark.parametrize("robot", [LockedRobot], indirect=True)
def test_lock_of_the_base_follows_stops_and_is_set_after_each_connection(rig, robot):
    rig.sleep(0.1)
    assert robot.locks == [False]
    stop(rig)
    rig.sleep(0.1)
    assert robot.locks == [False, True]
    robot.lost = "the cable is cut"
    rig.wait(lambda: rig.kernel.fault is not None)
    robot.lost = ""
    rig.wait(lambda: rig.kernel.fault is None, 10.0)
    rig.sleep(0.1)
    assert robot.locks == [False, True, True]
    rig.push(0.0)
    rig.sleep(0.1)
    assert robot.locks[-1] is False


@pytest.mark.parametrize("robot", [LockedRobot], indirect=True)
def test_navigation_receives_the_speed_limit_of_the_lease(rig, robot):
    rig.lease(renewal=5, limits=m.LeaseLimits(linear=0.2))
    go(rig)
    assert robot.limited == [0.2]


@pytest.mark.parametrize("action", [None, m.Goto])
def test_control_that_fails_brakes_and_cancels_before_it_ends(tmp_path, monkeypatch, action):
    rig = ControlRig(tmp_path, robot=NavigatingRobot())
    rig.__enter__()
    rig.grant()
    if action is None:
        rig.drive(0.5)
    else:
        go(rig, action)
    monkeypatch.setattr(rig.control._dispatcher, "deadline", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        rig.time.run(rig._running)
    rig.time.close()
    assert rig.robot.told == ZERO
    assert not rig.robot.going
    assert rig.robot.closed
