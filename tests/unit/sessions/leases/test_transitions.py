"""Transitions of sessions as time passes."""

from dataclasses import replace

import pytest

from sessions.leases.policy import Grant, Wait
from sessions.leases.transitions import (
    ANSWER_SECONDS,
    IDLE,
    ROBOT_SILENCE,
    ROUND_TRIP_MARGIN_S,
    RobotLink,
    SetState,
    TurnLimited,
    WithdrawOffer,
)
from sessions.protocol import Ended, Offered, PresenceAsked, PresenceConfirmed, TurnWarning
from tests.support.sessions.lease_world import ASKING, RULES, World


@pytest.fixture
def world() -> World:
    world = World()
    world.take("ana")
    return world


def ended(session: str, outcome: str, reason: str) -> Ended:
    return Ended(session=session, outcome=outcome, reason=reason)


def drive(world: World) -> str:
    world.connected.add("ana")
    world.tick()
    session = world.session_of("ana").id
    assert world.sessions[session].state == "driving"
    return session


def pass_time(world: World, seconds: float, *, open_pages=("ana", "ben", "cem"), step: float = 0.5):
    acts = []
    until = world.now + seconds
    while world.now < until:
        world.now += step
        world.pages_say_they_are_open(set(open_pages))
        acts += world.tick()
    return acts


def test_a_session_drives_from_the_first_state_with_its_epoch_and_a_fresh_heartbeat(world):
    session = world.session_of("ana").id
    assert world.tick() == ()
    old_epoch = RobotLink(0.0, world.now, world.now, session, world.hold.epoch - 1, 0.1)
    assert world.tick(old_epoch) == ()
    assert world.tick(RobotLink(0.0, world.now, world.now, session, world.hold.epoch, 0.1)) == (
        SetState(session, "driving"),
    )


def test_a_silent_visitor_is_reconnecting_and_drives_again(world):
    session = drive(world)
    world.connected.clear()
    assert world.tick() == (SetState(session, "reconnecting", world.now),)
    world.connected.add("ana")
    assert world.tick() == (SetState(session, "driving"),)


def test_a_closed_page_does_not_interrupt_the_drive(world):
    session = drive(world)
    pass_time(world, 120.0, open_pages=())
    assert world.sessions[session].state == "driving"


def test_the_grace_period_ends_as_connection_lost(world):
    session = drive(world)
    world.connected.clear()
    acts = pass_time(world, RULES.grace + 2.0)
    assert ended(session, "connection_lost", "visitor_silent") in acts
    assert world.scene.hold.session is None


def test_a_reconnection_within_the_grace_period_restores_all_of_it(world):
    session = drive(world)
    world.connected.clear()
    pass_time(world, RULES.grace - 2.0)
    assert isinstance(world.take("ana", peer="new"), Grant)
    pass_time(world, RULES.grace - 2.0)
    assert world.sessions[session].state == "reconnecting"


def test_a_session_that_never_connects_ends_as_connection_refused(world):
    session = world.session_of("ana").id
    acts = pass_time(world, RULES.start + 1.0)
    assert ended(session, "connection_refused", "never_connected") in acts


def test_a_silent_robot_ends_the_session_as_robot_fault(world):
    session = drive(world)
    world.online, world.offline_since = False, world.now
    acts = pass_time(world, ROBOT_SILENCE + 2.0)
    assert acts == [ended(session, "robot_fault", "robot_offline")]


def restarted(world: World, session: str | None = None) -> RobotLink:
    """The link of a robot that has just restarted and has no session yet."""
    return RobotLink(0.0, world.now, world.now, session, 0, None)


def test_repeated_restarts_are_a_robot_fault(world):
    session = drive(world)
    assert world.tick(restarted(world)) == (SetState(session, "reconnecting", world.now),)
    while world.scene.hold.session is not None:
        world.now += 1.0
        world.pages_say_they_are_open({"ana"})
        died_at = world.now - world.now % 10.0  # it reconnects every ten seconds, for a moment
        acts = world.tick(replace(restarted(world), last_received_at=died_at, state_at=died_at))
    assert acts == (ended(session, "robot_fault", "robot_offline"),)


