"""The agent's control with a simulated robot that navigates by itself."""

import time

import pytest

from robots.agent.adapters import registry
from robots.agent.robot_interface import AdapterError
from robots.api import messages as m
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.agents.truth import Onlooker
from tests.support.patience import patient


@pytest.fixture
def rig(tmp_path):
    adapter = registry.autonomous(
        registry.create(
            "simulator", "giraff", {"camera": "no", "start": "5.0,1.0,3.1", "seed": "3"}
        )
    )
    with ThreadedControlRig(tmp_path, robot=adapter) as rig:
        rig.link.wait("state", lambda s: s.pose.localized, within=40.0)
        rig.wait(lambda: not rig.kernel.held)
        yield rig


def truth_of(rig):
    return Onlooker(int(rig.robot.inner.address.rpartition(":")[2]))


def keep_beating(rig, until, within=60.0):
    deadline = time.monotonic() + patient(within)
    while not until():
        assert time.monotonic() < deadline, rig.link.all("action")[-3:]
        rig.beat()
        time.sleep(0.2)


@pytest.mark.nightly
def test_a_goto_keeps_to_the_leases_speed_tells_its_way_and_is_over_at_its_goal(rig):
    onlooker = truth_of(rig)
    rig.grant(limits=m.LeaseLimits(linear=0.25, angular=0.4), ttl=60.0)
    rig.act(m.Goto(action_id="g", stamp=time.time(), session="s1", epoch=1, x=3.5, y=1.0))
    rig.status("g", "RUNNING", within=10.0)
    keep_beating(
        rig,
        lambda: any(
            a.action_id == "g" and a.status in {"FINISHED", "FAILED"}
            for a in rig.link.all("action")
        ),
    )
    assert rig.status("g", "FINISHED").type == "goto"
    assert rig.link.wait("event", lambda e: e.type == "goal_reached").action_id == "g"
    rows = onlooker.history(60.0)
    assert 0.2 < max(abs(row.commanded_linear) for row in rows) <= 0.25 + 1e-9
    assert max(abs(row.commanded_angular) for row in rows) <= 0.4 + 1e-9
    assert any(len(path.points) > 1 for path in rig.link.all("path"))
    assert rig.link.wait("path", lambda p: p.points == (), since=0)
    assert any(s.mode == "goto" for s in rig.link.all("state"))
    onlooker.close()


@pytest.mark.nightly
def test_a_goto_ends_two_seconds_after_the_driver_was_last_heard_and_the_robot_stands(rig):
    onlooker = truth_of(rig)
    rig.grant(ttl=60.0)
    rig.act(m.Goto(action_id="g", stamp=time.time(), session="s1", epoch=1, x=1.2, y=1.0))
    assert rig.status("g", "CANCELLED", within=10.0).reason == "heartbeat_lost"
    rig.wait(lambda: onlooker.truth().linear == 0.0 and onlooker.truth().angular == 0.0)
    onlooker.close()


@pytest.mark.nightly
def test_the_server_sends_it_home_without_anybody_driving_and_an_estop_stops_it_on_the_way(rig):
    onlooker = truth_of(rig)
    rig.act(m.Dock(action_id="d", stamp=time.time(), role="server"))
    rig.link.wait(
        "state",
        lambda s: s.mode == "docking" and abs(s.velocity.angular) + abs(s.velocity.linear) > 0.1,
        within=20.0,
    )
    assert rig.link.wait("state", lambda s: s.mode == "docking").session is None
    rig.act(m.EStop(action_id="e", stamp=time.time()))
    assert rig.status("d", "CANCELLED").reason == "estop"
    rig.wait(lambda: onlooker.truth().linear == 0.0 and onlooker.truth().angular == 0.0)
    onlooker.close()


def test_assistance_stops_a_driver_before_a_wall_and_the_state_says_so(rig):
    onlooker = truth_of(rig)
    rig.grant(assist="slow", ttl=60.0)
    rig.drive(
        0.6,
        until=lambda: any(s.assist_why == "stop" for s in rig.link.all("state")[-3:]),
        within=40.0,
    )
    state = rig.link.wait("state", lambda s: s.assist_why == "stop")
    assert state.assist_point is not None
    assert state.mode == "assisted"
    assert onlooker.truth().contacts == 0
    rig.drive(-0.2, until=lambda: onlooker.truth().clearance > 0.3, within=20.0)
    onlooker.close()


# --- with sonars and a bumper, and no laser -------------------------------------------------------


@pytest.fixture
def blind(tmp_path):
    adapter = registry.create(
        "simulator",
        "giraff",
        {"camera": "no", "start": "5.0,1.0,1.5708", "seed": "3", "sensors": "sonar,bumper"},
    )
    assert registry.autonomous(adapter) is adapter
    with ThreadedControlRig(tmp_path, robot=adapter) as rig:
        rig.wait(lambda: not rig.kernel.held)
        yield rig


@pytest.mark.nightly
def test_sonars_stop_a_driver_before_a_wall_and_a_bumper_says_which_side_was_touched(blind):
    rig, onlooker = blind, Onlooker(int(blind.robot.address.rpartition(":")[2]))
    assert "scan" not in rig.robot.profile.capabilities
    rig.grant(assist="slow", ttl=60.0)
    rig.drive(
        0.6,
        until=lambda: any(s.assist_why == "stop" for s in rig.link.all("state")[-3:]),
        within=40.0,
    )
    assert onlooker.truth().contacts == 0
    assert rig.link.all("state")[-1].clearance < 0.3
    rig.lease(renewal=1, assist="off", ttl=60.0)
    for _ in range(2):  # and once more: the contact ends, and begins again
        before = len(rig.link.all("event"))
        rig.drive(
            0.2,
            until=lambda before=before: any(
                e.type == "collision" for e in rig.link.all("event")[before:]
            ),
            within=20.0,
        )
        assert [e.detail for e in rig.link.all("event") if e.type == "collision"][-1] == "ahead"
        rig.link.wait("state", lambda s: s.safety.touched == ("ahead",))
        rig.drive(
            -0.2,
            until=lambda: (
                rig.kernel.inhibited(rig.now()) is None and onlooker.truth().clearance > 0.1
            ),
            within=20.0,
        )
    onlooker.close()


def test_a_sensor_that_no_simulated_robot_has_is_named():
    with pytest.raises(AdapterError, match="no sensor radar"):
        registry.create("simulator", "giraff", {"sensors": "laser,radar"})
