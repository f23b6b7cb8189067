"""Rate limits of a page's messages, by their kinds."""

import pytest

from robots.agent.media.webrtc.packet_gate import PacketGate
from robots.api.codec import encode_frame
from robots.api.errors import Rejection
from robots.api.messages import Cancel, CommandHeartbeat, EStop, PointCommand, Stop, VelocityCommand
from tests.support import words

VELOCITY = encode_frame("command/velocity", words.velocity())
STOP = encode_frame("command/action", Stop(action_id="s1", stamp=1.0))
ESTOP = encode_frame("command/action", EStop(action_id="e1", stamp=1.0))
CANCEL = encode_frame("command/action", Cancel(action_id="c1", stamp=1.0))
BEAT = encode_frame("command/heartbeat", CommandHeartbeat(n=1, stamp=1.0, peer="p1"))
POINT = encode_frame("command/point", PointCommand(peer="p1", stamp=1.0))
EVERY_KIND = [VELOCITY, STOP, CANCEL, BEAT, POINT, "nonsense"]


@pytest.fixture
def gate() -> PacketGate:
    return PacketGate()


def test_a_driving_page_passes_and_its_frames_are_read(gate: PacketGate) -> None:
    assert all(isinstance(gate.take(VELOCITY, n / 50), VelocityCommand) for n in range(1000))
    assert isinstance(gate.take(BEAT.encode(), 20.0), CommandHeartbeat)
    assert gate.counts == {"accepted": 1001}


@pytest.mark.parametrize("frame", EVERY_KIND)
def test_a_flood_of_any_kind_is_cut_to_its_rate_and_leaves_the_others_theirs(
    frame: str, gate: PacketGate
) -> None:
    passed = [gate.take(frame, n / 10_000) for n in range(20_000)]
    assert sum(each is not None for each in passed) <= 300
    assert gate.counts["too_fast"] == passed.count(None)
    assert all(gate.take(other, 2.0) is not None for other in EVERY_KIND if other != frame)


def test_word_stop_in_another_message_is_no_stop(gate: PacketGate) -> None:
    noted = VELOCITY.replace("{", '{"note":"stop estop",', 1)
    assert sum(gate.take(noted, 0.0) is not None for _ in range(10_000)) == 100
    assert isinstance(gate.take(STOP, 0.0), Stop)
    assert isinstance(gate.take(ESTOP, 0.0), EStop)


def test_only_commands_are_accepted(gate: PacketGate) -> None:
    reasons = []
    for frame in (
        'lease\n{"session":"s1","epoch":1,"peer":"p1","who":"Eve","renewal":1,"stamp":1.0}',
        "state\n{}",
        "nowhere\n{}",
        "command/velocity\n{}",
    ):
        packet = gate.take(frame, 0.0)
        assert isinstance(packet, Rejection)
        reasons.append(packet.reason)
    assert reasons == ["not_from_server", "wrong_direction", "unknown_topic", "malformed"]


def test_ten_seconds_of_a_flood_are_one_and_a_page_that_is_twice_too_fast_is_none(
    gate: PacketGate,
) -> None:
    for n in range(2000):
        gate.take(STOP, n / 100)
    assert not gate.floods
    for n in range(2000):
        gate.take(STOP, 20.0 + n / 1000)
    assert gate.floods
