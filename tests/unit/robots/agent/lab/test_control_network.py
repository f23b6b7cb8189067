"""An emulated network for the driver's commands in the control loop."""

import statistics

import pytest

from robots.agent.lab.in_force import Networks
from robots.agent.ramp import ZERO
from robots.api import messages as m
from tests.support.agents.control_rig import ControlRig, own, staff

DELAY = 0.12


def configure(rig, lab, session="s1", **fields):
    rig.link.say(
        "config", m.Config(stamp=rig.unix(), control_network=lab, network_session=session, **fields)
    )


def reported(rig):
    """Return the first state with a network of the driver's commands."""
    return rig.link.wait("state", lambda s: s.control_network is not None)


def impaired(rig, lab):
    """Give a driver this network, and an age limit that leaves room for a slow machine."""
    rig.grant(limits=m.LeaseLimits(command_age=1.0))
    configure(rig, lab)
    assert reported(rig).control_network.lab == lab


@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
def test_commands_reach_the_base_older_by_the_delay_on_either_transport(rig, way):
    impaired(rig, m.NetworkLab(delay=DELAY, jitter=0.02, seed=1))
    rig.drive(0.5, way=way, until=lambda: sum(len(s.applied) for s in rig.link.all("state")) > 20)
    ages = [c.age for s in rig.link.all("state") for c in s.applied if c.linear > 0.0]
    assert min(ages) > DELAY - 0.02 - 0.03, "no command overtakes the network"
    assert DELAY - 0.03 < statistics.median(ages) < DELAY + 0.2
    report = rig.link.all("state")[-1].control_network
    assert report.taken >= len(ages)
    assert report.held > DELAY - 0.03


def test_a_clean_network_delays_no_command(rig):
    rig.drive(0.5)
    assert all(s.control_network is None and s.video_network is None for s in rig.link.all("state"))


@pytest.mark.parametrize("lab", [m.NetworkLab(loss=1.0), m.NetworkLab(delay=10.0)])
@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
@pytest.mark.parametrize("kind", [m.Stop, m.EStop])
def test_stop_and_estop_are_obeyed_at_once_on_any_network(rig, lab, way, kind):
    rig.drive(0.5)
    configure(rig, lab)
    reported(rig)
    rig.act(own(kind, "halt"), way=way)
    rig.wait(lambda: rig.robot.told == ZERO)
    rig.status("halt", "FINISHED")
    stopped = rig.link.wait("state", lambda s: s.safety.stop_id == "halt" or s.safety.estop)
    assert stopped.control_network is not None


def test_a_loss_of_every_command_leaves_the_drivers_heartbeat(rig):
    impaired(rig, m.NetworkLab(loss=1.0))
    since = rig.link.count
    for _ in range(10):
        rig.push(0.5)
        rig.beat()
    rig.act(own(m.Tilt, "look", angle=0.2), way="datachannel")
    lost = lambda state: state.control_network is not None and state.control_network.lost >= 11
    assert rig.link.wait("state", lost, since=since).visitor_silence < 4.0
    assert not any(c.linear for s in rig.link.all("state") for c in s.applied)
    assert rig.robot.told == ZERO
    assert not [a for a in rig.link.all("action") if a.action_id == "look"]


def test_the_round_trip_is_measured_beside_the_lab_so_that_ages_stay_right(rig):
    impaired(rig, m.NetworkLab(delay=0.5))
    rig.know_clock()
    assert rig.kernel.clocks.of("p1").round_trip < 0.5


def test_a_command_that_the_network_has_made_too_old_is_refused(rig):
    configure(rig, m.NetworkLab(delay=0.4))  # the robot's own limit is 250 ms
    reported(rig)
    for _ in range(5):
        rig.push(0.5)
    rig.link.wait("state", lambda s: s.refused.get("stale", 0) > 0)
    assert rig.robot.told == ZERO


