"""The kernel's rules, one by one; test_kernel_machine.py combines them."""

import msgspec
import pytest

from robots.agent.ramp import ZERO
from robots.agent.safety.clock_sync import SERVER_PEER
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from robots.api.age_limits import COMMAND_AGE_BOUND, FRAME_AGE_BOUND
from tests.support.agents.kernel_bench import DRIVER_CLOCK, LIMITS, TICK, Bench, bench_with_driver

DRIVER = CommandSender("datachannel", "p1")


@pytest.fixture
def bench():
    return bench_with_driver()


@pytest.mark.parametrize("every", [0.2, TICK])
def test_speed_grows_by_the_acceleration_limit_at_any_rate_of_commands(bench, every):
    bench.drive(0.7)
    assert bench.run(1.0, every=every, linear=0.7) == pytest.approx(0.4, abs=0.02)


def test_the_verdict_has_the_velocity_that_limits_and_age_allow(bench):
    young = bench.drive(9.0)
    assert (young.allowed.linear, young.share) == (LIMITS.linear, 1.0)
    half = bench.drive(9.0, age=0.75 * LIMITS.command_age)
    assert half.share == pytest.approx(0.5, abs=0.02)
    assert half.allowed.linear == pytest.approx(0.5 * LIMITS.linear, abs=0.02)
    slow = bench.drive(0.1, age=0.75 * LIMITS.command_age)
    assert slow.allowed.linear == 0.1


@pytest.mark.parametrize("asked", [1.2, 30.0, 1e6])
def test_lease_and_robot_cannot_raise_the_hard_bound_of_ages(asked):
    limits = msgspec.structs.replace(LIMITS, command_age_ceiling=asked, frame_age_ceiling=asked)
    bench = bench_with_driver(limits=limits)
    bench.lease(renewal=1, limits=m.LeaseLimits(command_age=asked, frame_age=asked))
    assert bench.drive(age=COMMAND_AGE_BOUND - 0.05, frame_age=0.5).reason is None
    assert bench.drive(age=COMMAND_AGE_BOUND + 0.05, frame_age=0.5).reason == "stale"
    if asked > FRAME_AGE_BOUND:
        assert bench.drive(frame_age=FRAME_AGE_BOUND - 0.05).reason is None
        assert bench.drive(frame_age=FRAME_AGE_BOUND + 0.05).reason == "frame_stale"


def test_a_renewal_prolongs_the_lease_and_an_older_copy_does_not(bench):
    bench.run(8.0)
    assert not bench.lease(renewal=0)
    assert bench.lease(renewal=1)
    bench.run(8.0)
    assert bench.drive().reason is None


def test_a_lower_epoch_is_accepted_only_after_the_lease_has_ended(bench):
    bench.lease(epoch=7)
    assert not bench.lease(epoch=2, renewal=9)
    bench.run(11.0)
    assert bench.lease(epoch=1, session="s9")


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"session": "other"}, "wrong_session"),
        ({"epoch": 2}, "wrong_epoch"),
        ({"seq": 1}, "old_seq"),
        ({"age": 0.26}, "stale"),
        ({"age": -0.2}, "future"),
        ({"frame_age": None}, "no_frame"),
        ({"frame_age": 1.01}, "frame_stale"),
        ({"frame_age": -0.5}, "frame_future"),
        ({"sender": CommandSender("datachannel", "p2")}, "observer"),
        ({"sender": CommandSender("mqtt", retained=True)}, "retained"),
    ],
)
def test_a_bad_command_is_refused_with_its_reason_and_counted(bench, fields, reason):
    bench.drive(0.0)
    assert bench.drive(0.5, **fields).reason == reason
    assert bench.kernel.refused == {reason: 1}
    assert bench.speed == 0.0


def test_before_three_echoes_the_clock_is_unknown():
    bench = Bench()
    bench.lease()
    bench.know_clock(echoes=2)
    assert bench.drive().reason == "clock_unknown"
    bench.know_clock(echoes=1)
    assert bench.drive().reason is None


