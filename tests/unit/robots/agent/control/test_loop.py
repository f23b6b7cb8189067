"""The control loop as a whole, on virtual time, with a scripted robot and a broker in memory."""

import hashlib
import math
import statistics
from dataclasses import replace
from itertools import pairwise

import av
import msgspec
import numpy as np
import pytest

from robots.agent.control.supervised_adapter import SILENCE
from robots.agent.media.webrtc.packet_gate import decoded
from robots.agent.ramp import ZERO
from robots.api import messages as m, picture
from robots.api.geometry import Pose2D
from tests.support import words
from tests.support.agents.control_rig import ControlRig, own, staff, stamped
from tests.support.agents.scripted_robot import ScriptedRobot, SelfDrivingRobot, still

# --- driving --------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
def test_a_command_reaches_the_base_on_arrival_on_either_transport(rig, way):
    rig.drive(0.5, way=way)
    applied = rig.link.wait("state", lambda s: any(c.linear > 0.0 for c in s.applied)).applied
    assert {c.way for c in applied if c.linear > 0.0} == {way}
    assert all(-0.1 < c.age < 0.25 for c in applied)


def test_every_applied_command_is_in_exactly_one_state(rig):
    rig.drive(0.5)
    for _ in range(40):
        rig.push(0.5)
        rig.sleep(0.02)
    last = rig.seq

    def reported():
        states = rig.link.all("state")
        applied = [command.seq for state in states for command in state.applied]
        return applied, sum(sum(state.refused.values()) for state in states)

    # A machine that was busy for a quarter of a second makes even the last one stale.
    rig.wait(lambda: len(reported()[0]) + reported()[1] >= last)
    applied, refused = reported()
    assert len(applied) == len(set(applied))
    assert len(applied) + refused == last
    assert len(applied) > last / 2


def test_record_has_the_velocity_that_was_sent_by_an_adapter_that_delays_it(tmp_path):
    class SlowToSend(ScriptedRobot):
        """A robot whose adapter sends each velocity one call of `apply` late."""

        held_back = ZERO

        def apply(self, velocity):
            sent, self.held_back = self.held_back, velocity
            return super().apply(sent)

    with ControlRig(tmp_path, robot=SlowToSend()) as rig:
        rig.grant()
        rig.drive(0.5)
        rig.sleep(0.5)
        sent = {velocity.linear for _, velocity in rig.robot.velocities()}
        applied = [command for state in rig.link.all("state") for command in state.applied]
        assert {command.linear for command in applied} <= sent
        assert applied[0].linear == 0.0, "nothing was sent yet"


def test_observers_commands_are_refused_and_counted_and_their_stop_is_obeyed(rig):
    rig.drive(0.5)
    for _ in range(3):
        rig.push(0.7, peer="p2", role="observer")
    rig.link.wait("state", lambda s: s.refused.get("observer", 0) > 0)
    assert rig.robot.told.linear <= 0.5
    rig.act(stamped(m.Stop, "stop-1", seq=5), way="datachannel", peer="p2")
    state = rig.link.wait("state", lambda s: s.safety.stop_id == "stop-1")
    assert state.safety.inhibited == "stopped"
    rig.wait(lambda: rig.robot.told == ZERO)


def test_only_a_pages_own_messages_are_taken_from_a_data_channel(rig):
    rig.frame("lease", words.lease(session="s9", epoch=99, peer="p2"), peer="p2")
    rig.frame("config", m.Config(stamp=0.0, doors={"north": "open"}), peer="p2")
    rig.frame("signal/p2", m.Bye(reason="x"), peer="p2")
    rig.control.receive("p2", "driver", decoded(b"\xff\x00nonsense"))
    rig.control.receive("p2", "driver", decoded("state\n{}"))
    state = rig.link.wait("state", lambda s: s.refused.get("not_from_server", 0) == 3)
    assert state.epoch == 1
    assert rig.media.signals == []
    assert rig.robot.configs == []


def test_a_role_that_a_page_claims_is_ignored(rig):
    rig.robot.finishes = False
    rig.act(own(m.Dock, role="server"), way="datachannel")
    rig.status("a1", "RUNNING")
    assert not rig.kernel.navigation.ordered_by_server
    rig.act(stamped(m.ClearEStop, "c1", role="owner", user="Eve"), way="datachannel")
    assert rig.status("c1", "FAILED").reason == "not_from_server"