def test_a_robot_that_is_lost_while_the_visitor_reconnects_is_a_robot_fault(world):
    session = drive(world)
    world.connected.clear()
    world.tick()
    pass_time(world, RULES.grace - 5.0)
    last = replace(world.link, silence=RULES.grace)
    acts = []
    while world.hold.session is not None:
        world.now += 1.0
        world.pages_say_they_are_open({"ana"})
        acts += world.tick(last)
    assert acts == [ended(session, "robot_fault", "robot_offline")]
    assert world.now - last.state_at == ROBOT_SILENCE + 1.0


def test_a_robot_that_never_gets_the_session_is_a_robot_fault(world):
    session = world.session_of("ana").id
    world.now += RULES.start + 1.0
    world.pages_say_they_are_open({"ana"})
    assert world.tick(restarted(world)) == (ended(session, "robot_fault", "robot_offline"),)


def test_a_visitor_whose_page_is_closed_is_lost_although_the_robot_is_silent(world):
    session = drive(world)
    world.online, world.offline_since = False, world.now
    world.change(session, seen_at=None)
    world.now += 5.0
    assert world.tick() == (SetState(session, "reconnecting", world.now),)


def test_a_disabled_robot_ends_the_session_as_stopped_by_operator(world):
    session = drive(world)
    world.enabled = False
    assert world.tick() == (ended(session, "stopped_by_operator", "robot_disabled"),)


def test_a_turn_ends_after_its_minutes_and_a_warning_while_a_visitor_waits(world):
    start = world.now
    session = drive(world)
    world.take("ben")
    acts = pass_time(world, RULES.turn + 1.0)
    assert acts[0] == TurnLimited(session, start + RULES.turn)
    warnings = [act.remaining for act in acts if isinstance(act, TurnWarning)]
    assert max(warnings) == pytest.approx(RULES.warning, abs=0.6)
    assert ended(session, "timed_out", "turn_over") in acts


def test_maintenance_warns_a_driver_from_its_announcement_and_ends_the_drive(world):
    session = drive(world)
    world.maintenance_at = world.now + 120.0
    assert world.tick() == (TurnWarning(session=session, remaining=120.0, reason="maintenance"),)
    pass_time(world, 119.0)
    assert world.sessions[session].state == "driving"
    assert ended(session, "stopped_by_operator", "maintenance") in pass_time(world, 2.0)


@pytest.mark.parametrize("lost", [False, True], ids=["connecting", "reconnecting"])
def test_maintenance_ends_a_session_that_is_not_connected(world, lost):
    session = world.session_of("ana").id
    if lost:
        drive(world)
        world.connected.clear()
        world.tick()
    world.maintenance_at = world.now
    assert ended(session, "stopped_by_operator", "maintenance") in world.tick()


def test_a_turn_that_ends_before_the_maintenance_ends_as_a_turn(world):
    session = drive(world)
    world.take("ben")
    world.maintenance_at = world.now + 2 * RULES.turn
    acts = pass_time(world, RULES.turn + 1.0)
    reasons = {act.reason for act in acts if isinstance(act, TurnWarning)}
    assert reasons == {"", "maintenance"}  # of the maintenance until the turn's own warning
    assert ended(session, "timed_out", "turn_over") in acts


def test_nobody_begins_during_maintenance_and_the_first_who_waits_is_next_after_it(world):
    drive(world)
    world.maintenance_at = world.now
    world.tick()
    assert isinstance(world.take("ben"), Wait)
    assert isinstance(world.take("cem"), Wait)
    assert not any(isinstance(act, Offered) for act in pass_time(world, 60.0))
    world.maintenance_at = None
    offers = [act.session for act in pass_time(world, 1.0) if isinstance(act, Offered)]
    assert offers == [world.session_of("ben").id]


def test_an_offer_is_withdrawn_when_maintenance_is_announced(world):
    world.take("ben")
    world.end(world.session_of("ana").id, "completed", "left")
    pass_time(world, 1.0)
    world.maintenance_at = world.now + 120.0
    assert WithdrawOffer(world.session_of("ben").id) in world.tick()