def test_a_lease_may_lower_the_age_limit_but_never_above_the_ceiling(bench):
    bench.lease(renewal=1, limits=m.LeaseLimits(command_age=0.1, frame_age=0.2))
    assert bench.drive(age=0.12).reason == "stale"
    assert bench.drive(frame_age=0.25).reason == "frame_stale"
    bench.lease(renewal=2, limits=m.LeaseLimits(command_age=30.0, frame_age=30.0))
    assert bench.drive(age=0.9).reason is None
    assert bench.drive(age=1.05).reason == "stale"
    assert bench.drive(frame_age=2.9).reason is None
    assert bench.drive(frame_age=3.1).reason == "frame_stale"


def test_a_frame_is_needed_only_where_the_lease_requires_video(bench):
    bench.lease(renewal=1, video="none")
    assert bench.drive(frame_age=None).reason is None


def test_the_speed_cap_falls_linearly_between_half_and_full_age(bench):
    # A rotation, because it reaches its cap soonest.
    for age, share in ((0.1, 1.0), (0.1875, 0.5), (0.2375, 0.1)):
        bench.run(1.5, every=0.06, linear=0.0, angular=9.0, age=age)
        assert bench.kernel.commanded.angular == pytest.approx(0.9 * share, abs=0.01)


def test_an_old_frame_lowers_the_cap_as_an_old_command_does(bench):
    bench.run(1.5, every=0.06, linear=0.0, angular=9.0, frame_age=0.75)
    assert bench.kernel.commanded.angular == pytest.approx(0.45, abs=0.01)


def test_the_smallest_limit_of_robot_lease_and_assistance_counts(bench):
    bench.lease(renewal=1, limits=m.LeaseLimits(linear=0.3, angular=5.0))
    bench.run(3.0, every=0.06, linear=9.0, angular=9.0)
    assert bench.speed == pytest.approx(0.3)
    assert bench.kernel.commanded.angular == pytest.approx(0.9)
    bench.kernel.assist.level, bench.kernel.assist.clearance = "slow", 0.0
    bench.run(1.0, every=0.06, linear=9.0)
    assert bench.speed == pytest.approx(0.1)


def test_three_hundred_milliseconds_of_silence_brake_with_the_braking_limit(bench):
    bench.run(2.0, every=0.06, linear=0.5)
    bench.drive(0.5)
    begun = bench.now
    bench.run(0.28)
    assert bench.speed == pytest.approx(0.5)
    bench.now = begun + 0.3
    assert bench.tick().why == "deadman"
    assert bench.speed < 0.5
    bench.run(0.5 / 1.2 + TICK)
    assert bench.speed == 0.0


def test_the_deadline_is_that_of_the_deadman_while_driving(bench):
    bench.drive(0.5)
    assert bench.kernel.deadline() == pytest.approx(bench.now + 0.3)
    bench.run(0.4)
    assert bench.kernel.deadline() is None


def test_silence_of_a_driver_is_unknown_before_the_first_heartbeat(bench):
    bench.run(0.2)
    bench.kernel.heartbeat("p1", "datachannel", bench.now)
    assert bench.kernel.visitor_silence(bench.now) == 0.0
    bench.lease(session="s2", epoch=2, peer="p2")
    assert bench.kernel.visitor_silence(bench.now) is None
    bench.kernel.heartbeat("p1", "datachannel", bench.now)
    assert bench.kernel.visitor_silence(bench.now) is None, "that was another peer's heartbeat"
    bench.kernel.heartbeat("p2", "datachannel", bench.now)
    assert bench.kernel.visitor_silence(bench.now + 0.5) == pytest.approx(0.5)


def test_an_idle_kernel_sends_nothing_after_the_robot_was_measured_at_rest(bench):
    bench.run(0.5, every=0.06)
    bench.run(1.5)
    tail = [decision.velocity for _, decision in bench.outputs[-80:]]
    zeros = [v for v in tail if v == ZERO]
    assert 15 <= len(zeros) <= 18
    assert tail[-1] is None