# --- lease ----------------------------------------------------------------------------------------


def test_a_session_ends_with_the_seq_of_its_last_state(rig):
    rig.drive(0.5)
    rig.link.say("lease", None)
    closed = rig.event("session_closed")
    states = [s for s in rig.link.all("state") if s.session == "s1"]
    assert closed.session == "s1"
    assert closed.last_seq == states[-1].seq
    seen = rig.link.count
    assert rig.link.wait("state", since=seen).session is None
    assert rig.media.drivers == ["p1", None]
    rig.wait(lambda: rig.robot.told == ZERO)


def test_a_lease_that_is_not_renewed_expires_and_is_reported(free_rig):
    free_rig.grant(ttl=3.0)
    free_rig.drive(0.5)
    free_rig.event("lease_expired")
    free_rig.event("session_closed")
    free_rig.push(0.5)
    free_rig.link.wait("state", lambda s: s.refused.get("no_lease"))
    free_rig.wait(lambda: free_rig.robot.told == ZERO)


def test_another_driver_takes_over_with_a_new_epoch_and_the_old_one_is_an_observer(rig):
    rig.drive(0.5)
    rig.lease(session="s2", epoch=2, peer="p2")
    rig.link.wait("event", lambda e: e.type == "session_closed" and e.session == "s1")
    rig.link.wait("event", lambda e: e.type == "lease_taken" and e.session == "s2")
    rig.push(0.5)
    rig.link.wait("state", lambda s: s.refused.get("observer"))
    assert rig.media.drivers[-1] == "p2"


def test_the_same_session_continues_with_a_new_epoch(rig):
    rig.lease(epoch=2, peer="p3")
    rig.link.wait("event", lambda e: e.type == "lease_taken" and e.epoch == 2)
    assert not [e for e in rig.link.all("event") if e.type == "session_closed"]


def test_a_stored_lease_names_the_session_and_permits_nothing(free_rig):
    free_rig.lease(retained=True)
    free_rig.link.wait("state", lambda s: s.session == "s1" and s.safety.inhibited == "no_lease")
    free_rig.know_clock()
    free_rig.push(0.5)
    free_rig.link.wait("state", lambda s: s.refused.get("no_lease"))
    assert {velocity for _, velocity in free_rig.robot.velocities()} <= {ZERO}


# --- stop and e-stop ------------------------------------------------------------------------------


def test_a_stop_is_echoed_at_once_and_answered(rig):
    rig.drive(0.5)
    begun = rig.unix()
    rig.act(own(m.Stop, "stop-1", seq=rig.seq + 1), way="datachannel")
    state = rig.link.wait("state", lambda s: s.safety.stop_id == "stop-1")
    assert rig.unix() - begun < 0.03, "a state of its own, and not the next of four a second"
    assert state.safety.stop_seq == rig.seq + 1
    rig.status("stop-1", "FINISHED")
    assert rig.event("stopped").action_id == "stop-1"
    rig.wait(lambda: rig.robot.told == ZERO)


def test_a_stop_by_another_person_and_its_release_by_the_driver_are_reported(rig):
    rig.drive(0.5)
    rig.act(stamped(m.Stop, "stop-1", seq=0), way="datachannel", peer="p2")
    assert rig.event("stopped").detail == "observer"
    rig.wait(lambda: rig.robot.told == ZERO)
    assert not [e for e in rig.link.all("event") if e.type == "released"]
    rig.push(0.0)
    assert rig.event("released").detail == "driver"


def test_a_stop_of_the_driver_needs_no_release(rig):
    rig.drive(0.5)
    rig.act(own(m.Stop, "stop-1", seq=rig.seq + 1), way="datachannel")
    rig.status("stop-1", "FINISHED")
    rig.push(0.0)
    rig.drive(0.5)
    assert not [e for e in rig.link.all("event") if e.type == "released"]


def test_a_release_without_a_driver_names_the_role_of_who_released(free_rig):
    free_rig.act(stamped(m.Stop, "stop-1", role="screen"))
    free_rig.status("stop-1", "FINISHED")
    free_rig.act(staff(m.ClearEStop, "c1"))
    assert free_rig.event("released").detail == "staff"