def test_delayed_velocities_are_refused_after_a_stop(rig):
    # long enough for the stop of a driver who is held up
    impaired(rig, m.NetworkLab(delay=0.8))
    for _ in range(4):
        rig.push(0.5)
        rig.sleep(0.01)
    rig.act(own(m.Stop, "stop-1", seq=rig.seq + 1), way="datachannel")
    rig.link.wait("state", lambda s: s.safety.stop_id == "stop-1")
    rig.link.wait("state", lambda s: s.refused.get("old_seq", 0) + s.refused.get("stale", 0) > 0)
    assert all(velocity == ZERO for _, velocity in rig.robot.velocities())


def test_actions_of_staff_do_not_use_the_drivers_network(rig):
    impaired(rig, m.NetworkLab(loss=1.0))
    rig.act(staff(m.Photo))
    rig.status("a1", "FINISHED")


def test_the_next_visitor_has_a_clean_network_before_the_server_ends_the_lab(rig):
    impaired(rig, m.NetworkLab(delay=0.2, loss=0.5, seed=2))
    rig.media.network = m.LabReport(lab=m.NetworkLab(delay=0.2))
    rig.link.say("lease", None)
    rig.event("session_closed")
    since = rig.link.count
    rig.grant(session="s2", epoch=2, peer="p2", limits=m.LeaseLimits(command_age=1.0))
    state = rig.link.wait("state", lambda s: s.session == "s2", since=since)
    assert state.control_network is None
    assert state.video_network is None

    def ages():
        rig.push(0.5, peer="p2", session="s2", epoch=2)
        return [c.age for s in rig.link.all("state") if s.session == "s2" for c in s.applied]

    rig.wait(lambda: len(ages()) >= 10)
    assert min(ages()) < 0.15, "nothing holds them"


def test_a_network_of_one_session_waits_for_its_driver(rig):
    configure(rig, m.NetworkLab(delay=0.2), session="s7")
    assert rig.link.wait("state", lambda s: s.session == "s1").control_network is None
    rig.grant(session="s7", epoch=7)
    state = reported(rig)
    assert (state.session, state.control_network.lab.delay) == ("s7", 0.2)


def test_the_video_network_is_applied_and_reported_by_the_media_side(rig):
    lab = m.NetworkLab(bitrate=4e5, seed=8)
    rig.link.say("config", m.Config(stamp=rig.unix(), video_network=lab, network_session="s1"))
    assert rig.link.wait("state", lambda s: s.video_network is not None).video_network.lab == lab
    rig.link.say("config", m.Config(stamp=rig.unix()))
    since = rig.link.count
    rig.link.wait("state", lambda s: s.video_network is None, since=since)


def test_networks_of_the_command_line_hold_for_every_driver(tmp_path):
    lab = m.NetworkLab(delay=0.1, seed=3)
    with ControlRig(tmp_path, networks=Networks(lab, None)) as rig:
        assert rig.link.wait("state").control_network is None, "there is no driver yet"
        rig.grant(limits=m.LeaseLimits(command_age=1.0))
        assert reported(rig).control_network.lab == lab


def test_a_command_reports_the_age_of_its_picture(rig):
    def frame_age(frame):
        seq = rig.push(0.5, frame=frame).seq
        state = rig.link.wait("state", lambda s: any(c.seq == seq for c in s.applied))
        return next(c.frame_age for c in state.applied if c.seq == seq)

    rig.grant(limits=m.LeaseLimits(command_age=1.0))
    assert 0.2 <= frame_age(rig.unix() - 0.2) < 5.0
    assert frame_age(12.0) is None, "no picture of this robot is years old"


def test_a_held_command_that_cannot_be_handled_brakes_and_the_next_is_taken(rig, monkeypatch):
    impaired(rig, m.NetworkLab(delay=DELAY, seed=1))
    rig.drive(0.5)
    with monkeypatch.context() as broken:
        broken.setattr(rig.kernel, "permit", lambda *_, **__: 1 / 0)
        rig.act(own(m.Tilt, "t1", angle=0.1), way="datachannel")
        rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.link.wait("state", lambda s: s.refused.get("failed"))
    rig.release()
    rig.drive(0.5)
