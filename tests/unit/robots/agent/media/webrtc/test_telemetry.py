"""States and poses for pages."""

from robots.agent.media.webrtc.telemetry import for_page
from robots.api import messages as m
from robots.api.codec import encode_frame
from tests.support import words


def state_with(commands):
    applied = tuple(
        m.AppliedCommand(
            seq=seq,
            stamp=1766000000.25,
            method="keyboard",
            way="datachannel",
            age=0.012345678,
            linear=0.3000000000000001,
            angular=0.0,
        )
        for seq in range(commands)
    )
    return words.state(
        seq=7,
        pose=m.Pose(x=1.23456789, y=-2.000000001, theta=3.14159265, score=0.9),
        applied=applied,
    )


def test_a_page_learns_of_the_newest_command_alone_and_nothing_finer_than_it_can_draw():
    told = for_page(state_with(3))
    assert (told.pose.x, told.pose.y, told.pose.theta, told.pose.score) == (
        1.2346,
        -2.0,
        3.1416,
        0.9,
    )
    (newest,) = told.applied
    assert (newest.seq, newest.linear, newest.age, newest.stamp) == (2, 0.3, 0.0123, 1766000000.25)
    assert (told.seq, told.battery) == (7, m.Battery(charge=0.8))


def test_a_state_for_a_page_is_less_than_half_as_long():
    assert len(encode_frame("state", for_page(state_with(5)))) < 0.5 * len(
        encode_frame("state", state_with(5))
    )


def test_a_state_without_commands_and_what_is_no_state_are_told_as_they_are():
    assert for_page(state_with(0)).applied == ()
    event = m.Heartbeat(n=1, stamp=1.0)
    assert for_page(event) is event
