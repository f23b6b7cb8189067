"""The agent's control loop with a simulated robot that our software navigates."""

import time

import pytest

from robots.agent.adapters import registry
from robots.agent.robot_interface import AdapterError
from robots.api import messages as m
from sessions.visitor_motion import VisitorMotion
from tests.support.agents.autonomous_drive import made
from tests.support.agents.control_rig import ThreadedControlRig, own
from tests.support.agents.truth import Onlooker


@pytest.fixture
def rig(tmp_path):
    with ThreadedControlRig(tmp_path, robot=made()) as rig:
        rig.link.wait("state", lambda s: s.pose.localized, within=40.0)
        rig.wait(lambda: not rig.kernel.held)
        yield rig


@pytest.fixture
def onlooker(rig):
    with Onlooker.of(rig.robot.inner.address) as onlooker:
        yield onlooker


def drive_at_the_wall(rig):
    """Drive until the assistance has stopped the robot."""
    stopped = lambda: any(s.assist_why == "stop" for s in rig.link.all("state")[-3:])
    rig.drive(0.6, until=stopped, within=40.0)


def at_rest(onlooker):
    truth = onlooker.truth()
    return truth.linear == truth.angular == 0.0


@pytest.mark.nightly
def test_goto_keeps_the_leases_limits_publishes_its_path_and_finishes(rig, onlooker):
    rig.grant(limits=m.LeaseLimits(linear=0.25, angular=0.4), ttl=60.0)
    rig.act(own(m.Goto, "g", x=3.5, y=1.0))
    rig.status("g", "RUNNING", within=10.0)
    assert rig.beat_until_end("g").type == "goto"
    assert rig.link.wait("event", lambda e: e.type == "goal_reached").action_id == "g"
    rows = onlooker.history(60.0)
    assert 0.2 < max(abs(row.commanded_linear) for row in rows) <= 0.25 + 1e-9
    assert max(abs(row.commanded_angular) for row in rows) <= 0.4 + 1e-9
    assert any(len(path.points) > 1 for path in rig.link.all("path"))
    assert rig.link.wait("path", lambda p: p.points == (), since=0)
    assert any(s.mode == "goto" for s in rig.link.all("state"))


@pytest.mark.nightly
def test_goto_is_cancelled_without_the_drivers_heartbeats(rig, onlooker):
    rig.grant(ttl=60.0)
    rig.act(own(m.Goto, "g", x=1.2, y=1.0))
    assert rig.status("g", "CANCELLED", within=10.0).reason == "heartbeat_lost"
    rig.wait(lambda: at_rest(onlooker))


@pytest.mark.nightly
def test_emergency_stop_cancels_docking_that_the_server_started(rig, onlooker):
    rig.act(m.Dock(action_id="d", stamp=time.time(), role="server"))
    rig.link.wait(
        "state",
        lambda s: s.mode == "docking" and abs(s.velocity.angular) + abs(s.velocity.linear) > 0.1,
        within=20.0,
    )
    assert rig.link.wait("state", lambda s: s.mode == "docking").session is None
    rig.act(m.EStop(action_id="e", stamp=time.time()))
    assert rig.status("d", "CANCELLED").reason == "estop"
    rig.wait(lambda: at_rest(onlooker))


def test_assistance_stops_a_driver_before_a_wall_and_is_in_the_state(rig, onlooker):
    rig.grant(assist="slow", ttl=60.0)
    drive_at_the_wall(rig)
    state = rig.link.wait("state", lambda s: s.assist_why == "stop")
    assert state.assist_point is not None
    assert state.mode == "assisted"
    assert onlooker.truth().contacts == 0
    rig.drive(-0.2, until=lambda: onlooker.truth().clearance > 0.3, within=20.0)


@pytest.mark.nightly
def test_states_tell_a_return_to_the_dock_from_leaving_it(tmp_path):
    adapter = registry.create("simulator", "giraff", {"camera": "no", "seed": "3"})
    with ThreadedControlRig(tmp_path, robot=registry.autonomous(adapter)) as rig:
        rig.link.wait("state", lambda s: s.docked, within=40.0)
        rig.wait(lambda: not rig.kernel.held)
        for action in (own(m.Undock, "u"), own(m.Dock, "d")):
            rig.grant(ttl=60.0)
            rig.act(action)
            assert rig.beat_until_end(action.action_id).status == "FINISHED"
        motion, states = VisitorMotion(), rig.link.all("state")
        moved = [(s.session, s.mode) for s in states if motion.take(s)]
        assert {*moved} == {("s1", "docking")}
        left = next(n for n, s in enumerate(states) if s.mode == "docking")
        free = next(n for n, s in enumerate(states) if n > left and s.mode == "manual")
        motion = VisitorMotion()
        assert not any(motion.take(s) for s in states[:free])


# --- with sonars and a bumper, and no laser -------------------------------------------------------


@pytest.fixture
def blind(tmp_path):
    adapter = registry.create(
        "simulator",
        "giraff",
        {"camera": "no", "start": "5.0,1.0,1.5708", "seed": "3", "sensors": "sonar,bumper"},
    )
    assert registry.autonomous(adapter) is adapter
    with (
        ThreadedControlRig(tmp_path, robot=adapter) as rig,
        Onlooker.of(adapter.address) as onlooker,
    ):
        rig.wait(lambda: not rig.kernel.held)
        yield rig, onlooker


@pytest.mark.nightly
def test_sonars_stop_a_driver_before_a_wall_and_a_bumper_reports_its_side(blind):
    rig, onlooker = blind
    assert "scan" not in rig.robot.profile.capabilities
    rig.grant(assist="slow", ttl=60.0)
    drive_at_the_wall(rig)
    assert onlooker.truth().contacts == 0
    assert rig.link.all("state")[-1].clearance < 0.3
    rig.lease(renewal=1, assist="off", ttl=60.0)
    collisions = lambda: [e.detail for e in rig.link.all("event") if e.type == "collision"]
    is_free = lambda: rig.kernel.inhibited(rig.now()) is None and onlooker.truth().clearance > 0.1
    for number in (1, 2):
        rig.drive(0.2, until=lambda number=number: len(collisions()) >= number, within=20.0)
        assert collisions()[-1] == "ahead"
        rig.link.wait("state", lambda s: s.safety.touched == ("ahead",))
        rig.drive(-0.2, until=is_free, within=20.0)


def test_unknown_sensor_is_named():
    with pytest.raises(AdapterError, match="no sensor radar"):
        registry.create("simulator", "giraff", {"sensors": "laser,radar"})