def test_a_long_drive_is_warned_from_when_another_visitor_waits(world):
    session = drive(world)
    pass_time(world, 5 * RULES.turn)
    world.take("ben")
    asked = world.now
    acts = world.tick()
    assert acts == (
        TurnLimited(session, asked + RULES.warning),
        TurnWarning(session=session, remaining=RULES.warning),
    )
    pass_time(world, RULES.warning - 1.0)
    assert world.sessions[session].state == "driving"
    assert ended(session, "timed_out", "turn_over") in pass_time(world, 2.0)


def test_a_waiting_session_with_a_closed_page_ends_no_turn(world):
    session = drive(world)
    world.take("ben")
    world.change(world.session_of("ben").id, seen_at=None)
    pass_time(world, RULES.turn + 5.0, open_pages=("ana",))
    assert world.sessions[session].state == "driving"
    assert world.ended["s0002"] == ("ben", "cancelled", "page_gone")


def test_a_turn_that_is_not_taken_passes_to_the_next(world):
    world.take("ben")
    world.take("cem")
    ben, cem = world.session_of("ben").id, world.session_of("cem").id
    world.end(world.session_of("ana").id, "completed", "left")
    acts = pass_time(world, RULES.start + 1.0)
    assert acts[:3] == [
        Offered(session=ben, seconds=RULES.start),
        ended(ben, "cancelled", "turn_not_taken"),
        Offered(session=cem, seconds=RULES.start),
    ]
    assert isinstance(world.take("cem"), Grant)


def test_an_offer_is_withdrawn_while_the_robot_is_offline_and_made_again(world):
    world.take("ben")
    ben = world.session_of("ben").id
    world.end(world.session_of("ana").id, "completed", "left")
    world.tick()
    world.online = False
    assert world.tick() == (WithdrawOffer(ben),)
    assert world.tick() == ()
    world.online = True
    assert world.tick() == (Offered(session=ben, seconds=RULES.start),)


def test_an_offer_that_could_not_be_taken_does_not_lapse(world):
    world.take("ben")
    world.end(world.session_of("ana").id, "completed", "left")
    world.tick()
    world.online = False
    world.now += RULES.start + 1.0
    world.pages_say_they_are_open({"ben"})
    assert world.tick() == (WithdrawOffer(world.session_of("ben").id),)


def test_no_session_ends_by_an_outage_of_the_session_manager(world):
    session = drive(world)
    world.connected.clear()
    world.tick()
    world.now += 1000.0  # no session manager ran
    started = RobotLink(since=world.now)
    world.change(session, seen_at=None)
    assert world.tick(started) == ()
    world.now += RULES.grace + 0.1
    assert world.tick(started) == (ended(session, "connection_lost", "visitor_silent"),)


def test_a_session_without_its_lease_is_ended(world):
    session = drive(world)
    world.hold = type(world.hold)(world.hold.epoch + 1)
    assert world.tick()[0] == ended(session, "connection_lost", "lease_gone")


def test_waiting_sessions_get_no_offer_during_a_drive(world):
    drive(world)
    assert isinstance(world.take("ben"), Wait)
    assert not any(isinstance(act, Offered) for act in pass_time(world, 5.0))


# --- are you still there? -------------------------------------------------------------------------


@pytest.fixture
def asking() -> World:
    world = World(rules=ASKING)
    world.take("ana")
    drive(world)
    return world


def test_an_idle_driver_is_asked_and_then_the_next_visitor_gets_the_robot(asking):
    session = asking.session_of("ana").id
    assert isinstance(asking.take("ben"), Wait)
    asking.rules = replace(ASKING, turn=3600.0)
    question = PresenceAsked(session=session, seconds=ANSWER_SECONDS)
    assert question not in pass_time(asking, ASKING.idle - 1.0)
    assert question in pass_time(asking, 1.5)
    acts = pass_time(asking, ANSWER_SECONDS + ROUND_TRIP_MARGIN_S + 1.0)
    assert [act for act in acts if isinstance(act, Ended | Offered)] == [
        ended(session, "timed_out", IDLE),
        Offered(session=asking.session_of("ben").id, seconds=RULES.start),
    ]
    assert not [act for act in acts if isinstance(act, PresenceAsked)]