def test_an_estop_survives_a_restart_of_the_agent_and_is_cleared_by_staff(tmp_path):
    with ControlRig(tmp_path) as rig:
        rig.grant()
        rig.drive(0.5)
        rig.act(stamped(m.EStop, "e1", role="staff", user="Eve", detail="a child"))
        rig.status("e1", "FINISHED")
        rig.wait(lambda: rig.robot.told == ZERO)
    with ControlRig(tmp_path, boot="boot-2") as rig:
        state = rig.link.wait("state")
        assert state.safety.estop
        assert state.safety.estop_source == "staff:Eve"
        assert state.mode == "stopped"
        rig.grant(epoch=2)
        refused = lambda: any(s.refused.get("estop") for s in rig.link.all("state"))
        rig.drive(0.5, until=refused, epoch=2)
        assert all(velocity == ZERO for _, velocity in rig.robot.velocities())
        rig.act(staff(m.ClearEStop, "c1"))
        rig.status("c1", "FINISHED")
        assert rig.event("estop_cleared").detail == "staff:ops"
    with ControlRig(tmp_path, boot="boot-3") as rig:
        assert not rig.link.wait("state").safety.estop


def test_the_robots_own_button_latches_and_is_reported(rig):
    rig.drive(0.5)
    rig.robot.reading = still(estop=True)
    assert rig.event("estop").detail == "button button"
    assert rig.state().safety.button is True
    rig.robot.reading = still()
    rig.sleep(0.5)
    assert rig.kernel.button_pressed, "a missing report is no release"
    assert rig.state().safety.button is None
    rig.act(stamped(m.ClearEStop, "c0", role="owner", user="Ada"))
    assert rig.status("c0", "FAILED").reason == "button_pressed"
    rig.sleep(0.1)  # refusals are answered at most every 50 ms
    rig.robot.reading = still(estop=False)
    rig.wait(lambda: rig.robot.told == ZERO)
    rig.wait(lambda: not rig.kernel.button_pressed)
    rig.act(staff(m.ClearEStop, "c1"))
    assert rig.status("c1", "FAILED").reason == "owner_only"
    rig.act(stamped(m.ClearEStop, "c2", role="owner", user="Ada"))
    rig.status("c2", "FINISHED")


@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
def test_an_observers_estop_stops_the_robot_and_does_not_latch(rig, way):
    rig.drive(0.5)
    rig.act(stamped(m.EStop, "e1", role="observer"), way=way, peer="p2")
    rig.status("e1", "FINISHED")
    state = rig.link.wait("state", lambda s: s.safety.stop_id == "e1")
    assert (state.safety.estop, state.safety.inhibited) == (False, "stopped")
    assert rig.event("stopped").detail == "observer"
    rig.wait(lambda: rig.robot.told == ZERO)
    rig.push(0.0)
    rig.drive(0.5)
    assert rig.store.latch() is None


@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
def test_an_estop_of_the_robots_own_screen_latches_and_is_stored(rig, way):
    action = m.EStop(action_id="e1", stamp=rig.unix(), role="screen")
    if way == "mqtt":
        rig.link.say("command/action", action)
    else:
        rig.frame("command/action", action, peer="screen-1", role="screen")
    rig.status("e1", "FINISHED")
    assert rig.event("estop").action_id == "e1"
    assert rig.store.latch().source == "screen"


def test_a_goto_that_was_sent_before_a_stop_is_not_begun_after_it(rig):
    rig.act(own(m.Goto, "g1", x=1.0, y=1.0), way="datachannel")
    rig.act(own(m.Stop, "st", seq=rig.seq + 1), way="datachannel")
    rig.status("st", "FINISHED")
    rig.sleep(1.0)
    assert rig.kernel.navigation is None
    assert rig.robot.started == []


def test_a_hundred_estops_are_all_answered_and_written_to_the_disk_few_times(rig):
    written = []
    keep = rig.store.keep_latch
    rig.store.keep_latch = lambda latch: (written.append(latch), keep(latch))
    for number in range(100):
        rig.act(staff(m.EStop, f"e{number}"))
    for number in range(100):
        rig.status(f"e{number}", "FINISHED")
    assert len(written) <= 3
    assert rig.store.latch() == rig.kernel.latch