@pytest.mark.parametrize("lease", [True, False])
def test_robot_that_moves_without_a_command_is_braked_again_and_reported(bench, lease):
    if not lease:
        bench.end_lease()
    bench.run(1.0)
    assert bench.outputs[-1][1].velocity is None
    bench.motion = m.Velocity(linear=0.3, angular=0.0)
    bench.run(0.5)
    assert bench.kernel.moves_despite_stop(bench.now)
    bench.run(20.0)
    sent = [decision.velocity for at, decision in bench.outputs if at > bench.now - 20.4]
    assert sent == [ZERO] * len(sent)
    bench.motion = ZERO
    bench.run(0.5)
    assert not bench.kernel.moves_despite_stop(bench.now)
    bench.lease(session="s2", epoch=2)
    bench.know_clock()
    assert bench.drive(0.3, session="s2", epoch=2).reason is None
    assert bench.speed == 0.0, "the driver waits longer after such a motion"
    bench.run(2.0)
    assert bench.outputs[-1][1].velocity is None


@pytest.mark.parametrize(
    ("motion", "is_ended"), [((0.32, 0.0), False), ((0.4, 0.0), True), ((0.0, 0.6), True)]
)
def test_navigation_of_the_rca_that_exceeds_the_limits_is_ended(bench, motion, is_ended):
    bench.lease(renewal=1, limits=m.LeaseLimits(linear=0.3, angular=0.5))
    bench.navigate()
    bench.run(0.5)
    bench.motion = m.Velocity(linear=motion[0], angular=motion[1])
    bench.run(0.4)
    assert bench.kernel.navigation
    bench.run(0.2)
    ended = [("g1", "too_fast")] if is_ended else []
    assert bench.kernel.drain_cancelled() == ended


def test_one_measurement_at_rest_is_not_enough_without_another(bench):
    kernel = bench.kernel
    kernel.brake(bench.now)
    kernel.measured(ZERO, bench.now)
    for _ in range(100):
        bench.now += TICK
        assert kernel.tick(bench.now).velocity == ZERO
    kernel.measured(ZERO, bench.now)
    assert kernel.tick(bench.now).velocity is None


def test_time_without_a_connection_to_the_base_does_not_count_as_braking(bench):
    bench.drive(0.5)
    bench.kernel.set_fault("adapter_lost")
    for _ in range(500):
        bench.now += TICK
        bench.kernel.tick(bench.now)
    bench.kernel.clear_fault(bench.now)
    bench.motion = m.Velocity(linear=0.3, angular=0.0)
    bench.run(0.38)
    assert not bench.kernel.settles_too_long(bench.now)
    assert not bench.kernel.moves_despite_stop(bench.now)
    bench.run(0.1)
    assert bench.kernel.moves_despite_stop(bench.now)


def test_robot_never_measured_at_rest_is_reported(bench):
    bench.run(1.0, every=0.1, linear=0.3)
    bench.motion = m.Velocity(linear=0.0, angular=0.06)
    bench.lease(session="s2", epoch=2)
    bench.run(4.9)
    assert bench.kernel.inhibited(bench.now) == "settling"
    assert not bench.kernel.settles_too_long(bench.now)
    bench.run(0.3)
    assert bench.kernel.settles_too_long(bench.now)


def test_standstill_thresholds_of_the_robot_count():
    bench = Bench(standstill=m.Velocity(linear=0.02, angular=0.1))
    bench.lease()
    bench.motion = m.Velocity(linear=0.0, angular=0.06)
    bench.stop()
    bench.run(0.5)
    assert bench.outputs[-1][1].velocity is None


def test_contact_without_a_direction_holds_a_turning_robot(bench):
    bench.run(1.0, every=0.06, linear=0.0, angular=0.8)
    bench.kernel.touched(())
    bench.run(0.5, every=0.06, linear=0.0, angular=0.8)
    assert bench.kernel.commanded == ZERO
    assert bench.drive(0.0, 0.8).reason == "stopped"
    bench.drive(0.0, 0.0)
    assert bench.drive(0.0, 0.8).reason is None