def test_a_sign_after_the_question_keeps_the_robot_until_the_next_idle_period(asking):
    session = asking.session_of("ana").id
    pass_time(asking, ASKING.idle + 5.0)
    asking.active_at = asking.now
    assert PresenceConfirmed(session=session) in asking.tick()
    assert pass_time(asking, ASKING.idle - 1.0) == []
    assert PresenceAsked(session=session, seconds=ANSWER_SECONDS) in pass_time(asking, 2.0)


def test_a_sign_in_the_last_moment_keeps_the_robot_despite_the_round_trip(asking):
    session = asking.session_of("ana").id
    pass_time(asking, ASKING.idle + ANSWER_SECONDS + ROUND_TRIP_MARGIN_S - 1.0)
    asking.signs[session] = asking.now
    assert asking.tick() == (PresenceConfirmed(session=session),)
    assert not [act for act in pass_time(asking, ASKING.idle - 1.0) if isinstance(act, Ended)]


def test_a_sign_of_another_session_does_not_count(asking):
    asking.signs["s0"] = asking.now + ASKING.idle
    acts = pass_time(asking, ASKING.idle + ANSWER_SECONDS + ROUND_TRIP_MARGIN_S + 1.0)
    assert [type(act) for act in acts] == [PresenceAsked, Ended]


def test_an_active_driver_is_never_asked(asking):
    for _ in range(10):
        asking.active_at = asking.now
        assert pass_time(asking, ASKING.idle - 1.0) == []


def test_no_driver_is_removed_before_the_time_to_answer(asking):
    asking.now += 1000.0  # the session manager could not look for so long
    asking.pages_say_they_are_open({"ana"})
    session = asking.session_of("ana").id
    assert asking.tick() == (PresenceAsked(session=session, seconds=ANSWER_SECONDS),)
    assert pass_time(asking, ANSWER_SECONDS - 1.0) == []


def test_a_question_to_one_session_does_not_apply_to_the_next(asking):
    pass_time(asking, ASKING.idle + 5.0)
    asking.end(asking.session_of("ana").id, "cancelled", "left")
    asking.take("ben")
    asking.connected.add("ben")
    acts = pass_time(asking, ASKING.idle - 1.0)
    assert not [act for act in acts if isinstance(act, PresenceConfirmed | PresenceAsked | Ended)]


def test_no_driver_is_asked_if_rules_or_terms_have_no_idle_time(asking):
    session = asking.session_of("ana").id
    asking.change(session, idle=0.0)
    assert pass_time(asking, 1000.0) == []
    asking.change(session, idle=None)
    asking.rules = RULES
    assert pass_time(asking, 1000.0) == []


def test_terms_of_a_session_may_shorten_the_idle_time(asking):
    asking.change(asking.session_of("ana").id, idle=20.0)
    assert [type(act) for act in pass_time(asking, 22.0)] == [PresenceAsked]


def test_a_lost_visitor_is_not_asked_but_has_the_grace_period(asking):
    session = asking.session_of("ana").id
    asking.connected.clear()
    acts = pass_time(asking, ASKING.idle + ANSWER_SECONDS + ROUND_TRIP_MARGIN_S)
    assert [type(act) for act in acts] == [SetState, Ended]
    assert acts[-1] == ended(session, "connection_lost", "visitor_silent")


@pytest.mark.parametrize("turn", [RULES.turn, RULES.warning / 2], ids=["usual", "short"])
def test_a_turn_that_the_terms_always_limit_ends_without_a_queue(world, turn):
    start = world.now
    session = drive(world)
    world.change(session, turn_always=True, turn=turn)
    acts = pass_time(world, turn + 1.0)
    assert acts[0] == TurnLimited(session, start + turn)
    assert ended(session, "timed_out", "turn_over") in acts


def test_a_turn_is_not_offered_to_a_page_without_a_connection_and_its_place_is_kept(world):
    session = drive(world)
    world.take("ben")
    ben = world.session_of("ben").id
    world.end(session, "completed", "left")
    assert [act.session for act in pass_time(world, 2.0) if isinstance(act, Offered)] == [ben]
    world.change(ben, seen_at=None)
    acts = pass_time(world, RULES.grace - 2.0, open_pages=("ana",))
    assert WithdrawOffer(ben) in acts
    assert not any(isinstance(act, Ended) for act in acts)
    acts = pass_time(world, 2.0)
    assert [act.session for act in acts if isinstance(act, Offered)] == [ben]