def test_a_disk_that_is_full_does_not_keep_an_estop_from_latching(rig):
    def full(_latch):
        raise OSError(28, "No space left on device")

    rig.store.keep_latch = full
    rig.act(staff(m.EStop, "e1"))
    rig.status("e1", "FINISHED")
    assert rig.kernel.latch
    rig.link.wait("state", lambda s: any("No space left" in error for error in s.errors))


# --- actions --------------------------------------------------------------------------------------


def test_a_repeated_action_is_done_once_and_answered_again(rig):
    tilt = own(m.Tilt, angle=0.2)
    for _ in range(3):
        rig.act(tilt, way="datachannel")
    rig.status("a1", "FINISHED")
    answered = rig.link.count
    rig.act(tilt, way="datachannel")
    rig.link.wait("action", lambda a: a.status == "FINISHED", since=answered)
    assert len(rig.robot.started) == 1


def test_a_stop_cancels_an_action_that_the_robot_has_not_answered(rig):
    rig.robot.hanging = True
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.kernel.navigation is not None and rig.kernel.navigation.may_begin)
    rig.sleep(0.1)
    rig.act(stamped(m.Stop, "stop-1"), way="datachannel", peer="p2")
    rig.wait(lambda: rig.robot.cancelled == ["a1"])
    assert rig.status("a1", "CANCELLED").reason == "stopped"
    rig.wait(rig.robot.velocities)
    assert rig.robot.told == ZERO


def test_reaching_a_goal_is_an_event_and_frees_the_robot(rig):
    rig.act(own(m.Goto, x=1.0, y=1.0))
    assert rig.event("goal_reached").action_id == "a1"
    rig.wait(lambda: rig.kernel.navigation is None)


def test_a_cancel_ends_the_running_action_and_fails_without_one(rig):
    rig.robot.finishes = False
    rig.act(staff(m.Cancel, "c0"))
    assert rig.status("c0", "FAILED").reason == "nothing_runs"
    rig.act(own(m.Tilt, "t1", angle=0.1))
    rig.status("t1", "RUNNING")
    rig.act(own(m.Cancel, "c1", target="t1"))
    rig.status("c1", "FINISHED")
    rig.status("t1", "CANCELLED")
    rig.act(own(m.Goto, "g1", x=0.0, y=0.0))
    rig.status("g1", "RUNNING")
    rig.act(own(m.Cancel, "c2"))
    rig.status("g1", "CANCELLED")


def test_a_photo_is_a_jpeg_whose_hash_is_in_the_event(rig):
    rig.act(staff(m.Photo, "photo-1"))
    done = rig.status("photo-1", "FINISHED")
    jpeg = rig.link.wait("photo/photo-1")
    digest = hashlib.sha256(jpeg).hexdigest()
    assert rig.event("photo").sha256 == done.result["sha256"] == digest
    assert done.result["stamp"] == 123.0
    (picture,) = av.CodecContext.create("mjpeg", "r").decode(av.Packet(jpeg))
    assert (picture.width, picture.height) == (64, 48)


@pytest.mark.parametrize("picture", [None, "of the adapter's own"], ids=["none", "no frame"])
def test_a_photo_without_a_frame_fails_and_the_drive_continues(rig, picture):
    rig.drive(0.5)
    rig.media.picture = picture
    rig.act(staff(m.Photo))
    assert rig.status("a1", "FAILED").reason == "no_picture"
    rig.drive(0.3)
    assert rig.kernel.fault is None


def test_a_disk_check_that_raises_is_repeated_and_the_drive_continues(free_rig, caplog):
    free_rig.grant(ttl=30.0)
    checks = []
    free_rig.store.shortage = lambda: checks.append(free_rig.now()) or 1 / 0
    free_rig.drive(0.5, until=lambda: len(checks) >= 2, within=12.0)
    assert caplog.text.count("background_task_failed") == len(checks)
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("fault", ["raises", "returns"])
def test_a_broker_link_that_ends_ends_the_control_loop(tmp_path, fault):
    async def end(_inbox):
        if fault == "raises":
            raise ZeroDivisionError

    rig = ControlRig(tmp_path)
    rig.link.run, rig.link.close = end, lambda: None
    rig.start()
    with rig.time, pytest.raises((RuntimeError, ZeroDivisionError)):
        rig.time.run(rig._running)
    assert rig.robot.closed