def test_noise_of_the_odometry_gives_a_contact_no_direction(bench):
    bench.run(1.0, every=0.06, linear=0.0, angular=0.8)
    bench.kernel.measured(m.Velocity(linear=0.001, angular=0.8), bench.now)
    bench.kernel.touched(())
    assert bench.kernel.contacts.sides == ()
    assert bench.kernel.held


def test_navigation_of_the_rca_into_a_contact_is_ended(bench):
    bench.kernel.contacts.felt(["ahead"])
    bench.navigate()
    bench.run(0.5)
    bench.motion = m.Velocity(linear=-0.2, angular=0.0)
    bench.run(0.2)
    assert bench.kernel.navigation, "it backs away"
    bench.kernel.contacts.felt(["ahead"])
    bench.motion = m.Velocity(linear=0.2, angular=0.0)
    bench.run(0.1)
    assert bench.kernel.drain_cancelled() == [("g1", "collision")]


def test_metres_of_the_rca_point_away_from_a_contact(bench):
    bench.kernel.contacts.felt(["ahead"])
    bench.navigate()
    bench.run(0.5)
    bench.motion = m.Velocity(linear=-0.2, angular=0.0)
    bench.run(0.5)
    assert bench.kernel.contacts.sides == ()


def test_robot_left_by_the_rca_brakes_from_its_measured_speed(bench):
    bench.navigate()
    bench.run(0.5)
    bench.motion = m.Velocity(linear=0.5, angular=0.0)
    bench.run(0.5)
    bench.stop(peer="p2")
    assert bench.speed == pytest.approx(0.5, abs=LIMITS.linear_braking * 2 * TICK)
    bench.run(0.1)
    assert 0.2 < bench.speed < 0.45


def test_agent_that_yields_to_a_newer_one_does_not_command_the_base(bench):
    bench.run(1.0)
    bench.kernel.yields = True
    bench.motion = m.Velocity(linear=0.3, angular=0.0)
    bench.run(1.0)
    assert bench.outputs[-1][1].velocity is None


def test_pause_of_the_loop_is_followed_by_a_ramp(bench):
    bench.run(2.0, every=0.06, linear=0.5)
    bench.now += 0.45
    bench.tick()
    assert bench.speed > 0.5 - 3 * TICK * LIMITS.linear_braking
    bench.run(1.0)
    assert bench.speed == 0.0


def test_the_drivers_stop_voids_every_lower_number_and_the_next_command_drives(bench):
    bench.run(2.0, every=0.06, linear=0.5)
    bench.stop(seq=bench.seq + 3, session="s1", epoch=1)
    assert bench.run(TICK) < 0.5
    assert bench.kernel.stop_seq == bench.seq + 3
    assert bench.kernel.stop_id == "stop-1"
    for _ in range(3):
        assert bench.drive(0.5).reason == "old_seq"
    assert bench.drive(0.5).reason is None


def test_a_repeated_stop_is_one_stop(bench):
    number = bench.seq + 1
    assert bench.stop(seq=number, session="s1", epoch=1)
    assert not bench.stop(seq=number, session="s1", epoch=1)
    bench.seq = number
    assert bench.drive(0.5).reason is None
    assert not bench.stop(seq=number, session="s1", epoch=1)
    assert bench.run(0.1) > 0.0


@pytest.mark.parametrize(
    "how",
    [
        {"peer": "p2"},
        {"peer": "p1", "epoch": 9, "session": "s1"},
        {"way": "mqtt", "role": "staff"},
        {"way": "mqtt", "role": "observer"},
    ],
)
def test_stop_by_another_holds_the_robot_until_the_driver_releases(bench, how):
    bench.run(2.0, every=0.06, linear=0.5)
    bench.stop(**how)
    bench.run(2.0, every=0.06, linear=0.5)
    assert bench.speed == 0.0
    assert bench.kernel.inhibited(bench.now) == "stopped"
    assert bench.drive(0.0).reason is None
    assert bench.drive(0.5).reason is None


def test_a_second_of_heartbeats_without_commands_releases_a_hold(bench):
    bench.stop(peer="p2")
    bench.run(1.5, beats="datachannel")
    assert bench.drive(0.5).reason is None


