"""States and poses for pages."""

from robots.agent.media.webrtc.telemetry import for_page
from robots.api import messages as m
from robots.api.codec import encode_frame
from tests.support import words


def state_with(commands):
    sent = {"stamp": 1766000000.25, "method": "keyboard", "way": "datachannel", "age": 0.012345678}
    speeds = {"linear": 0.3000000000000001, "angular": 0.0}
    applied = tuple(m.AppliedCommand(seq=seq, **sent, **speeds) for seq in range(commands))
    pose = m.Pose(x=1.23456789, y=-2.000000001, theta=3.14159265, score=0.9)
    return words.state(seq=7, pose=pose, applied=applied)


def test_page_gets_the_newest_command_and_rounded_numbers():
    sent = for_page(state_with(3))
    pose = sent.pose
    assert (pose.x, pose.y, pose.theta, pose.score) == (1.2346, -2.0, 3.1416, 0.9)
    (newest,) = sent.applied
    assert (newest.seq, newest.linear, newest.age, newest.stamp) == (2, 0.3, 0.0123, 1766000000.25)
    assert (sent.seq, sent.battery) == (7, m.Battery(charge=0.8))


def test_a_state_for_a_page_is_less_than_half_as_long():
    state = state_with(5)
    short, whole = (encode_frame("state", one) for one in (for_page(state), state))
    assert len(short) < 0.5 * len(whole)


def test_other_messages_are_not_changed():
    assert for_page(state_with(0)).applied == ()
    event = m.Heartbeat(n=1, stamp=1.0)
    assert for_page(event) is event