def test_states_are_sent_again_from_the_agents_buffer(rig):
    rig.wait(lambda: len(rig.link.all("state")) >= 6)
    first_time = rig.link.all("state")[1:4]
    seen = rig.link.count
    rig.act(stamped(m.ResendStates, "r1", role="server", boot="boot-1", first=2, last=4))
    done = rig.status("r1", "FINISHED")
    again = [message for name, message in rig.link.sent[seen:] if name == "state"]
    assert [state for state in again if state.seq in {2, 3, 4}] == first_time
    assert [state.seq for state in first_time] == [2, 3, 4]
    assert done.result == {"sent": 3.0, "missing": 0.0}
    rig.act(stamped(m.ResendStates, "r2", role="server", boot="another", first=2, last=4))
    assert rig.status("r2", "FAILED").reason == "unknown_boot"


# --- reports --------------------------------------------------------------------------------------


def test_states_are_sent_four_times_a_second_and_numbered_without_a_gap(free_rig):
    begun = len(free_rig.link.all("state"))
    free_rig.wait(lambda: len(free_rig.link.all("state")) >= begun + 13)
    stamps = [state.stamp for state in free_rig.link.all("state")[begun : begun + 13]]
    assert statistics.median(after - before for before, after in pairwise(stamps)) == pytest.approx(
        0.25, abs=0.05
    )
    seqs = [s.seq for s in free_rig.link.all("state")]
    assert seqs == list(range(1, len(seqs) + 1))


def test_heartbeats_are_sent_on_both_transports_with_the_echoes_of_both(free_rig):
    free_rig.beat("p1", way="datachannel")
    free_rig.beat("p1", way="mqtt")
    beat = free_rig.link.wait("heartbeat", lambda h: len(h.echoes) == 2)
    assert {echo.n for echo in beat.echoes} == {1, 2}
    beats = lambda: [message for name, message in free_rig.media.told if name == "heartbeat"]
    free_rig.wait(lambda: any(len(beat.echoes) == 2 for beat in beats()))


def test_pages_of_the_lease_are_in_every_heartbeat_among_any_number_of_viewers(free_rig):
    free_rig.lease(kind="wizard", peer="p1", wizard="w1", wizard_epoch=1)
    free_rig.wait(lambda: free_rig.kernel.leases.live(free_rig.now()))
    for _ in range(10):
        for peer in ("p1", "w1", *(f"v{number}" for number in range(150))):
            free_rig.beat(peer, way="mqtt")
        beat = free_rig.link.wait("heartbeat", since=free_rig.link.count)
        assert {"p1", "w1"} <= {echo.peer for echo in beat.echoes}
    assert free_rig.kernel.clocks.of("w1") is not None


def test_a_page_gets_the_displayed_fields_without_those_of_the_record(rig):
    scan = m.Scan(
        stamp=1.0, angle_min=-1.0, angle_increment=0.1, range_max=5.0, ranges=(1.0, None, 9.0)
    )
    rig.robot.reading = still(velocity=m.Velocity(linear=0.3, angular=0.0), scan=scan)
    rig.wait(lambda: {"state", "pose", "scan", "heartbeat"} <= {name for name, _ in rig.media.told})
    assert rig.link.wait("scan").ranges == (1.0, None, None), "9 m is out of the laser's range"
    assert not {name for name, _ in rig.media.told} & {"connection", "factsheet", "photo"}


def test_poses_are_sent_at_most_15_times_a_second_and_only_during_motion(rig):
    rig.wait(lambda: len(rig.link.all("state")) >= 3)
    assert rig.link.all("pose") == []
    rig.robot.reading = still(velocity=m.Velocity(linear=0.3, angular=0.0))
    rig.link.wait("pose")
    rig.wait(lambda: len(rig.link.all("pose")) >= 17)
    stamps = [pose.stamp for pose in rig.link.all("pose")]
    gaps = [after - before for before, after in pairwise(stamps)]
    assert statistics.median(gaps) < 0.125
    assert len(gaps) / (stamps[-1] - stamps[0]) <= 16.0


def test_docking_collisions_and_a_lost_localization_are_events(rig):
    rig.wait(lambda: rig.link.all("state"))
    rig.robot.reading = still(
        charger_contact=True,
        battery=m.Battery(charge=0.5, charging=True),
        contacts=1,
        pose=m.Pose(x=0.0, y=0.0, theta=0.0, localized=False),
    )
    for kind in ("docked", "charging", "collision", "localization_lost"):
        rig.event(kind)
    rig.robot.reading = still(contacts=1)
    for kind in ("undocked", "localization_found"):
        rig.event(kind)
    rig.link.wait("state", lambda s: s.contacts)
    assert sum(s.contacts for s in rig.link.all("state")) == 1