@pytest.mark.parametrize("beats", [None, "mqtt"], ids=["nothing", "only the other transport"])
def test_silence_of_the_network_releases_no_hold(bench, beats):
    bench.run(2.0, every=0.06, linear=0.5)
    bench.stop(way="mqtt", role="staff")
    bench.run(0.5, every=0.06, linear=0.5)  # the key is still held
    bench.run(5.0, beats=beats)
    for _ in range(20):
        assert bench.drive(0.5).reason == "stopped"
    assert bench.speed == 0.0


def test_heartbeats_in_one_burst_do_not_release_a_hold(bench):
    bench.drive(0.5)
    bench.stop(way="mqtt", role="staff")
    bench.run(3.0)
    for _ in range(20):
        bench.kernel.heartbeat("p1", "datachannel", bench.now)
    assert bench.drive(0.5).reason == "stopped"


@pytest.mark.parametrize("cause", ["estop", "fault"])
def test_silence_of_the_network_after_an_estop_or_a_fault_releases_no_hold(bench, cause):
    bench.run(2.0, every=0.06, linear=0.5)
    if cause == "estop":
        bench.estop(role="staff", user="ops")
        bench.kernel.clear_estop(bench.now)
    else:
        bench.kernel.set_fault("adapter_lost")
        bench.kernel.clear_fault(bench.now)
    bench.run(1.05)
    assert bench.drive(0.5).reason == "stopped"


def dock_refusal(bench):
    return bench.ask(m.Dock(action_id="home", stamp=bench.unix, role="server"))


@pytest.mark.parametrize("role", ["staff", "observer"])
@pytest.mark.parametrize("released_by", ["new driver", "staff", "owner", "screen"])
def test_stop_by_a_person_holds_the_robot_after_the_session(bench, role, released_by):
    bench.stop(way="mqtt", role=role)
    bench.end_lease()
    bench.run(60.0)
    assert dock_refusal(bench) == "stopped"
    assert bench.kernel.inhibited(bench.now) == "stopped"
    if released_by == "new driver":
        bench.lease(session="s2", epoch=2, peer="p2")
        assert not bench.kernel.held
        return
    clear = m.ClearEStop(action_id="c1", stamp=bench.unix, role=released_by, user="ops")
    assert bench.ask(clear) is None
    bench.kernel.clear_estop(bench.now)
    assert dock_refusal(bench) is None


def test_stop_between_sessions_ends_the_return_to_the_dock(bench):
    bench.end_lease()
    bench.run(1.0)
    bench.navigate("d1", "docking", by_server=True)
    bench.stop(way="mqtt", role="observer")
    assert bench.kernel.drain_cancelled() == [("d1", "stopped")]
    bench.run(10.0)
    assert dock_refusal(bench) == "stopped"


def test_stop_of_a_driver_whose_session_just_ended_lets_the_robot_return(bench):
    bench.end_lease()
    bench.stop(session="s1", epoch=1)
    bench.run(1.0)
    assert dock_refusal(bench) is None


def test_fault_between_sessions_does_not_keep_the_robot_from_its_dock(bench):
    bench.end_lease()
    bench.kernel.set_fault("adapter_lost")
    bench.kernel.clear_fault(bench.now)
    assert dock_refusal(bench) is None


def test_copies_from_before_a_stop_are_refused_after_the_servers_epochs_were_reset(bench):
    for epoch in range(10, 30):  # more than the sixteen sessions that the kernel remembers
        bench.lease(session=f"s{epoch}", epoch=epoch)
        bench.drive(0.0, session=f"s{epoch}", epoch=epoch)
    bench.run(11.0)
    bench.lease(session="reset", epoch=1)
    bench.know_clock()
    before = [bench.command(0.5, session="reset", epoch=1) for _ in range(5)]
    bench.stop(session="reset", epoch=1, seq=bench.seq + 1)
    for copy in before:
        verdict = bench.kernel.velocity(copy, DRIVER, now=bench.now, unix=bench.unix)
        assert verdict.reason == "old_seq"


