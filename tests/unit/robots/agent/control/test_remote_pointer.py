"""Who may point on what the driver shares, and how often: the rules, without a robot."""

import pytest

from robots.agent.control.remote_pointer import BURST, FORGOTTEN, PEERS, RATE, Pointing
from robots.agent.safety.permissions import CommandSender
from robots.api.messages import PointCommand
from tests.support import words

LEASE = words.lease(epoch=7)
SERVER = CommandSender("mqtt")
CHANNEL = CommandSender("datachannel", "p1", role="driver")


def dot(stamp=1.0, **fields):
    return PointCommand(
        **{"stamp": stamp, "at": (0.5, 0.5), "session": "s1", "epoch": 7, "peer": "p1", **fields}
    )


def at_screen(stamp=1.0, **fields):
    return PointCommand(
        **{"stamp": stamp, "at": (0.5, 0.5), "role": "screen", "peer": "screen-1", **fields}
    )


def take(pointing, command, sender=SERVER, *, peer=None, lease=LEASE, shown=True, now=0.0):
    return pointing.take(
        peer or sender.peer or command.peer, command, sender, lease, shown=shown, now=now
    )


@pytest.fixture
def pointing():
    return Pointing()


@pytest.mark.parametrize(
    ("command", "sender", "reason"),
    [
        (dot(session="s0"), SERVER, "wrong_session"),
        (dot(epoch=6), CHANNEL, "wrong_epoch"),
        (dot(session=None), SERVER, "wrong_session"),
        (dot(), CommandSender("datachannel", "p2", role="observer"), "observer"),
        (at_screen(), CommandSender("datachannel", "p2", role="observer"), "observer"),
        (at_screen(), CommandSender("datachannel", "p2", role="driver"), "observer"),
    ],
)
def test_others_cannot_point_with_any_role(command, sender, reason, pointing):
    assert take(pointing, command, sender) is None
    assert pointing.refused == {reason: 1}


def test_dots_are_refused_on_a_transport_that_the_lease_does_not_allow(pointing):
    only_mqtt = words.lease(epoch=7, ways=("mqtt",))
    assert take(pointing, dot(), CHANNEL, lease=only_mqtt) is None
    assert take(pointing, dot(), SERVER, lease=only_mqtt) == "driver"
    assert pointing.refused == {"not_allowed": 1}


def test_overtaken_dot_is_dropped_until_a_clock_may_have_been_set(pointing):
    assert take(pointing, dot(100.0)) == "driver"
    assert take(pointing, dot(99.9), now=0.1) is None
    assert take(pointing, dot(100.0), now=0.1) is None, "once is enough"
    assert take(pointing, at_screen(5.0), now=0.1) == "screen", (
        "another peer has a clock of its own"
    )
    assert take(pointing, dot(50.0), now=0.1 + FORGOTTEN) == "driver"
    assert pointing.refused == {"old": 2}


def test_at_most_twenty_dots_a_second_pass_from_each_peer(pointing):
    passed = sum(take(pointing, dot(1.0 + n / 200), now=n / 200) == "driver" for n in range(2000))
    assert passed == pytest.approx(10 * RATE + BURST, abs=2)
    assert take(pointing, at_screen(1.0), now=10.0) == "screen", "one peer's flood is nobody else's"
    own_pace = Pointing()
    assert all(take(own_pace, dot(1.0 + n / 15), now=n / 15) == "driver" for n in range(300))


def test_few_of_many_strangers_are_remembered(pointing):
    for n in range(10 * PEERS):
        take(pointing, at_screen(peer=f"screen-{n}"), now=n / 1000)
    assert len(pointing._hands) == PEERS
