"""An idle robot sends little, and reports at once when a page needs it."""

import random
from itertools import pairwise

import pytest

from robots.agent.broker_link.reconnection import SPREAD, Reconnection
from robots.agent.control import dispatcher, reports
from robots.api import messages as m
from robots.api.idle import WATCHER, is_news
from tests.support import words
from tests.support.agents.control_rig import ControlRig, staff
from tests.support.agents.scripted_robot import still

# s, shorter than in robots/api/idle.py because virtual time costs real time
INTEREST, SILENCE = 1.0, 4.0
SETTLED = 1.5  # s after which a robot that has just started is idle


@pytest.fixture
def rig(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatcher, "INTEREST_SECONDS", INTEREST)
    monkeypatch.setattr(reports, "IDLE_STATE_SECONDS", SILENCE)
    with ControlRig(tmp_path) as rig:
        yield rig


@pytest.fixture
def idle(rig):
    rig.sleep(SETTLED)
    return rig


def sent_in(rig, seconds):
    before = rig.link.count
    rig.sleep(seconds)
    return [suffix for suffix, _ in rig.link.sent[before:]]


def ask_for_states(rig, *, needed=True, peer=WATCHER):
    beat = m.CommandHeartbeat(n=1, stamp=rig.unix(), peer=peer, needed=needed)
    rig.link.say("command/heartbeat", beat)


def test_an_idle_robot_sends_a_state_each_half_minute_and_nothing_else(idle):
    assert sent_in(idle, 2.0 * SILENCE + 1.0) == ["state"] * 2


def test_a_page_that_opens_receives_states_at_once_until_seconds_after_it_was_closed(idle):
    before = idle.link.count
    ask_for_states(idle)
    idle.sleep(0.1)
    assert {suffix for suffix, _ in idle.link.sent[before:]} >= {"state", "heartbeat"}
    sent = sent_in(idle, 0.8)
    assert sent.count("state") in {3, 4}
    assert sent.count("heartbeat") in {3, 4, 5}
    idle.sleep(SETTLED)
    assert sent_in(idle, 2.0) == []
    states = idle.link.all("state")
    assert all(b.seq == a.seq + 1 for a, b in pairwise(states)), "silence leaves no gap"
    assert all(not beat.echoes for beat in idle.link.all("heartbeat")), "no client reads echoes"


def test_a_server_that_only_compares_clocks_is_echoed_and_leaves_the_robot_idle(rig):
    for _ in range(4):
        ask_for_states(rig, needed=False, peer="server")
        rig.sleep(0.5)
    assert any(beat.echoes for beat in rig.link.all("heartbeat"))
    assert sent_in(rig, 2.0) == []


def test_a_session_or_a_viewer_gets_four_states_a_second(idle):
    idle.lease(renewal=0, ttl=60.0)
    assert 15 <= sent_in(idle, 4.0).count("state") <= 18
    idle.media.connected = 1
    idle.link.say("lease", None)
    idle.sleep(SETTLED)
    assert sent_in(idle, 2.0).count("state") in {7, 8, 9}


def test_displays_receive_heartbeats_on_their_data_channel_while_the_robot_is_idle(idle):
    before = len(idle.media.told)
    idle.sleep(2.0)
    assert [suffix for suffix, _ in idle.media.told[before:]].count("heartbeat") >= 9


CHANGES = (
    {"battery": m.Battery(charge=0.77)},
    {"battery": m.Battery(charge=0.77, charging=True)},
    {"pose": m.Pose(x=1.3, y=2.0, theta=0.5)},
    {"pose": m.Pose(x=1.0, y=2.0, theta=0.5, localized=False)},
    {"errors": ("the brush is stuck",)},
    {"charger_contact": True},
)


def test_important_change_is_reported_at_once_and_a_small_one_is_not(idle):
    battery = m.Battery(charge=0.795, voltage=25.1, charging=False)
    idle.robot.reading = still(pose=m.Pose(x=1.1, y=2.0, theta=0.6), battery=battery)
    assert sent_in(idle, 1.0) == []
    for change in CHANGES:
        idle.robot.reading = still(**change)
        assert sent_in(idle, 0.3).count("state") == 1, change


def test_an_emergency_stop_is_reported_at_once(idle):
    idle.act(staff(m.EStop, "e1"))
    assert idle.link.wait("state", lambda state: state.safety.estop, within=0.5)


def test_a_new_connection_to_the_broker_sends_one_state(idle):
    idle.link.cut(mend=True)
    assert sent_in(idle, 0.5) == ["state"]


def test_a_turn_across_180_degrees_is_small():
    before, after = (
        words.state(seq, pose=m.Pose(x=0.0, y=0.0, theta=theta))
        for seq, theta in ((1, 3.1), (2, -3.1))
    )
    assert not is_news(before, after)


# --- reconnection to the broker -------------------------------------------------------------------


def first_pauses(robots, *, needed):
    found = []
    for seed in range(robots):
        reconnection = Reconnection(random.Random(seed))
        if needed:
            reconnection.needed(100.0)
        found.append(reconnection.pause(50.0, 100.0))
    return found


def test_idle_robots_reconnect_spread_over_seconds():
    pauses = first_pauses(1000, needed=False)
    for second in range(10):
        assert 60 <= sum(second <= pause < second + 1 for pause in pauses) <= 140


def test_a_robot_with_a_driver_reconnects_at_once():
    assert max(first_pauses(1000, needed=True)) <= 0.2


def test_pauses_grow_to_a_bound_and_are_reset_by_a_lasting_connection():
    reconnection = Reconnection(random.Random(1))
    pauses = [reconnection.pause(0.0, 1000.0 + n) for n in range(500)]
    assert max(pauses) <= SPREAD.longest
    assert max(pauses[1:]) > SPREAD.first
    assert all(
        Reconnection(random.Random(n)).pause(SPREAD.settled, 0.0) <= SPREAD.first for n in range(50)
    )


def test_a_robot_with_a_driver_retries_at_once_for_two_minutes():
    reconnection = Reconnection(random.Random(1))
    reconnection.needed(0.0)
    pauses = [reconnection.pause(0.0, now) for now in range(1, 240)]
    assert max(pauses[:118]) <= 1.0
    assert max(pauses[120:]) > 1.0