def test_an_observers_stop_voids_no_number_of_the_driver(bench):
    bench.stop(peer="p2", seq=10**9, session="s1", epoch=1)
    assert bench.drive(0.0).reason is None


def test_a_robot_without_measurements_is_not_reported_as_moving(bench):
    bench.drive(0.5)
    bench.kernel.measured(ZERO, bench.now)
    bench.stop()
    for _ in range(200):
        bench.now += 0.02
        bench.kernel.tick(bench.now)
        assert not bench.kernel.moves_despite_stop(bench.now)
    bench.kernel.measured(m.Velocity(linear=0.3, angular=0.0), bench.now)
    assert bench.kernel.moves_despite_stop(bench.now)


@pytest.mark.parametrize(
    ("fields", "way", "reason"),
    [
        ({"role": "driver", "user": "Ada", "session": "s1", "epoch": 1}, "mqtt", "role"),
        ({"role": "observer", "user": "Ada"}, "mqtt", "observer"),
        ({"role": "server", "user": "manager"}, "mqtt", "role"),
        ({"role": "staff", "user": ""}, "mqtt", "not_from_server"),
        ({"role": "owner", "user": "Ada"}, "datachannel", "not_from_server"),
    ],
)
def test_an_estop_is_cleared_only_by_staff_over_the_server(bench, fields, way, reason):
    bench.estop()
    action = m.ClearEStop(action_id="c1", stamp=bench.unix, **fields)
    assert bench.ask(action, way=way, peer="p1") == reason
    assert bench.kernel.latch


def test_the_robots_button_replaces_the_source_of_an_estop(bench):
    bench.estop()
    bench.kernel.button(pressed=True, now=bench.now, unix=bench.unix)
    bench.estop(action_id="estop-2")
    assert bench.kernel.latch.source == "button"


def own(bench, kind, **fields):
    """Return an action of the driver."""
    values = {"action_id": "a1", "session": "s1", "epoch": 1, "stamp": bench.unix + DRIVER_CLOCK}
    return kind(**values | fields)


def goto(bench, **fields):
    return own(bench, m.Goto, x=1.0, y=2.0, **fields)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({}, None),
        ({"stamp": 0.0}, "stale"),
        ({"session": "old"}, "wrong_session"),
        ({"epoch": 0}, "wrong_epoch"),
        ({"role": "observer"}, "observer"),
        ({"role": "screen"}, "observer"),
        ({"role": "staff"}, "role"),
    ],
)
def test_an_action_needs_the_lease_and_the_right_role(bench, change, reason):
    assert bench.ask(goto(bench, **change)) == reason


def test_the_role_of_an_action_on_a_data_channel_is_that_of_its_peer(bench):
    forged = goto(bench, role="owner", user="Eve")
    assert bench.ask(forged, way="datachannel", peer="p2") == "observer"
    assert bench.ask(goto(bench, role="observer"), way="datachannel", peer="p1") is None


def test_retained_actions_and_those_from_the_future_are_refused(bench):
    assert bench.ask(goto(bench), retained=True) == "retained"
    assert bench.ask(goto(bench, stamp=bench.unix + 100.0)) == "future"


@pytest.mark.parametrize("kind", [m.Photo, m.Relocalize, m.ResendStates, m.Cancel])
def test_staff_needs_no_lease_for_actions_that_do_not_move_the_robot(kind):
    bench = Bench()
    fields = {"action_id": "a1", "stamp": bench.unix}
    fields |= {"boot": "b", "first": 0, "last": 1} if kind is m.ResendStates else {}
    assert bench.ask(kind(**fields, role="staff")) is None
    assert bench.ask(kind(**fields, role="driver", session="s1")) is not None


def test_the_servers_clock_counts_once_it_is_known(bench):
    bench.know_clock(SERVER_PEER, offset=-500.0)
    photo = m.Photo(action_id="a1", stamp=bench.unix, role="staff")
    assert bench.ask(photo) == "future"
    assert bench.ask(m.Photo(action_id="a1", stamp=bench.unix - 500.0, role="staff")) is None