def test_the_drive_continues_without_the_broker_and_no_state_is_lost(rig):
    rig.drive(0.5)
    rig.link.cut()
    rig.wait(lambda: not rig.link.connected)
    away = rig.now()
    rig.drive(0.5, until=lambda: rig.now() > away + 1.5)
    # a busy machine may have delayed a command until the robot slowed down
    rig.drive(0.5)
    rig.link.cut(mend=True)
    rig.wait(lambda: rig.link.connected)
    rig.wait(lambda: rig.now() > away + 2.0)
    seqs = [s.seq for s in rig.link.all("state")]
    assert seqs == list(range(1, len(seqs) + 1))


def test_config_reaches_the_adapter_and_sets_the_assistance(rig):
    rig.link.say(
        "config", m.Config(stamp=1.0, assist="steer", doors={"north": "open"}), retained=True
    )
    rig.link.wait("state", lambda s: s.assist == "slow" and s.mode == "assisted")
    assert rig.robot.configs[-1].doors == {"north": "open"}
    rig.link.say("config", m.Config(stamp=2.0, doors={"north": "closed"}), retained=True)
    assert rig.event("door_changed").detail == "north closed"


class AssistedRobot(SelfDrivingRobot):
    """A robot with a laser whose RCA assists, and which our navigation drives."""

    def __post_init__(self):
        super().__post_init__()
        self.profile = replace(
            self.profile, capabilities=(*self.profile.capabilities, "assist"), laser=m.Laser(x=0.0)
        )

    async def states(self):
        scan = m.Scan(
            stamp=1.0, angle_min=-0.9, angle_increment=0.1, range_max=5.0, ranges=(1.0,) * 19
        )
        async for reading in super().states():
            seen = msgspec.structs.replace(scan, stamp=reading.stamp)
            yield replace(reading, odometry=Pose2D(0.0, 0.0, 0.0), scan=seen, assist_why="obstacle")


def test_states_name_the_source_of_the_distance(tmp_path, rig):
    assert rig.link.wait("state", lambda s: s.seq > 0).distance_by_position
    (tmp_path / "with-odometry").mkdir()
    with ControlRig(tmp_path / "with-odometry", robot=AssistedRobot()) as other:
        other.wait(lambda: other.robot.points)
        last = other.link.all("state")[-1].seq
        assert not other.link.wait("state", lambda s: s.seq > last).distance_by_position


def test_our_navigation_gets_obstacles_where_the_architecture_assists_by_itself(tmp_path):
    robot = AssistedRobot()
    with ControlRig(tmp_path, robot=robot) as rig:
        rig.wait(lambda: robot.points and len(robot.points[-1]))
        assert np.hypot(*robot.points[-1].T).min() == pytest.approx(1.0, abs=0.05)
        assert rig.kernel.monitor is None, "the agent does not assist, too"
        state = rig.link.wait("state", lambda s: s.clearance)
        assert state.assist_why == "obstacle", "the architecture's own reason"


def test_an_agent_that_has_just_started_reports_that_it_connects_and_no_loss(free_rig):
    first = free_rig.link.wait("state")
    assert first.safety.inhibited == "fault"
    assert first.errors == ("adapter_starting: the agent is connecting to the robot",)
    later = free_rig.link.wait("state", lambda s: not s.errors)
    assert later.safety.inhibited != "fault"


def test_a_device_that_does_not_work_is_named_in_states_until_it_works(rig):
    reason = "the camera rtsp://10.0.0.4 cannot be read: connection refused"
    newest = lambda: rig.link.all("state")[-1]
    for status, errors in ((m.CameraStatus(status="failed", reason=reason), (reason,)), (None, ())):
        rig.media.camera_status, rig.media.errors = status, errors
        rig.wait(lambda errors=errors: newest().errors == errors)
        assert newest().camera_status == status


def test_signals_reach_the_media_side_with_their_peer(rig):
    rig.link.say("signal/p5", m.SdpOffer(sdp="v=0", role="driver"))
    rig.wait(lambda: rig.media.signals == [("p5", m.SdpOffer(sdp="v=0", role="driver"))])
    rig.control.reply("p5", m.SdpAnswer(sdp="v=1"))
    assert rig.link.wait("signal/p5/reply") == m.SdpAnswer(sdp="v=1")


# --- the adapter ----------------------------------------------------------------------------------


def test_an_agent_starts_without_its_robot_and_reports_a_fault(tmp_path):
    robot = ScriptedRobot(lost="the cable is out")
    with ControlRig(tmp_path, robot=robot, at_once=True) as rig:
        state = rig.link.wait("state")
        assert state.safety.inhibited == "fault"
        assert not state.pose.localized
        rig.wait(lambda: rig.robot.connections >= 2)
        rig.act(stamped(m.Stop, "stop-1"))
        rig.link.wait("state", lambda s: s.safety.stop_id == "stop-1")
        rig.robot.lost = ""
        rig.link.wait(
            "state", lambda s: s.pose.x == 1.0 and s.safety.inhibited != "fault", within=10.0
        )


def test_the_first_reading_may_come_late_and_the_next_may_not(tmp_path):
    robot = ScriptedRobot(silent=True)
    with ControlRig(tmp_path, robot=robot, at_once=True) as rig:
        rig.sleep(3 * SILENCE)
        (why,) = rig.link.all("state")[-1].errors
        assert why.startswith("adapter_starting: "), "it is still waited for"
        robot.silent = False
        rig.wait(lambda: rig.kernel.fault is None)
        robot.silent = True
        state = rig.link.wait("state", lambda s: s.errors, since=rig.link.count)
        assert state.errors == ("adapter_lost: it is silent",)


def test_nonsense_is_no_first_reading(tmp_path):
    robot = ScriptedRobot(reading=still(pose=m.Pose(x=math.nan, y=0.0, theta=0.0)))
    with ControlRig(tmp_path, robot=robot, at_once=True) as rig:
        rig.wait(
            lambda: "it reports nonsense: " in rig.link.all("state")[-1].errors[0], SILENCE + 0.5
        )


def test_a_second_newer_agent_of_the_same_robot_takes_over(rig):
    rig.drive(0.5)
    rig.post(rig.link._inbox.rival, "newer")
    rig.link.wait(
        "state",
        lambda s: s.safety.inhibited == "fault" and any("another agent" in e for e in s.errors),
    )
    rig.wait(lambda: rig.robot.told == ZERO)
    rig.post(rig.link._inbox.rival, None)
    rig.wait(lambda: rig.kernel.fault is None)
    rig.release()
    rig.drive(0.5)


# --- the end --------------------------------------------------------------------------------------


def test_closing_brakes_first_and_disconnects_the_robot(tmp_path):
    with ControlRig(tmp_path) as rig:
        rig.grant()
        rig.drive(0.5)
        rig.close()
        assert rig.robot.told == ZERO
        assert rig.robot.closed
        full = max(at for at, v in rig.robot.velocities() if v.linear == 0.5)
        braked = [(at, v.linear) for at, v in rig.robot.velocities(full)]
        paused = max(after - before for (before, _), (after, _) in pairwise(braked))
        assert any(0.0 < v < 0.5 for _, v in braked) or paused > 0.1, "it brakes on a ramp"


# --- pictures through the server ------------------------------------------------------------------


def test_a_picture_request_reaches_the_media_side_and_its_picture_the_broker(rig):
    request = m.PictureRequest(stamp=1.0, peer="p1")
    rig.link.say("command/picture", request)
    rig.wait(lambda: rig.media.wanted == [request])
    payload = picture.pack(3.0, b"\xff\xd8\xff\xff\xd9")
    rig.control.publish_picture(payload)
    assert rig.link.wait("picture") == payload


def test_stored_picture_requests_and_those_on_a_data_channel_are_refused(rig):
    rig.link.say("command/picture", m.PictureRequest(stamp=1.0, peer="p1"), retained=True)
    rig.frame("command/picture", m.PictureRequest(stamp=1.0, peer="p2"))
    rig.wait(lambda: rig.kernel.refused["not_from_server"] == 1)
    rig.link.say("command/picture", m.PictureRequest(stamp=2.0, peer="p3"))
    rig.wait(lambda: rig.media.wanted)
    assert [request.peer for request in rig.media.wanted] == ["p3"]