def test_action_beyond_the_capabilities_is_refused(bench):
    bench.kernel.capabilities = frozenset({"velocity"})
    assert bench.ask(goto(bench)) == "unsupported"


def test_estop_stop_or_fault_prevents_navigation(bench):
    bench.stop(peer="p2")
    assert bench.ask(goto(bench)) == "stopped"
    bench.estop()
    assert bench.ask(goto(bench)) == "estop"


def test_manual_input_cancels_navigation_and_a_zero_does_not(bench):
    bench.navigate()
    assert bench.drive(0.0).reason == "navigating"
    assert bench.tick().velocity is None, "no zeros against a planner"
    assert bench.drive(0.3).reason is None
    assert bench.kernel.drain_cancelled() == [("g1", "manual")]


def test_a_robot_that_assists_by_itself_is_not_slowed_down_twice():
    bench = Bench(capabilities=frozenset({"velocity", "assist"}))
    bench.kernel.assist.level, bench.kernel.assist.clearance = "slow", 0.06
    assert bench.at_speed(0.6) == pytest.approx(0.6)


def test_navigation_stops_two_seconds_after_the_drivers_last_heartbeat(bench):
    bench.navigate()
    bench.run(1.5)
    bench.kernel.heartbeat("p1", "datachannel", bench.now)
    bench.run(1.9)
    assert bench.kernel.navigation
    bench.kernel.heartbeat("p2", "datachannel", bench.now)
    bench.run(0.2)
    assert bench.kernel.drain_cancelled() == [("g1", "heartbeat_lost")]


@pytest.mark.parametrize("answers", [True, False])
def test_return_to_the_dock_continues_while_the_server_sends_heartbeats(bench, answers):
    assert dock_refusal(bench) is None
    bench.navigate("d1", "docking", by_server=True)
    bench.end_lease()
    for _ in range(20):
        bench.run(0.5)
        if answers:
            bench.kernel.heartbeat(SERVER_PEER, "mqtt", bench.now)
    assert (bench.kernel.navigation is not None) == answers
    if not answers:
        assert bench.kernel.drain_cancelled() == [("d1", "heartbeat_lost")]


@pytest.mark.parametrize("order", [m.Tilt, m.Relocalize, m.Photo, m.Dock])
def test_server_orders_between_sessions_need_no_lease(bench, order):
    fields = {"angle": 0.2} if order is m.Tilt else {}
    action = order(action_id="dock-1", stamp=bench.unix, role="server", **fields)
    assert bench.ask(action) is None


# --- the terms of a lease -------------------------------------------------------------------------


def test_an_input_method_that_the_lease_does_not_allow_is_refused(bench):
    bench.lease(renewal=1, methods=("touch",))
    bench.know_clock()
    assert bench.drive(method="keyboard").reason == "not_allowed"
    assert bench.run(1.0, every=0.06, method="keyboard") == 0.0
    assert bench.drive(method="touch").reason is None
    assert bench.run(1.0, every=0.06, method="touch") > 0.1


def test_a_transport_that_the_lease_does_not_allow_is_refused(bench):
    bench.lease(renewal=1, ways=("mqtt",))
    assert bench.drive(sender=DRIVER).reason == "not_allowed"
    assert bench.drive(sender=CommandSender("mqtt")).reason is None


def test_an_action_that_the_lease_does_not_allow_is_refused_and_stops_are_obeyed(bench):
    bench.lease(renewal=1, actions=("photo",))
    for action, reason in (
        (goto(bench), "not_allowed"),
        (own(bench, m.Dock), "not_allowed"),
        (own(bench, m.Photo), None),
        (own(bench, m.Cancel), None),
    ):
        assert bench.ask(action, way="datachannel", peer="p1") == reason
    assert bench.stop(session="s1", epoch=1)
    assert bench.estop(way="datachannel", peer="p1")


def test_the_server_docks_a_robot_under_any_lease(bench):
    bench.lease(renewal=1, actions=(), ways=("datachannel",))
    assert dock_refusal(bench) is None
